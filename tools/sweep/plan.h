// tools/sweep/plan.h — a sweep's plan, TOML, as the shards that it asks for: worlds x paths x settings, each one replay.
// docs/cluster.md has every key.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "world/result.h"

namespace tools::sweep {

constexpr size_t kMostShards = 100'000;

/// One replay. Files are absolute; hashes are those of a RunRecord.
struct Shard {
    std::string key;    ///< hash of all that the deterministic results follow from, 16 hexadecimal digits
    std::string label;  ///< for people: "hills.world flight.tum --guard-band=4"
    std::string world, path, movers;  ///< movers: empty for none
    std::string worldHash, pathHash, moversHash;
    std::vector<std::string> options;  ///< of `gnomon replay`, "--NAME=VALUE"
};

struct Plan {
    std::vector<Shard> shards;        ///< in the order of the plan's worlds, then paths, then settings; not empty
    std::vector<std::string> sbatch;  ///< options of its table [slurm], "--NAME=VALUE"
    int throttle = 0;                 ///< most tasks at a time; 0: as many as the cluster gives
};

/// Reads the plan and all that it names; names are relative to the plan's folder. kUsage names file and line, and the
/// nearest known key: what is no TOML, unknown keys, values that no replay takes, a shard that is asked for twice, more
/// than kMostShards. Errors of a world, a path or movers pass through behind the place that names them.
world::Result<Plan> readPlan(const std::string& file);

}  // namespace tools::sweep
