// tools/bench_culling.h — what the queries behind a plan cost on their own: no GPU, no certificates.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "tools/bench_motion.h"
#include "world/result.h"
#include "world/store.h"

namespace tools {

/// One stage over all frames of a motion. All but the time is deterministic.
struct CullingStage {
    std::string name;
    uint64_t queries = 0;
    uint64_t castersTested = 0, castersFound = 0;  ///< tested one by one, after the octree
    uint64_t clustersTested = 0, clustersFound = 0;
    double ms = 0;  ///< processor time of one thread: the least of several rounds
};

struct CullingCost {
    std::string motion;
    size_t frames = 0;
    uint64_t planHash = 0;      ///< over the plans of all frames
    std::vector<CullingStage> stages;
};

struct CullingBench {
    size_t chunks = 0, casters = 0, clusters = 0;  ///< in memory
    double wantedUs = 0;   ///< to find that all chunks that are wanted are there [us]
    std::vector<CullingCost> costs;
};

/// Brings the chunks around all motions into memory and plans them frame by frame, as a ShadowSystem with its
/// defaults would, then repeats each stage of those plans on its own.
///   rounds  > 0
world::Result<CullingBench> benchCulling(const world::WorldStore& store, std::span<const Motion> motions, int rounds);
std::string cullingTable(const CullingBench& bench);

}  // namespace tools
