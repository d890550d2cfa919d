// tests/tools/sweep_test.cpp — shards run once or twice, killed, interrupted or broken: results are whole, and merging finds
// each once, and whoever disagrees.
#include <sys/wait.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <set>
#include <thread>

#include "tests/server/worlds.h"
#include "tests/tools/sweep_inputs.h"
#include "tools/database_row.h"
#include "tools/results_store.h"
#include "tools/sweep/folder.h"
#include "tools/sweep/merge.h"

namespace {

namespace fs = std::filesystem;
using tools::sweep::Attempt;
using tools::sweep::Shard;
using tools::sweep::State;
using tools::sweep::Sweep;

class SweepRun : public tools_test::SweepInputs {
protected:
    struct Outcome {
        int status = -1;
        std::string text;
    };
    Outcome shell(const std::string& script) const {
        put("script.sh", script);
        Outcome outcome;
        FILE* pipe = popen(("cd '" + folder_.string() + "' && gnomon='" + GNOMON_BINARY + "' bash script.sh 2>&1 </dev/null").c_str(), "r");
        if (!pipe) return outcome;
        std::array<char, 4096> buffer;
        while (const size_t read = fread(buffer.data(), 1, buffer.size(), pipe)) outcome.text.append(buffer.data(), read);
        const int status = pclose(pipe);
        outcome.status = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
        return outcome;
    }
    void expect(const std::string& script, int status, const std::string& word) const {
        const Outcome outcome = shell(script);
        EXPECT_EQ(outcome.status, status) << script << '\n' << outcome.text;
        EXPECT_NE(outcome.text.find(word), std::string::npos) << script << '\n' << outcome.text;
    }
    /// Four shards of three frames.
    void putPlan(const std::string& settings = "resolution = [64, 128]\nocclusion = ['off', 'exact']\n") const {
        put("plan.toml", "worlds = ['hills.world']\n[[path]]\nfile = 'walk.tum'\nframes = '0:3'\n[[settings]]\n" + settings);
    }
    Sweep opened() const {
        const auto sweep = tools::sweep::openSweep(at("s"));
        EXPECT_TRUE(sweep) << (sweep ? "" : sweep.error().what);
        return sweep.value();
    }
    std::vector<State> states(const Sweep& sweep) const {
        const auto status = sweep.status({});
        EXPECT_TRUE(status);
        std::vector<State> all;
        for (const auto& s : status.value()) all.push_back(s.state);
        return all;
    }
    void change(const fs::path& file, const std::string& sql) const {
        auto database = world::Database::openEmpty(file.string());
        ASSERT_TRUE(database);
        const auto done = database.value().run(sql);
        ASSERT_TRUE(done) << done.error().what;
    }
    std::set<std::string> shardFiles() const {
        std::set<std::string> names;
        for (const auto& entry : fs::directory_iterator(folder_ / "s/shards")) names.insert(entry.path().filename().string());
        return names;
    }
};

TEST_F(SweepRun, RunsAndMergesOnceWhatAReplayWouldHaveGiven) {
    putPlan();
    expect("$gnomon sweep plan.toml -o s --jobs 2", 0, "4 shards: 4 done");
    const Sweep sweep = opened();
    std::set<std::string> names;
    for (const Shard& shard : sweep.plan.shards) names.insert(shard.key + ".sqlite");
    EXPECT_EQ(shardFiles(), names) << "and nothing that is not whole";
    expect("$gnomon sweep merge s -o r.sqlite", 0, "4 of 4 shards, 4 of them new");
    expect("$gnomon sweep merge s -o r.sqlite && $gnomon sweep resume s && $gnomon sweep plan.toml -o s && $gnomon sweep merge s -o r.sqlite", 0,
           "4 of 4 shards, 0 of them new");
    expect("$gnomon replay hills.world --path walk.tum --frames 0:3 --resolution 64 --occlusion off --results one.sqlite --out one >log && "
           "$gnomon report --diff one.sqlite r.sqlite#1 && $gnomon report r.sqlite#1 r.sqlite#4 -o page.html",
           0, "Nothing differs");
    auto merged = tools::openResults(at("r.sqlite"));
    ASSERT_TRUE(merged);
    EXPECT_EQ(tools::numberFrom(merged.value(), "SELECT count(*) FROM run").value(), 4);
    EXPECT_EQ(tools::numberFrom(merged.value(), "SELECT count(*) FROM shard JOIN run ON run = id").value(), 4);
    EXPECT_EQ(tools::numberFrom(merged.value(), "SELECT count(*) FROM frame").value(), 12);
    // Into a file that has runs of others.
    expect("$gnomon sweep merge s -o one.sqlite", 0, "4 of 4 shards, 4 of them new");
}

TEST_F(SweepRun, MoversArePlayedAndMustBeThoseOfThePlan) {
    ASSERT_TRUE(world::bake(tests::streets({0, 0, 0}), at("streets.world"), {}));
    put("movers.csv", "time,id,node_or_mesh,x,y,z,qx,qy,qz,qw,scale\n0,0,\"box (0,0,0) 0\",2,3,3,0,0,0,1,1\n1,0,\"box (0,0,0) 0\",9,3,3,0,0,0,1,1\n");
    put("drive.tum", "0 0 2 0 0 0 0 1\n1 5 2 0 0 0 0 1\n2 9 2 0 0 0 0 1\n");
    put("plan.toml", "worlds = ['streets.world']\n[[path]]\nfile = 'drive.tum'\nmovers = 'movers.csv'\n[[settings]]\nresolution = [64, 128]\n");
    expect("$gnomon sweep plan.toml -o s && $gnomon sweep merge s -o r.sqlite", 0, "2 of 2 shards, 2 of them new");
    expect("$gnomon replay streets.world --path drive.tum --movers movers.csv --resolution 64 --results one.sqlite --out one >log && "
           "$gnomon report --diff one.sqlite r.sqlite#1",
           0, "Nothing differs");
    auto merged = tools::openResults(at("r.sqlite"));
    ASSERT_TRUE(merged);
    EXPECT_GT(tools::numberFrom(merged.value(), "SELECT sum(active_triangles) FROM cascade").value(), 0);
    expect("rm s/shards/* && sed -i 's/,9,3,3,/,8,3,3,/' movers.csv && $gnomon sweep resume s", 1, "movers.csv: has changed");
}

TEST_F(SweepRun, AFolderIsOfOneSweep) {
    putPlan("resolution = 64\n");
    expect("$gnomon sweep plan.toml -o s", 0, "1 done");
    putPlan("resolution = 128\n");
    expect("$gnomon sweep plan.toml -o s", 2, "other shards");
    expect("mkdir full && touch full/mine && $gnomon sweep plan.toml -o full", 2, "holds something else");
    expect("$gnomon sweep plan.toml", 2, "-o FOLDER");
    expect("$gnomon sweep status full", 3, "holds no sweep");
    expect("$gnomon sweep run s --shard 1", 2, "shards 0 to 0");
    expect("sed -i 's/\"program\": \".*\"/\"program\": \"0\"/' s/sweep.json && $gnomon sweep resume s", 2, "another build");
    expect("$gnomon sweep run s --shard 0", 2, "another build");
    put("s/sweep.json", "{\"gnomon_sweep\": 1, \"shards\": 7}");
    expect("$gnomon sweep merge s -o r.sqlite", 3, "damaged");
    put("s/sweep.json", "{\"gnomon_sweep\": 2}");
    expect("$gnomon sweep status s", 3, "another version");
}

TEST_F(SweepRun, FailuresAreListedAndTheOthersGoOn) {
    putPlan("resolution = [64, 7]\n");
    expect("$gnomon sweep plan.toml -o s", 1, "2 shards: 1 done, 0 running, 0 queued, 1 failed, 0 lost");
    expect("$gnomon sweep status s", 1, "--resolution=7: resolution");
    expect("$gnomon sweep merge s -o r.sqlite", 1, "1 of 2 shards");
    expect("cat s/logs/*.log", 0, "resolution: 7; give 64 to 8192");
    // What was read when the plan was made must be what is played.
    putPlan("resolution = [64, 128]\n");
    expect("rm -r s && $gnomon sweep plan.toml -o s && rm s/shards/* && sed -i 's/^2 13/2 14/' walk.tum && $gnomon sweep resume s", 1, "walk.tum: has changed");
    EXPECT_EQ(states(opened()), (std::vector<State>{State::kFailed, State::kFailed}));
    expect("sed -i 's/^2 14/2 13/' walk.tum && $gnomon sweep resume s", 0, "2 done");
}

TEST_F(SweepRun, WhatIsInterruptedOrKilledIsResumed) {
    // Large enough to be read by several threads, none of which may take a signal that the parent waits for; and long enough to be
    // met at work: each of these shards draws 400 frames.
    ASSERT_TRUE(world::bake(world::test::hillsWorld(6, 16, 2), at("hills.world"), {}));
    put("plan.toml", "worlds = ['hills.world']\n[[path]]\nfile = 'walk.tum'\nfps = 130\n[[settings]]\nresolution = 64\nverify = 1\nfov = [50, 60, 70]\n");
    const std::string begin = "set -u; setsid $gnomon sweep plan.toml -o s --jobs 1 >out 2>&1 & p=$!\n"
                              "for k in $(seq 4000); do [ -n \"$(ls s/shards 2>/dev/null)\" ] && break; sleep 0.02; done\n";
    // To all of them at once, as Ctrl-C does.
    expect(begin + "kill -TERM -- -$p; wait $p; s=$?; cat out; exit $s", 1, "interrupted; gnomon sweep resume");
    const Sweep sweep = opened();
    const std::vector<State> left = states(sweep);
    EXPECT_EQ(std::count(left.begin(), left.end(), State::kFailed), 0);
    for (const std::string& name : shardFiles()) EXPECT_TRUE(name.ends_with(".sqlite")) << name;
    // A signal that comes while the parent is not waiting for it, since it is stopped, is for any of its threads that does not block it.
    expect("rm -rf s\n" + begin + "kill -STOP $p; kill -TERM $p; kill -CONT $p; wait $p; s=$?; cat out; exit $s", 1, "interrupted; gnomon sweep resume");
    // A child that is killed is a failure that is told, and the others go on.
    expect("rm -rf s\n" + begin + "kill -9 $(cat /proc/$p/task/$p/children); wait $p; s=$?; cat out; exit $s", 1, "ended by signal 9");
    EXPECT_EQ(states(opened()), (std::vector<State>{State::kFailed, State::kDone, State::kDone}));
    // The parent is killed: nobody is left at work, and no half results.
    expect("rm -rf s\n" + begin + "c=$(cat /proc/$p/task/$p/children); kill -9 $p; wait $p; for k in $(seq 100); do kill -0 $c 2>/dev/null || break; sleep 0.05; done; "
           "kill -0 $c 2>/dev/null && echo alive; $gnomon sweep status s",
           1, "0 done, 0 running, 0 queued, 0 failed, 3 lost");
    expect("$gnomon sweep resume s", 0, "3 done");
    for (const std::string& name : shardFiles()) EXPECT_TRUE(name.ends_with(".sqlite")) << name;
}

// Programs of Slurm's names in place of Slurm, whose answers these are; tests/sweep_slurm_test.sh has the real ones.
TEST_F(SweepRun, WhatSlurmCouldNotLaunchIsLostAndLeavesItsQueueWhenResumed) {
    putPlan("resolution = [64, 128, 256, 512]\n");
    const auto fake = [&](const std::string& name, const std::string& body) {
        put("bin/" + name, "#!/bin/sh\n" + body);
        fs::permissions(folder_ / "bin" / name, fs::perms::owner_all);
    };
    fs::create_directory(folder_ / "bin");
    fake("sbatch", "echo \"$@\" >>asked\necho $((6 + $(wc -l <asked)))\n");
    fake("squeue", "printf '7 0 RUNNING None\\n7 1 PENDING launch failed requeued held\\n7 2 PENDING JobHeldUser\\n7 3 PENDING Resources\\n9 0 PENDING None\\n'\n");
    fake("scancel", "echo \"$@\" >>cancelled\n");
    const std::string path = "PATH=$PWD/bin:$PATH; ";
    expect(path + "$gnomon sweep plan.toml -o s --slurm", 0, "4 shards of 4 are in Slurm's hands, job 7");
    expect(path + "$gnomon sweep status s", 1, "0 done, 1 running, 2 queued, 0 failed, 1 lost\nlost 1, ");
    expect(path + "$gnomon sweep resume s", 0, "1 shards of 4 are in Slurm's hands, job 8");
    expect("cat cancelled; tail -n 1 asked", 0, "7_1\n--parsable");
    expect("tail -n 1 asked", 0, " --array=1 ");
    fake("scancel", "echo scancel: not now >&2; exit 1\n");
    expect(path + "$gnomon sweep resume s", 3, "scancel: not now");
}

TEST_F(SweepRun, AnAttemptIsSeenWhileItLivesAndNeverTakenForResults) {
    putPlan("resolution = 64\n");
    expect("$gnomon sweep plan.toml -o s", 0, "1 done");
    const Sweep sweep = opened();
    const Shard& shard = sweep.plan.shards.front();
    fs::rename(sweep.results(shard), at("whole.sqlite"));
    EXPECT_EQ(states(sweep), std::vector<State>{State::kLost});
    {
        auto first = Attempt::begin(sweep, shard), second = Attempt::begin(sweep, shard);
        ASSERT_TRUE(first);
        ASSERT_TRUE(second);
        EXPECT_NE(first.value().results(), second.value().results()) << "two writers on one name";
        EXPECT_EQ(states(sweep), std::vector<State>{State::kRunning});
        sweep.tidy();
        fs::copy_file(at("whole.sqlite"), first.value().results());
        fs::copy_file(at("whole.sqlite"), second.value().results());
        EXPECT_EQ(states(sweep), std::vector<State>{State::kRunning}) << "whole, but not yet said to be";
        ASSERT_TRUE(first.value().publish());
        EXPECT_EQ(states(sweep), std::vector<State>{State::kDone});
        ASSERT_TRUE(second.value().publish()) << "ran twice";
    }
    EXPECT_EQ(shardFiles(), (std::set<std::string>{shard.key + ".sqlite", shard.key + ".2.sqlite"}));
    expect("$gnomon sweep merge s -o r.sqlite", 0, "1 of 1 shards, 1 of them new");
    // Of a process that was killed.
    fs::remove(sweep.results(shard));
    fs::create_directories(folder_ / "s/shards" / (shard.key + ".partial.abcdef"));
    put("s/shards/" + shard.key + ".partial.abcdef/lock", "");
    EXPECT_EQ(states(sweep), std::vector<State>{State::kLost});
    expect("$gnomon sweep resume s", 0, "1 done");
    EXPECT_FALSE(fs::exists(folder_ / "s/shards" / (shard.key + ".partial.abcdef")));
}

TEST_F(SweepRun, ADisagreementIsNamedToTheLastBit) {
    putPlan("resolution = 64\n");
    expect("$gnomon sweep plan.toml -o s", 0, "1 done");
    const Sweep sweep = opened();
    const Shard& shard = sweep.plan.shards.front();
    const fs::path file = sweep.results(shard), again = folder_ / "s/shards" / (shard.key + ".2.sqlite");
    struct Case {
        std::string sql, word;
    };
    const Case cases[] = {
        {"UPDATE cascade SET static_texels = static_texels + 1 WHERE frame = 1 AND cascade = 2", "table cascade, frame 1, cascade 2: static_texels is "},
        {"UPDATE frame SET eye_x = eye_x * (1 + 2.3e-16) WHERE frame = 2", "table frame, frame 2: eye_x is "},
        {"UPDATE frame SET plan_hash = 'x' WHERE frame = 0", "plan_hash is "},
        {"UPDATE cascade SET t_gpu_static_ms = 1, window_x = NULL WHERE frame = 1 AND cascade = 0", "window_x is "},
        {"DELETE FROM cause WHERE frame = 0 AND cascade = 0", "table cause, frame 0, cascade 0"},
        {"UPDATE caster SET name = 'other' WHERE frame = 0 AND number = 0", "table caster, frame 0, number 0: name is "},
        {"UPDATE run SET settings = '{}'", "settings is "},
    };
    for (const Case& c : cases) {
        fs::remove(again);
        fs::copy_file(file, again);
        change(again, c.sql);
        const auto merged = tools::sweep::merge(sweep, at("r.sqlite"), [](size_t, size_t) {});
        ASSERT_FALSE(merged) << c.sql;
        for (const std::string& word : {c.word, shard.key, shard.label, file.string(), again.string()})
            EXPECT_NE(merged.error().what.find(word), std::string::npos) << c.sql << '\n' << merged.error().what;
        EXPECT_TRUE(fs::exists(file) && fs::exists(again));
    }
    // What is measured, and where it ran, may differ.
    fs::remove(again);
    fs::copy_file(file, again);
    change(again, "UPDATE frame SET t_frame_ms = 1e9; UPDATE run SET machine = 'x', device = 'y', threads = 99, t_wall_s = 5, t_started = ''");
    expect("$gnomon sweep merge s -o r.sqlite", 0, "1 of 1 shards, 1 of them new");
    // Against what was merged before, too.
    fs::remove(again);
    change(file, cases[0].sql);
    expect("$gnomon sweep merge s -o r.sqlite", 3, "r.sqlite");
}

TEST_F(SweepRun, DamagedResultsAreNamedAtEveryLength) {
    putPlan("resolution = 64\n");
    expect("$gnomon sweep plan.toml -o s", 0, "1 done");
    const Sweep sweep = opened();
    const fs::path file = sweep.results(sweep.plan.shards.front());
    fs::copy_file(file, at("whole.sqlite"));
    const auto size = fs::file_size(file);
    for (uintmax_t length = 0; length < size; length += std::max<uintmax_t>(1, length < 200 ? 37 : size / 23)) {
        fs::copy_file(at("whole.sqlite"), file, fs::copy_options::overwrite_existing);
        fs::resize_file(file, length);
        const auto merged = tools::sweep::merge(sweep, at("r.sqlite"), [](size_t, size_t) {});
        ASSERT_FALSE(merged) << length;
        EXPECT_TRUE(merged.error().what.starts_with(file.string() + ": is damaged; take it away")) << length << ": " << merged.error().what;
    }
    fs::remove(file);
    expect("$gnomon sweep resume s && $gnomon sweep merge s -o r.sqlite", 0, "1 of 1 shards, 1 of them new");
    put("foreign.sqlite", "text");
    expect("$gnomon sweep merge s -o foreign.sqlite", 3, "foreign.sqlite: holds no results");
}

}  // namespace
