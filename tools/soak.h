// tools/soak.h — seeded mixed life for a ShadowSystem: everything that a world does to its shadow maps,
// long enough for what leaks or drifts to show.
#pragma once

#include <cstdint>
#include <functional>

#include "server/shadow_system.h"
#include "world/store.h"

namespace tools {

struct SoakConfig {
    uint64_t frames = 100000;
    uint64_t verifyEvery = 100;  ///< frames between comparisons with maps drawn from scratch, > 0
    uint32_t seed = 1;
    uint32_t objects = 60;  ///< most that live at once
};

/// Counters are deterministic: equal for equal seeds and worlds. Memory is not.
struct SoakReport {
    uint64_t frames = 0, verified = 0;
    uint64_t texels = 0, stale = 0, differing = 0;  ///< compared, left out as owed, different
    uint64_t spawns = 0, removals = 0, moves = 0, jumps = 0;
    uint64_t reconfigurations = 0, lightChanges = 0;  ///< spot lights added, moved, removed
    uint64_t edits = 0;  ///< of the terrain, where the world has some
    uint64_t chunkArrivals = 0, chunkDepartures = 0;
    uint64_t sunSteps = 0, sunRedraws = 0;  ///< of a moving sun
    uint64_t limitedFrames = 0, sleepers = 0;  ///< frames with a budget; cascades asleep, over all frames
    uint64_t unknownTexels = 0;   ///< summed over all frames
    uint64_t planHash = 0;        ///< chained over the frames
    /// Resident memory on the frames that were compared: the median of each half, and the most of all. A life changes the
    /// size of its maps, so its most says little of whether it grows.
    uint64_t firstHalfBytes = 0, lastHalfBytes = 0, mostBytes = 0;
    /// What of it the world asks for, likewise: chunks, edited terrain and geometry. Edits make surface, so this may grow.
    uint64_t firstHalfContent = 0, lastHalfContent = 0;
    std::vector<server::Difference> first;           ///< of the first comparison that differed
};

/// Walks, turns, stands and jumps a camera around the middle of the world; spawns, moves, rests and
/// removes objects; now and then limits the budget, looks into the sky, changes the maps' settings or a spot
/// light, digs or fills; compares all maps every `verifyEvery` frames and ends at the first difference. Errors of the system pass through with the
/// frame's number; errors of items are errors here, since no item is bad.
///   onFrame  called after each frame, with where the camera is [m]; can end the life with an error
using SoakFrame = std::function<world::Result<world::Done>(const server::FrameReport&, const glm::dvec3& eye)>;
world::Result<SoakReport> soak(server::ShadowSystem& system, const world::WorldStore& store, const SoakConfig& config,
                               const SoakFrame& onFrame);

}  // namespace tools
