// tools/bench_streaming.h — the streamer's throughput beside a bare loop of read, verify and decode.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tools/bench_report.h"
#include "world/store.h"

namespace tools {

/// Both read every chunk and mesh of a world once, with as many threads.
struct StreamingCost {
    size_t chunks = 0, meshes = 0;
    uint64_t bytes = 0;                         ///< decoded
    std::vector<double> bareMs, streamerMs;     ///< in turns
};

/// Errors of the store; kBadData where the streamer could not bring everything.
world::Result<StreamingCost> measureStreaming(const world::WorldStore& store, int rounds);

std::string streamingText(const StreamingCost& cost);
/// 0.7 of the bare loop.
Goal streamingGoal(const StreamingCost& cost);

}  // namespace tools
