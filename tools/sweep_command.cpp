#include "tools/sweep_command.h"

#include <unistd.h>

#include <CLI/CLI.hpp>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <iostream>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "tools/output_folder.h"
#include "tools/progress.h"
#include "tools/sweep/manifest.h"
#include "tools/sweep/merge.h"
#include "tools/sweep/shard_run.h"
#include "tools/sweep/slurm.h"
#include "tools/sweep/workers.h"

namespace tools {
namespace {

using sweep::State;
using sweep::Status;
using sweep::Sweep;
using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

struct SweepOptions {
    std::string plan, folder;  ///< of the sweep
    std::string output;        ///< merged results, or the manifest
    bool slurm = false, here = false;
    int jobs = 0, threads = 0;  ///< 0: by the cores
    size_t shard = 0;
    sweep::Cluster cluster;
};

/// Numbers of the shards that nobody has done or is at.
std::vector<size_t> open(const std::vector<Status>& status) {
    std::vector<size_t> numbers;
    for (size_t k = 0; k < status.size(); ++k)
        if (status[k].state == State::kFailed || status[k].state == State::kLost) numbers.push_back(k);
    return numbers;
}

/// A line of counts, then one for each shard that failed or is lost.
std::string toText(const Sweep& sweep, const std::vector<Status>& status) {
    std::array<size_t, 5> counts{};
    for (const Status& s : status) ++counts[size_t(s.state)];
    std::string text = std::to_string(status.size()) + " shards:";
    for (size_t k = 0; k < counts.size(); ++k)
        text += (k == 0 ? " " : ", ") + std::to_string(counts[k]) + " " + sweep::toString(State(k));
    text += '\n';
    for (const size_t k : open(status)) {
        const sweep::Shard& shard = sweep.plan.shards[k];
        text += std::string(sweep::toString(status[k].state)) + " " + std::to_string(k) + ", " + shard.key + ": " + shard.label;
        if (status[k].state == State::kFailed) text += ": " + status[k].why + "; see " + sweep.log(shard).string();
        text += '\n';
    }
    return text;
}

/// What is there once children or Slurm have what there is to do. Status 1 unless all is done.
Result<int> tell(const Sweep& sweep, std::vector<Status> status) {
    std::cout << toText(sweep, status);
    return std::all_of(status.begin(), status.end(), [](const Status& s) { return s.state == State::kDone; }) ? 0 : 1;
}

/// Runs what is open of a sweep, here or by Slurm.
Result<int> goOn(const Sweep& sweep, bool slurm, int jobs) {
    if (const auto ours = sweep.requireProgram(); !ours) return ours.error();
    const auto asked = askQueue(sweep);
    if (!asked && slurm) return asked.error();
    if (!asked) std::cerr << "gnomon: " << asked.error().what << "; what is queued may now run twice\n";
    const sweep::Queue queue = asked ? asked.value() : sweep::Queue();
    auto status = sweep.status(queue);
    if (!status) return status.error();
    const std::vector<size_t> numbers = open(status.value());
    if (slurm) {
        const auto ids = submit(sweep, numbers);
        if (!ids) return ids.error();
        std::cout << numbers.size() << " shards of " << status.value().size() << " are in Slurm's hands";
        for (const std::string& id : ids.value()) std::cout << ", job " << id;
        std::cout << "; gnomon sweep status " << sweep.folder.string() << " tells how far they are\n";
        return 0;
    }
    sweep.tidy();
    const auto whole = runHere(sweep, numbers, jobs);
    if (!whole) return whole.error();
    if (status = sweep.status(queue); !status) return status.error();
    if (!whole.value()) std::cout << "interrupted; gnomon sweep resume " << sweep.folder.string() << " goes on\n";
    return tell(sweep, std::move(status.value()));
}

/// Becomes `gnomon sweep resume`. Reading a plan has left threads, and any of them might take the signals that `runHere` waits
/// for: a new process has none.
Error becomeResume(const Sweep& sweep, int jobs) {
    const std::string folder = sweep.folder.string(), count = std::to_string(jobs);
    std::vector<const char*> words = {"gnomon", "sweep", "resume", folder.c_str(), "--here"};
    if (jobs > 0) words.insert(words.end(), {"--jobs", count.c_str()});
    words.push_back(nullptr);
    std::cout.flush();
    execv("/proc/self/exe", const_cast<char* const*>(words.data()));
    return {ErrorCode::kLimit, std::string("the program cannot be started again: ") + std::strerror(errno) + "; give gnomon sweep resume " + folder, errno};
}

Result<int> runSweep(const SweepOptions& options) {
    if (options.plan.empty() || options.folder.empty())
        return Error{ErrorCode::kUsage, "sweep: give a plan and a folder for it, gnomon sweep PLAN.toml -o FOLDER, or one of run, status, resume, merge, manifest"};
    auto plan = sweep::readPlan(options.plan);
    if (!plan) return plan.error();
    const auto made = sweep::makeSweep(options.folder, std::move(plan.value()), options.slurm);
    if (!made) return made.error();
    return options.slurm ? goOn(made.value(), true, 0) : becomeResume(made.value(), options.jobs);
}

Result<int> runResume(const SweepOptions& options) {
    const auto found = sweep::openSweep(options.folder);
    if (!found) return found.error();
    return goOn(found.value(), options.slurm || (found.value().slurm && !options.here), options.jobs);
}

Result<int> runStatus(const SweepOptions& options) {
    const auto found = sweep::openSweep(options.folder);
    if (!found) return found.error();
    const auto queue = askQueue(found.value());
    if (!queue) std::cerr << "gnomon: " << queue.error().what << "; what is called lost may be queued\n";
    auto status = found.value().status(queue ? queue.value() : sweep::Queue());
    if (!status) return status.error();
    return tell(found.value(), std::move(status.value()));
}

Result<int> runOne(const SweepOptions& options) {
    const auto found = sweep::openSweep(options.folder);
    if (!found) return found.error();
    if (const auto done = runShard(found.value(), options.shard, options.threads); !done) return done.error();
    return 0;
}

Result<int> runMerge(const SweepOptions& options) {
    const auto found = sweep::openSweep(options.folder);
    if (!found) return found.error();
    const size_t shards = found.value().plan.shards.size();
    std::optional<Progress> progress;
    const double start = steadySeconds();
    const auto merged = sweep::merge(found.value(), options.output, [&](size_t done, size_t total) {
        if (!progress && steadySeconds() < start + 1) return;  // done before anybody looks
        if (!progress) progress.emplace("merge", std::cerr, stderrIsTerminal());
        progress->at(done, total);
    });
    progress.reset();
    if (!merged) return merged.error();
    std::cout << options.output << ": " << merged.value().there << " of " << shards << " shards, " << merged.value().added << " of them new\n";
    if (merged.value().there == shards) return 0;
    std::cout << "the others have no results; gnomon sweep status " << options.folder << " tells why\n";
    return 1;
}

Result<int> runManifest(const SweepOptions& options) {
    const auto found = sweep::openSweep(options.folder);
    if (!found) return found.error();
    sweep::Cluster cluster = options.cluster;
    if (cluster.mount.empty()) cluster.mount = found.value().folder.parent_path().string();
    const auto text = manifest(found.value(), cluster);
    if (!text) return text.error();
    if (const auto done = writeText(options.output, text.value()); !done) return done.error();
    std::cout << options.output << ": a Job of " << found.value().plan.shards.size() << " completions; kubectl apply -f gives it to Kubernetes\n";
    return 0;
}

}  // namespace

Command addSweepCommand(CLI::App& app) {
    const auto options = std::make_shared<SweepOptions>();
    CLI::App* parser = app.add_subcommand("sweep", "Run many replays, here or on a cluster: worlds x paths x settings of a plan");
    parser->add_option("plan", options->plan, "the plan, TOML; docs/cluster.md has its keys");
    parser->add_option("-o,--output", options->folder, "folder of the sweep; one that was interrupted goes on");
    const auto jobs = [&](CLI::App* command) {
        command->add_option("--jobs", options->jobs, "shards at a time on this machine; a core each by default")->check(CLI::Range(1, 4096));
        return command->add_flag("--slurm", options->slurm, "hand the shards to Slurm, as a job array");
    };
    jobs(parser);
    const auto add = [&](const char* name, const char* what) {
        CLI::App* command = parser->add_subcommand(name, what);
        command->add_option("folder", options->folder, "of the sweep")->required();
        return command;
    };
    CLI::App* resume = add("resume", "Run what failed or was lost");
    CLI::Option* slurm = jobs(resume);
    resume->add_flag("--here", options->here, "on this machine, though the sweep was Slurm's")->excludes(slurm);
    CLI::App* status = add("status", "Say what is done, running, queued, failed or lost");
    CLI::App* merge = add("merge", "Put the results of all shards into one results file");
    merge->add_option("-o,--output", options->output, "the results file; runs in it stay")->required();
    CLI::App* run = add("run", "Run one shard: what Slurm and Kubernetes do");
    run->add_option("--shard", options->shard, "its number, from 0")->required();
    run->add_option("--threads", options->threads, "threads to use; all by default")->check(CLI::Range(0, 4096));
    CLI::App* manifest = add("manifest", "Write the sweep as an Indexed Job of Kubernetes");
    manifest->add_option("-o,--output", options->output, "the manifest, JSON")->required();
    manifest->add_option("--image", options->cluster.image, "image that holds this very program")->required();
    manifest->add_option("--claim", options->cluster.claim, "PersistentVolumeClaim with the sweep's folder and its inputs")->required();
    manifest->add_option("--mount", options->cluster.mount, "where pods see it; the folder that the sweep's folder is in by default");
    manifest->add_option("--threads", options->cluster.threads, "of a shard; 1 by default")->check(CLI::Range(1, 4096));
    parser->require_subcommand(0, 1);
    return {parser, [=] {
                if (resume->parsed()) return runResume(*options);
                if (status->parsed()) return runStatus(*options);
                if (merge->parsed()) return runMerge(*options);
                if (run->parsed()) return runOne(*options);
                if (manifest->parsed()) return runManifest(*options);
                return runSweep(*options);
            }};
}

}  // namespace tools
