// tests/tools/sweep_plan_test.cpp — plans: what they make, what changes a shard's key, and what is said of bad ones; how
// shards are handed to schedulers.
#include "tools/sweep/plan.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>

#include "tests/tools/sweep_inputs.h"
#include "tools/sweep/manifest.h"
#include "tools/sweep/slurm.h"

namespace {

namespace fs = std::filesystem;
using tools::sweep::Plan;
using tools::sweep::readPlan;

class SweepPlan : public tools_test::SweepInputs {
protected:
    Plan planOf(const std::string& text) const {
        put("plan.toml", text);
        auto plan = readPlan(at("plan.toml"));
        EXPECT_TRUE(plan) << (plan ? "" : plan.error().what);
        return plan ? std::move(plan.value()) : Plan();
    }
    std::string keyOf(const std::string& text) const {
        const Plan plan = planOf(text);
        EXPECT_EQ(plan.shards.size(), 1u) << text;
        return plan.shards.empty() ? "" : plan.shards.front().key;
    }
};

const std::string kOne = "worlds = ['hills.world']\n[[path]]\nfile = 'walk.tum'\n";

TEST_F(SweepPlan, MultipliesWorldsPathsAndSettingsInAStableOrder) {
    ASSERT_TRUE(world::bake(world::test::hillsWorld(2, 16, 2, 5), at("other.world"), {}));
    const std::string text = "worlds = ['hills.world', 'other.world']\n[[path]]\nfile = 'walk.tum'\n[[path]]\nfile = 'walk.tum'\nframes = '1:3'\n"
                             "worlds = ['other.world']\n[[settings]]\nresolution = [64, 128]\nocclusion = ['off', 'exact']\n[[settings]]\n"
                             "spot = [['5,30,5,0,-1,0,35,60', '9,30,5,0,-1,0,35,60'], '5,30,5,0,-1,0,35,60']\n[slurm]\npartition = 'a b'\nthrottle = 7\n";
    const Plan plan = planOf(text), again = planOf(text);
    ASSERT_EQ(plan.shards.size(), 3u * 6);
    std::set<std::string> keys;
    for (size_t k = 0; k < plan.shards.size(); ++k) {
        EXPECT_EQ(plan.shards[k].key, again.shards[k].key);
        EXPECT_EQ(plan.shards[k].key.size(), 16u);
        keys.insert(plan.shards[k].key);
    }
    EXPECT_EQ(keys.size(), plan.shards.size());
    EXPECT_EQ(plan.shards[0].label, "hills.world walk.tum --occlusion=off --resolution=64");
    EXPECT_EQ(plan.shards[1].label, "hills.world walk.tum --occlusion=off --resolution=128");
    EXPECT_EQ(plan.shards[4].options.size(), 2u) << "two spot lights of one shard";
    EXPECT_EQ(plan.shards[5].options.size(), 1u);
    EXPECT_EQ(plan.shards[17].world, at("other.world"));
    EXPECT_EQ(plan.shards[17].options.front(), "--frames=1:3");
    EXPECT_EQ(plan.sbatch, std::vector<std::string>{"--partition=a b"});
    EXPECT_EQ(plan.throttle, 7);
    EXPECT_EQ(planOf(kOne).shards.size(), 1u) << "without settings: those of a replay";
}

TEST_F(SweepPlan, AKeyFollowsFromContentAlone) {
    const std::string key = keyOf(kOne + "[[settings]]\nresolution = 64\nfov = 60\n");
    // Elsewhere, under other names, written in another way.
    fs::create_directories(folder_ / "deep");
    fs::copy_file(at("hills.world"), at("deep/h.world"));
    put("deep/w.tum", "# a comment\n0.0 5 12 5 0 0 0 1\n1 9 12 5 0 0 0 1\n2 13 12 9 0 0 0 1\n3 17 12 13 0 0 0 1\n");
    EXPECT_EQ(keyOf("worlds = ['deep/h.world'] # the same\n[[settings]]\nfov = 60\nresolution = 64\n[[path]]\nfile = 'deep/w.tum'\n"), key);

    ASSERT_TRUE(world::bake(world::test::hillsWorld(2, 16, 2, 5), at("other.world"), {}));
    put("other.tum", "0 5 12 5 0 0 0 1\n1 9 12 5 0 0 0 1\n2 13 12 9 0 0 0 1\n3 17 12 13.0001 0 0 0 1\n");
    put("m.csv", "time,id,node_or_mesh,x,y,z,qx,qy,qz,qw,scale\n0,0,ghost,0,0,0,0,0,0,1,1\n");
    const std::string settings = "[[settings]]\nresolution = 64\nfov = 60\n";
    std::set<std::string> keys{key};
    for (const std::string& other :
         {"worlds = ['other.world']\n[[path]]\nfile = 'walk.tum'\n" + settings, "worlds = ['hills.world']\n[[path]]\nfile = 'other.tum'\n" + settings,
          kOne + "movers = 'm.csv'\n" + settings, kOne + "frames = '0:3'\n" + settings, kOne + "frames = '1:4'\n" + settings, kOne + "fps = 2\n" + settings,
          kOne, kOne + "[[settings]]\nresolution = 64\nfov = 61\n", kOne + "[[settings]]\nresolution = 64\n"})
        EXPECT_TRUE(keys.insert(keyOf(other)).second) << other;

    // The same frames, counted otherwise, are other results.
    put("late.tum", "0 5 12 5 0 0 0 1\n1 9 12 5 0 0 0 1\n2 13 12 9 0 0 0 1\n");
    EXPECT_EQ(keyOf(kOne + "frames = '0:3'\n"), keyOf("worlds = ['hills.world']\n[[path]]\nfile = 'late.tum'\n"));
    put("late.tum", "1 9 12 5 0 0 0 1\n2 13 12 9 0 0 0 1\n3 17 12 13 0 0 0 1\n");
    EXPECT_NE(keyOf(kOne + "frames = '1:4'\n"), keyOf("worlds = ['hills.world']\n[[path]]\nfile = 'late.tum'\n"));
}

TEST_F(SweepPlan, AMethodFileIsItsSettings) {
    put("tuned.toml", "method = 'gnomon'\n[settings]\nside = 128\nguard-band = 2\n");
    put("same.toml", "# tuned\nmethod = 'gnomon'\n[settings]\nguard-band = 2\nside = 128\n");
    put("other.toml", "method = 'gnomon'\n[settings]\nside = 128\nguard-band = 4\n");
    const std::string key = keyOf(kOne + "[[settings]]\nconfig = 'tuned.toml'\n");
    EXPECT_EQ(keyOf(kOne + "[[settings]]\nconfig = 'same.toml'\n"), key);
    EXPECT_EQ(keyOf(kOne + "[[settings]]\nconfig = 'gnomon:side=128:guard-band=2'\n"), key);
    EXPECT_NE(keyOf(kOne + "[[settings]]\nconfig = 'other.toml'\n"), key);
}

TEST_F(SweepPlan, BadPlansAreToldByTheirLine) {
    put("gone.toml", "method = 'gnomn'\n");
    put("broken.tum", "0 5 12 5 0 0 0 1\n1 x 12 5 0 0 0 1\n");
    put("broken.world", "no world");
    const std::string path = "[[path]]\nfile = 'walk.tum'\n", worlds = "worlds = ['hills.world']\n";
    struct Case {
        std::string plan, place, word;
    };
    const Case cases[] = {
        {"", ":1: ", "names no world"},
        {"worlds = [", ":1: ", ""},
        {"worlds = ['hills.world']\nworlds = ['hills.world']\n" + path, ":2: ", "worlds"},
        {worlds, ":1: ", "names no path"},
        {"worlds = []\n" + path, ":1: ", "worlds"},
        {"worlds = 'hills.world'\n" + path, ":1: ", "worlds"},
        {"worlds = [7]\n" + path, ":1: ", "worlds"},
        {"\nworlds = ['missing.world']\n" + path, ":2: ", "missing.world"},
        {"\nworlds = ['broken.world']\n" + path, ":2: ", "broken.world"},
        {"world = ['hills.world']\n" + path, ":1: ", "nearest is 'worlds'"},
        {worlds + "path = 'walk.tum'\n", ":2: ", "[[path]]"},
        {worlds + "path = []\n", ":2: ", "[[path]]"},
        {worlds + "[[path]]\nfps = 3\n", ":2: ", "no file"},
        {worlds + "[[path]]\nfile = ''\n", ":3: ", "file"},
        {worlds + "[[path]]\nfile = 'missing.tum'\n", ":2: ", "missing.tum"},
        {worlds + "[[path]]\nfile = 'broken.tum'\n", ":2: ", "broken.tum:2"},
        {worlds + path + "frame = '0:2'\n", ":4: ", "nearest is 'frames'"},
        {worlds + path + "frames = '2:1'\n", ":2: ", "2:1"},
        {worlds + path + "frames = '0:9'\n", ":2: ", "--frames"},
        {worlds + path + "fps = nan\n", ":4: ", "fps"},
        {worlds + path + "fps = 1e300\n", ":2: ", "fps"},
        {worlds + path + "fps = 0\n", ":4: ", "fps"},
        {worlds + path + "movers = 'missing.csv'\n", ":2: ", "missing.csv"},
        {worlds + path + "worlds = ['other.world']\n", ":4: ", "none of the plan's worlds"},
        {worlds + path + "[[settings]]\nresolutoin = 64\n", ":5: ", "nearest is 'resolution'"},
        {worlds + path + "[[settings]]\nresults = 'x'\n", ":5: ", "no key 'results'"},
        {worlds + path + "[[settings]]\nthreads = 2\n", ":5: ", "no key 'threads'"},
        {worlds + path + "[[settings]]\nfov = 60\ndepth = 24\n", ":6: ", "24"},
        {worlds + path + "[[settings]]\nfov = 60\nresolution = 'big'\n", ":6: ", "big"},
        {worlds + path + "[[settings]]\nresolution = []\n", ":5: ", "empty"},
        {worlds + path + "[[settings]]\nspot = [[]]\n", ":5: ", "empty"},
        {worlds + path + "[[settings]]\nresolution = {a = 1}\n", ":5: ", "no value"},
        {worlds + path + "[[settings]]\nresolution = 64\nconfig = 'gnomon'\n", ":4: ", "config"},
        {worlds + path + "[[settings]]\nconfig = 'missing.toml'\n", ":5: ", "missing.toml"},
        {worlds + path + "[[settings]]\nconfig = 'gone.toml'\n", ":5: ", "gone.toml"},
        {worlds + path + "[[settings]]\nconfig = 'engel'\n", ":5: ", "keeps no cache"},
        {worlds + path + "[[settings]]\nclock = 'live'\n", ":5: ", "clock"},
        {worlds + path + "[[settings]]\nbudget-ms = 3\n", ":5: ", "budget-triangles"},
        {worlds + path + "[settings]\nresolution = 64\n", ":4: ", "[[settings]]"},
        {worlds + path + "[[settings]]\nresolution = [64, 64]\n", ":4: ", "asked for twice"},
        {"worlds = ['hills.world', 'hills.world']\n" + path, ":1: ", "asked for twice"},
        {worlds + path + path, ":1: ", "lines 2 and"},
        {worlds + path + "[slurm]\npartitoin = 'p'\n", ":5: ", "nearest is 'partition'"},
        {worlds + path + "[slurm]\narray = '0-3'\n", ":5: ", "no key 'array'"},
        {worlds + path + "[slurm]\nthrottle = 0\n", ":5: ", "throttle"},
        {"slurm = 3\n" + worlds + path, ":1: ", "[slurm]"},
    };
    for (const Case& c : cases) {
        put("plan.toml", c.plan);
        const auto plan = readPlan(at("plan.toml"));
        ASSERT_FALSE(plan) << c.plan;
        EXPECT_TRUE(plan.error().what.starts_with(at("plan.toml") + c.place)) << c.plan << plan.error().what;
        EXPECT_NE(plan.error().what.find(c.word), std::string::npos) << c.plan << plan.error().what;
        EXPECT_EQ(plan.error().what.find('\n'), std::string::npos) << plan.error().what;
    }
    for (const std::string& name : {std::string("missing.toml"), std::string(".")}) {
        const auto plan = readPlan(at(name));
        ASSERT_FALSE(plan);
        EXPECT_EQ(plan.error().code, world::ErrorCode::kNotFound);
    }
}

TEST_F(SweepPlan, AbsurdSizesAreRefusedBeforeTheyAreMade) {
    std::string many;
    for (int k = 1; k <= 400; ++k) many += std::to_string(k) + ",";
    const std::string settings = "[[settings]]\nbudget-texels = [" + many + "]\nbudget-triangles = [" + many + "]\n";
    put("plan.toml", kOne + settings);
    auto plan = readPlan(at("plan.toml"));
    ASSERT_FALSE(plan);
    EXPECT_NE(plan.error().what.find("more than 100000 shards"), std::string::npos) << plan.error().what;
    // Each table may be small.
    std::string paths;
    for (int k = 0; k < 400; ++k) paths += "[[path]]\nfile = 'walk.tum'\nfps = " + std::to_string(k + 1) + "\n";
    put("plan.toml", "worlds = ['hills.world']\n" + paths + "[[settings]]\nbudget-texels = [" + many + "]\n");
    plan = readPlan(at("plan.toml"));
    ASSERT_FALSE(plan);
    EXPECT_NE(plan.error().what.find("160000 shards"), std::string::npos) << plan.error().what;
}

TEST(SweepSlurm, NamesTasksInRanges) {
    EXPECT_EQ(tools::sweep::ranges({0}), "0");
    EXPECT_EQ(tools::sweep::ranges({0, 1, 2, 5, 7, 8}), "0-2,5,7-8");
}

TEST_F(SweepPlan, AManifestHasAllThatAnIndexedJobNeeds) {
    const auto sweep = tools::sweep::makeSweep(at("it's a sweep"), planOf(kOne + "[[settings]]\nresolution = [64, 128, 256]\n"), false);
    ASSERT_TRUE(sweep);
    const auto text = manifest(sweep.value(), {"registry/gnomon:1", "worlds", folder_.string(), 2});
    ASSERT_TRUE(text) << text.error().what;
    const auto job = nlohmann::json::parse(text.value());
    EXPECT_EQ(job["kind"], "Job");
    EXPECT_EQ(job["spec"]["completionMode"], "Indexed");
    EXPECT_EQ(job["spec"]["completions"], 3);
    EXPECT_EQ(job["spec"]["backoffLimitPerIndex"], 3);
    const auto& pod = job["spec"]["template"]["spec"];
    EXPECT_EQ(pod["restartPolicy"], "Never") << "what backoffLimitPerIndex wants";
    EXPECT_EQ(pod["containers"][0]["command"][3], at("it's a sweep"));
    EXPECT_NE(pod["containers"][0]["command"][2].get<std::string>().find("$JOB_COMPLETION_INDEX"), std::string::npos);
    EXPECT_EQ(pod["containers"][0]["volumeMounts"][0]["mountPath"], folder_.string());
    EXPECT_EQ(pod["volumes"][0]["persistentVolumeClaim"]["claimName"], "worlds");
    const auto outside = manifest(sweep.value(), {"i", "c", at("it's a sweep"), 1});
    ASSERT_FALSE(outside);
    EXPECT_NE(outside.error().what.find("hills.world"), std::string::npos) << outside.error().what;
}

}  // namespace
