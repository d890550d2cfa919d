// tools/bench_report.h — what a benchmark measured, as tables for people, with its goals beside it.
#pragma once

#include <string>
#include <vector>

#include "gpu/device.h"
#include "tools/bench_run.h"
#include "world/store.h"

namespace tools {

/// Threads, processor and the load averages of 1 and 5 minutes, now.
std::string hostText();
/// Device and driver as well.
std::string machineText(const gpu::Device& device);
/// "world.world: 50000 instances, 1024 chunks, 4096 x 4096 m".
std::string worldText(const world::WorldStore& store);
uint64_t instancesOf(const world::WorldStore& store);

/// Resident memory of a process [MiB], by default this one: now, and the most so far; 0 where /proc does not say.
struct Memory {
    double nowMiB = 0, mostMiB = 0;
};
Memory memory(int process = 0);

/// Times, ratios, counts and the share of each stage, one row a motion.
std::string costTables(const std::vector<MotionCost>& costs);

/// A bound and what was measured.
struct Goal {
    std::string text;      ///< what was promised
    std::string measured;  ///< with its unit
    bool met = false;
};
/// Those of DESIGN's promises that motions can be held against: driving at most 1/50 of a redraw, turning
/// at most 1/10, standing submits nothing and takes under 0.1 ms, whole frames at most 1.5 floors.
std::vector<Goal> motionGoals(const std::vector<MotionCost>& costs, uint64_t instances);
std::string goalText(const std::vector<Goal>& goals);

/// printf into a string.
[[gnu::format(printf, 1, 2)]] std::string format(const char* pattern, ...);

}  // namespace tools
