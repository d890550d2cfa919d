#include "tools/bench_sizes.h"

#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <glm/gtc/constants.hpp>
#include <iostream>
#include <sstream>

#include "tools/bench_report.h"
#include "tools/bench_run.h"
#include "tools/progress.h"
#include "tools/summary.h"
#include "world/bake.h"
#include "world/procedural_field.h"
#include "world/procedural_path.h"

namespace tools {
namespace {

using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

constexpr uint64_t kSeed = 7;
constexpr double kLargestRatio = 1.2;  ///< of the goal
/// Edge of a terrain voxel [m], four times the usual: a ground of a sixteenth of the triangles, so that a world of ten
/// million instances bakes in minutes and not in hours. It is the same in every size.
constexpr double kVoxel = 8;
constexpr int kRounds = 3;             ///< drives of each size, in turns: a machine's speed drifts

/// What a child tells its parent: numbers only.
struct SizeCost {
    uint64_t instances = 0, chunks = 0;
    double edge = 0;                  ///< [m]
    double openMs = 0, createMs = 0;  ///< the world file; the system with its streamer and maps
    double update = 0, update95 = 0;  ///< median, 95th percentile [ms]
    double whole = 0, whole95 = 0, wholeMost = 0, streaming = 0;  ///< the latter a mean [ms]
    double triangles = 0;                                         ///< a frame
    Memory memory;
};

double msSince(std::chrono::steady_clock::time_point start) {
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

Error childFault(const std::string& what) {
    return {ErrorCode::kIo, "gnomon-bench --sizes: " + what + "; the lines above may say why"};
}

/// Runs `work` in a child process; its answer comes back, its threads and memory do not.
Result<SizeCost> inChild(const std::function<Result<SizeCost>()>& work) {
    int ends[2];
    if (::pipe(ends) != 0) return childFault("no pipe");
    std::fflush(stdout);
    const pid_t child = ::fork();
    if (child < 0) return childFault("no process");
    if (child == 0) {
        ::close(ends[0]);
        const auto cost = work();
        if (!cost) std::cerr << "gnomon-bench: " << cost.error().what << '\n';
        const bool told = cost && ::write(ends[1], &cost.value(), sizeof(SizeCost)) == sizeof(SizeCost);
        std::fflush(stdout);
        ::_exit(told ? 0 : 1);
    }
    ::close(ends[1]);
    SizeCost cost;
    const bool told = ::read(ends[0], &cost, sizeof cost) == sizeof cost;
    ::close(ends[0]);
    int status = 0;
    if (::waitpid(child, &status, 0) != child || status != 0 || !told) return childFault("a size failed");
    return cost;
}

Result<SizeCost> bakeSize(const world::ProceduralOptions& options, const std::string& world,
                          const std::string& path) {
    const auto source = world::openProcedural(kSeed, options);
    if (!source) return source.error();
    if (const auto done = world::writeTum(path, world::proceduralPath(kSeed, options)); !done)
        return done.error();
    const auto start = std::chrono::steady_clock::now();
    Progress progress("bake", std::cerr, stderrIsTerminal());
    const auto baked =
        world::bake(
            source.value(), world, [&](size_t done, size_t total) { progress.at(done, total); },
            [&](const std::string& line) { progress.say(line); });
    if (!baked) return baked.error();
    std::printf("baked %s in %.0f s with at most %.0f MiB\n", world.c_str(), msSince(start) / 1000,
                memory().mostMiB);
    return SizeCost{};
}

Result<SizeCost> driveSize(const world::ProceduralOptions& options, const std::string& path, size_t frames) {
    SizeCost cost;
    const std::vector<world::Pose> track = middleTrack(options);
    auto start = std::chrono::steady_clock::now();
    const auto store = world::WorldStore::open(path);
    if (!store) return store.error();
    cost.openMs = msSince(start);
    const auto device = gpu::Device::create({});
    if (!device) return device.error();
    start = std::chrono::steady_clock::now();
    const auto run =
        BenchRun::create(*device.value(), store.value(), {.shadows = {}, .redraws = 0, .floor = false});
    if (!run) return run.error();
    cost.createMs = msSince(start);
    const auto played = run.value()->play({"driving", follow(track, 15, frames)});
    if (!played) return played.error();
    const MotionCost& motion = played.value();
    cost.instances = instancesOf(store.value());
    cost.chunks = store.value().chunks().size();
    cost.edge = world::proceduralSize(options);
    cost.update = median(motion.update);
    cost.update95 = quantile(motion.update, 0.95);
    cost.whole = median(motion.whole);
    cost.whole95 = quantile(motion.whole, 0.95);
    cost.wholeMost = quantile(motion.whole, 1);
    cost.streaming = motion.stages.streamMs / double(motion.frames());
    cost.triangles = double(motion.drawn.triangles) / double(motion.frames());
    cost.memory = memory();
    return cost;
}

}  // namespace

Result<std::vector<uint32_t>> parseSizes(const std::string& text) {
    std::vector<uint32_t> sizes;
    std::istringstream list(text +
                            ",");  // so that what follows the last comma is an item, if only an empty one
    for (std::string item; std::getline(list, item, ',');) {
        char* end = nullptr;
        const double count = std::strtod(item.c_str(), &end);
        if (item.empty() || *end != 0 || !(count >= 1 && count <= 1e7) || count != std::floor(count))
            return Error{ErrorCode::kUsage,
                         "--sizes: \"" + item +
                             "\" is no count of instances; give whole numbers up to 1e7, as in 1e4,1e5"};
        sizes.push_back(static_cast<uint32_t>(count));
    }
    return sizes;
}

world::ProceduralOptions sizedWorld(uint32_t instances) {
    const world::ProceduralOptions usual;
    world::ProceduralOptions options;
    options.instances = instances;
    options.voxel = kVoxel;
    options.size = std::max(1024.0, usual.size * std::sqrt(double(instances) / usual.instances));
    return options;
}

std::vector<world::Pose> middleTrack(const world::ProceduralOptions& options) {
    constexpr double kHalf = 150, kStep = 0.5, kEye = 1.7, kSpeed = 15;  // [m], [m/s]
    const world::Landscape land(kSeed, world::proceduralSize(options));
    std::vector<world::Pose> track;
    for (double x = -kHalf; x <= kHalf; x += kStep)
        track.push_back({.time = (x + kHalf) / kSpeed,
                         .position = {x, land.groundHeight(x, 0) + kEye, 0},
                         .orientation = glm::angleAxis(-glm::half_pi<double>(), glm::dvec3(0, 1, 0))});
    return track;
}

Result<Done> benchSizes(const std::vector<uint32_t>& sizes, const std::string& folder, size_t frames) {
    const auto stem = [&](uint32_t size) {
        return folder + "/procedural-" + std::to_string(kSeed) + "-" + std::to_string(size);
    };
    for (const uint32_t size : sizes) {
        if (std::filesystem::exists(stem(size) + ".world")) continue;
        const auto baked =
            inChild([&] { return bakeSize(sizedWorld(size), stem(size) + ".world", stem(size) + ".tum"); });
        if (!baked) return baked.error();
    }
    std::vector<std::vector<SizeCost>> rounds(sizes.size());  // by size
    for (int round = 0; round < kRounds; ++round)
        for (size_t k = 0; k < sizes.size(); ++k) {
            const auto cost =
                inChild([&] { return driveSize(sizedWorld(sizes[k]), stem(sizes[k]) + ".world", frames); });
            if (!cost) return cost.error();
            rounds[k].push_back(cost.value());
        }
    const auto faster = [](const SizeCost& a, const SizeCost& b) { return a.update < b.update; };
    std::vector<SizeCost> costs;
    for (std::vector<SizeCost>& all : rounds) {
        std::sort(all.begin(), all.end(), faster);
        costs.push_back(all[all.size() / 2]);
    }
    if (const auto device = gpu::Device::create({}))
        std::printf("after:  %s\n", machineText(*device.value()).c_str());
    std::printf(
        "driving 300 m at 15 m/s through the middle, the middle one of %d drives; ms; memory in MiB\n",
        kRounds);
    std::printf("%10s %7s %8s %8s %8s  %15s  %23s %9s  %9s  %6s %6s\n", "instances", "chunks", "edge [m]",
                "open", "create", "update p50 p95", "whole p50 p95 max", "streaming", "triangles", "memory",
                "most");
    for (const SizeCost& c : costs)
        std::printf(
            "%10llu %7llu %8.0f %8.1f %8.1f  %7.3f %7.3f  %7.3f %7.3f %7.1f %9.3f  %9.0f  %6.0f %6.0f\n",
            static_cast<unsigned long long>(c.instances), static_cast<unsigned long long>(c.chunks), c.edge,
            c.openMs, c.createMs, c.update, c.update95, c.whole, c.whole95, c.wholeMost, c.streaming,
            c.triangles, c.memory.nowMiB, c.memory.mostMiB);
    const auto [least, most] = std::minmax_element(costs.begin(), costs.end(), faster);
    const double ratio = least->update > 0 ? most->update / least->update : 0;
    const Goal goal{format("sizes: the slowest median update at most %.1f of the fastest", kLargestRatio),
                    format("%.2f", ratio), ratio > 0 && ratio <= kLargestRatio};
    std::printf("\n%s", goalText({goal}).c_str());
    return Done{};
}

}  // namespace tools
