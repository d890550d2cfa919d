#include "tools/sweep/shard_run.h"

#include <fcntl.h>
#include <unistd.h>

#include <CLI/CLI.hpp>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <iostream>

#include "tools/output_folder.h"
#include "tools/replay_command.h"
#include "tools/report/run_file.h"

namespace tools::sweep {
namespace {

using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

Result<Done> speakTo(const std::string& log) {
    const int file = open(log.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
    if (file < 0 || dup2(file, STDOUT_FILENO) < 0 || dup2(file, STDERR_FILENO) < 0)
        return Error{ErrorCode::kIo, log + ": " + std::strerror(errno) + "; a sweep needs a folder that can be written, with room", errno};
    close(file);
    return Done{};
}

Result<Done> replay(const Shard& shard, const Attempt& attempt, int threads) {
    std::vector<std::string> words = {"gnomon", "replay", shard.world, "--path=" + shard.path, "--results=" + attempt.results().string(),
                                      "--out=" + attempt.scratch().string()};
    if (!shard.movers.empty()) words.push_back("--movers=" + shard.movers);
    if (threads > 0) words.push_back("--threads=" + std::to_string(threads));
    words.insert(words.end(), shard.options.begin(), shard.options.end());
    std::vector<const char*> arguments;
    for (const std::string& word : words) arguments.push_back(word.c_str());
    CLI::App app;
    const Command command = addReplayCommand(app);
    try {
        app.parse(int(arguments.size()), arguments.data());
    } catch (const CLI::Error& error) {
        return Error{ErrorCode::kBadData, std::string("sweep.json: ") + error.what() + "; make the sweep anew"};
    }
    const auto status = command.run();
    if (!status) return status.error();
    if (status.value() != 0) return Error{ErrorCode::kBadData, "maps differ from their redraw; the log names the texels"};
    return Done{};
}

/// Whether what was played is what the key was made of.
Result<Done> requireInput(const Shard& shard, const Attempt& attempt) {
    const auto run = report::RunFile::open(attempt.results().string());
    if (!run) return run.error();
    const RunRecord& record = run.value().record();
    const std::pair<const std::string*, bool> files[] = {{&shard.world, record.worldHash == shard.worldHash},
                                                         {&shard.path, record.pathHash == shard.pathHash},
                                                         {&shard.movers, record.moversHash == shard.moversHash}};
    for (const auto& [file, same] : files)
        if (!same) return Error{ErrorCode::kBadData, *file + ": has changed since the sweep was made; make it anew in another folder"};
    return Done{};
}

Result<Done> run(const Sweep& sweep, const Shard& shard, int threads) {
    const auto attempt = Attempt::begin(sweep, shard);
    if (!attempt) return attempt.error();
    if (const auto done = replay(shard, attempt.value(), threads); !done) return done;
    if (const auto done = requireInput(shard, attempt.value()); !done) return done;
    return attempt.value().publish();
}

}  // namespace

Result<Done> runShard(const Sweep& sweep, size_t index, int threads) {
    if (index >= sweep.plan.shards.size())
        return Error{ErrorCode::kUsage, "--shard " + std::to_string(index) + ": the sweep has shards 0 to " + std::to_string(sweep.plan.shards.size() - 1)};
    if (const auto ours = sweep.requireProgram(); !ours) return ours;
    const Shard& shard = sweep.plan.shards[index];
    if (sweep.done(shard)) return Done{};
    if (const auto done = speakTo(sweep.log(shard)); !done) return done;
    std::cout << "shard " << index << ", " << shard.key << ": " << shard.label << std::endl;
    std::error_code ignored;
    std::filesystem::remove(sweep.failure(shard), ignored);
    // The driver's threads count as well: shards side by side share the cores.
    if (threads > 0) setenv("LP_NUM_THREADS", std::to_string(threads).c_str(), 0);
    auto done = run(sweep, shard, threads);
    // Where not even this can be written, the shard counts as lost, which comes to the same.
    if (!done) (void)writeText(sweep.failure(shard).string(), done.error().what + "\n");
    return done;
}

}  // namespace tools::sweep
