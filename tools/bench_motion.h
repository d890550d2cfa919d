// tools/bench_motion.h — the motions that a benchmark measures, made alike from any camera path.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "world/path.h"
#include "world/result.h"
#include "world/store.h"

namespace tools {

constexpr double kBenchFps = 30;

/// What the camera and moving objects do, frame by frame.
struct Motion {
    std::string name;
    std::vector<world::Pose> poses;  ///< one a frame, 1 / kBenchFps apart, times from 0
    uint32_t movers = 0;             ///< objects that move in every frame
};

/// The longest stretch [m] of a path on which the camera travels: from 3 to 100 m/s between poses, or, in a
/// path that is never so fast, below 100 m/s. What is faster is a jump. kUsage for a path without a metre.
world::Result<std::vector<world::Pose>> travelled(std::span<const world::Pose> path);

/// The camera at `speed` [m/s] along a track: as many frames as fit and at most `frames`, which is > 0.
/// Positions are linear between the track's poses, so that the speed along them is exact.
std::vector<world::Pose> follow(std::span<const world::Pose> track, double speed, size_t frames);

/// Along the track from its first pose: 10 s at 1.5 m/s, 30 s at 15 m/s; at its first pose: 6 s at 210
/// degrees a second, 10 s without moving, the same among 200 movers. Each at most `frames` frames, > 0.
std::vector<Motion> benchMotions(std::span<const world::Pose> track, size_t frames);

/// The mesh that movers have: its diagonal is the nearest to 5 m, a car's. None in a world of terrain alone.
std::optional<uint32_t> moverMesh(const world::WorldStore& store);
/// A mover on its circle of 4 m, at 5 m/s, centred 6 to 60 m from `eye` and 1.7 m below it; seeded.
world::Placement moverAt(uint32_t mover, glm::dvec3 eye, double time);

}  // namespace tools
