// tools/sweep/folder.h — a sweep on disk: what its shards are, which are done, and where each leaves what it has to say.
// All processes of a sweep, on all machines, meet in this folder alone; docs/cluster.md describes it.
#pragma once

#include <cstddef>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "tools/sweep/plan.h"
#include "world/result.h"

namespace tools::sweep {

enum class State {
    kDone,     ///< its results are there
    kRunning,  ///< a process is at it
    kQueued,   ///< Slurm will begin it
    kFailed,   ///< it ended with an error
    kLost,     ///< no results, and nobody is at it: killed, or not begun yet
};
const char* toString(State state);

struct Status {
    State state = State::kLost;
    std::string why;  ///< of kFailed
};

/// What a scheduler has of a sweep: kQueued or kRunning by the shard's number.
using Queue = std::map<size_t, State>;

/// A job array that was handed to Slurm: its task `t` is shard `base + t`.
struct Job {
    std::string id;
    size_t base = 0;
};

/// A value. Its functions look at the disk each time that they are called.
struct Sweep {
    std::filesystem::path folder;  ///< absolute
    std::string program;           ///< hash of the program that made it: only that one runs its shards
    bool slurm = false;            ///< how it was begun; else on one machine
    Plan plan;

    std::filesystem::path results(const Shard& shard) const { return folder / "shards" / (shard.key + ".sqlite"); }
    std::filesystem::path failure(const Shard& shard) const { return folder / "shards" / (shard.key + ".failed"); }
    std::filesystem::path log(const Shard& shard) const { return folder / "logs" / (shard.key + ".log"); }
    /// kUsage unless this is the program that made the sweep.
    world::Result<world::Done> requireProgram() const;
    bool done(const Shard& shard) const;
    /// Results of a shard that ran several times, the first ones first.
    std::vector<std::filesystem::path> allResults(const Shard& shard) const;

    /// Of each shard, by the folder and, where that has no results, by the queue.
    world::Result<std::vector<Status>> status(const Queue& queue) const;
    world::Result<world::Done> addJob(const Job& job) const;
    /// All that were handed to Slurm, the first one first.
    std::vector<Job> jobs() const;
    /// Removes what processes that died have left of shards.
    void tidy() const;
};

/// Makes the folder, or finds the same sweep in it, which then goes on. kUsage where it holds another one; kIo.
world::Result<Sweep> makeSweep(const std::string& folder, Plan plan, bool slurm);

/// kNotFound; kBadData for what is no sweep's folder.
world::Result<Sweep> openSweep(const std::string& folder);

/// A shard under way: a folder of its own for what is not whole yet, locked for as long as the process lives.
class Attempt {
public:
    static world::Result<Attempt> begin(const Sweep& sweep, const Shard& shard);
    std::filesystem::path results() const { return partial_->folder / "results.sqlite"; }
    std::filesystem::path scratch() const { return partial_->folder / "replay"; }
    /// Gives the results their name, on the disk for good. Those of an earlier attempt stay what they are, and these
    /// get a name beside them.
    world::Result<world::Done> publish() const;

private:
    struct Partial {
        std::filesystem::path folder, shards;
        std::string key;
        int lock = -1;
        ~Partial();
    };
    explicit Attempt(std::unique_ptr<Partial> partial) : partial_(std::move(partial)) {}
    std::unique_ptr<Partial> partial_;
};

}  // namespace tools::sweep
