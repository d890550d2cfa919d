// tools/stress.h — puts a streamer through cases and judges what came of it.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "gpu/device.h"
#include "tools/replay.h"
#include "tools/stress_case.h"
#include "tools/summary.h"
#include "world/store.h"

namespace tools {

/// What a case showed. Everything but `times` is deterministic, unless the clock is live.
struct StressResult {
    std::string name, what;
    Summary summary;               ///< of all frames, as of a replay, the rest before and after included
    // Of the frames in which the eye moves:
    uint64_t frames = 0;
    uint64_t lackingFrames = 0;    ///< in which a map lacks a chunk, or has it too coarsely
    uint64_t missingTexels = 0, coarseTexels = 0;  ///< summed, as of a replay
    uint64_t unknownTexels = 0, staleTexels = 0, oldestDebt = 0;  ///< likewise, and [frames]
    double longestLack = 0;        ///< [s]
    uint64_t mostArrivals = 0;     ///< chunks taken up in a frame
    uint64_t mostRays = 0;         ///< asked in a frame
    uint64_t edits = 0;            ///< of the ground
    std::vector<double> frameMs;
    uint64_t windowTexels = 0;     ///< of all cascades together
    uint64_t comparedTexels = 0;   ///< with the maps of a system that has everything in memory
    uint64_t holes = 0;            ///< of these, answer wrongly for some point in reach
    uint64_t silentHoles = 0;      ///< of these, are not said to be stale, unknown, missing or coarse
    uint64_t worstHoles = 0;       ///< of a frame
    uint64_t restingHoles = 0;     ///< differ after the rest
    uint64_t memoryBudget = 0, geometryBudget = 0;  ///< bytes
    server::ShadowConfig config;        ///< as the system took it
    std::vector<double> texels, splits; ///< per cascade [m]
    std::vector<std::string> failures;  ///< promises that were not kept; empty: passed
};

/// Called with each finished frame of a case.
using StressFrame = std::function<world::Result<world::Done>(const ReplayFrame&)>;

/// What the lock-step run of a case's first camera holds at most: what "the memory that it needs" means.
struct StressNeed {
    uint64_t memory = 0, geometry = 0;  ///< bytes
};
world::Result<StressNeed> measureNeed(gpu::Device& device, const world::WorldStore& store, const StressCase& c);

/// Plays one case. Every `compareEvery` frames and at the end its maps are held against those of a second system that
/// waits for every chunk. Errors of the systems pass through, with the case's name.
world::Result<StressResult> runStress(gpu::Device& device, const world::WorldStore& store, const StressCase& c,
                                      const StressNeed& need, uint64_t compareEvery, const StressFrame& onFrame);

/// One line per case, and why those failed that did.
std::string stressTable(const std::vector<StressResult>& results);
/// An SVG for results of prefetchCases, in their order: bytes read against wrong texels, a line for each speed.
std::string prefetchChart(const std::vector<StressResult>& results);
/// stress.json: verdicts and sums; times are in a member "times" of each case.
std::string stressJson(const std::vector<StressResult>& results, const std::string& world, uint64_t seed);

}  // namespace tools
