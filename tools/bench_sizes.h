// tools/bench_sizes.h — does a frame cost more in a larger world? The built-in world at one density and
// several sizes, driven along the same line.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "world/path.h"
#include "world/procedural.h"
#include "world/result.h"

namespace tools {

/// "1e4,100000" as counts of instances, each a whole number from 1 to 10,000,000. kUsage names --sizes.
world::Result<std::vector<uint32_t>> parseSizes(const std::string& text);

/// The built-in world of so many instances at its default density; small ones are 1024 m wide, and denser.
world::ProceduralOptions sizedWorld(uint32_t instances);
/// 300 m along x through the world's middle 1.7 m above its ground. The ground there is the same
/// in worlds of any size; the road and its villages, which are not, keep 300 m away.
std::vector<world::Pose> middleTrack(const world::ProceduralOptions& options);

/// Bakes the worlds that `folder` does not have yet (as procedural-7-N.world, with the built-in path beside
/// it), drives each three times in turns, and prints a row for each and the ratio of the slowest to the
/// fastest. Each size runs in a process of its own, so its memory is its own. To be called before anything
/// starts a thread.
///   frames  most frames of a drive, > 0
world::Result<world::Done> benchSizes(const std::vector<uint32_t>& sizes, const std::string& folder,
                                      size_t frames);

}  // namespace tools
