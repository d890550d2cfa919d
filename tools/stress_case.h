// tools/stress_case.h — the named cases that a streamer is put through: a way for the eye, a disk, a budget.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "server/shadow_system.h"
#include "world/path.h"
#include "world/store.h"
#include "world/terrain_edit.h"

namespace tools {

struct StressCase {
    std::string name, what;          ///< a word; a line for people
    std::vector<world::Pose> poses;  ///< 30 a second: at rest, moving, at rest
    std::vector<std::vector<world::Pose>> others;  ///< the same of each further camera
    size_t start = 0, end = 0;       ///< those from `start` to before `end` move
    server::ShadowConfig config;
    std::vector<std::pair<size_t, world::TerrainEdit>> edits;  ///< frames after which the ground is edited, ascending
    double memoryShare = 0;     ///< of what the first camera alone needs; 0: plenty
    double mostShare = 0;       ///< of the same: what may be held at most; 0: up to the budget
    bool needs() const { return memoryShare > 0 || mostShare > 0; }  ///< that need must be known
    bool mayLack = false;       ///< texels may be wrong while the eye moves; they must be known to be
    bool losesChunks = false;   ///< some chunks cannot be read at all
    bool dearest = false;       ///< see ReplayInput
    bool foresight = false;     ///< the way is told beforehand
};

struct StressPlan {
    uint64_t seed = 1;
    double seconds = 20;           ///< of motion, > 0
    server::ShadowConfig config;   ///< of all cases, before a case changes it
    std::vector<world::Pose> path; ///< recorded, a case of its own; may be empty
};

constexpr double kStressRate = 30;  ///< frames a second

/// All cases, the same for the same plan and world. Eyes move around the world's middle, at the height of the ground
/// there.
std::vector<StressCase> stressCases(const world::WorldStore& store, const StressPlan& plan);

/// The same winding flight on slow disks: without prefetch, by speed, and with the way told beforehand.
std::vector<StressCase> prefetchCases(const world::WorldStore& store, const StressPlan& plan);

}  // namespace tools
