// tools/bench.cpp — the `gnomon-bench` program: cached updates beside whole redraws, in one run.
// Two systems follow the same path without movers, so only the static part is measured: one caches,
// the other draws everything; on sampled frames both advance to the same pose, one after the other.
#include <tbb/global_control.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <iostream>
#include <optional>

#include "tools/options.h"
#include "tools/replay.h"
#include "tools/summary.h"
#include "world/path.h"
#include "world/store.h"

namespace tools {
namespace {

using world::Done;
using world::Result;

constexpr double kDriveBegins = 18, kDriveEnds = 48;  // of the built-in path [s]
constexpr int kStandingFrames = 300;

/// One frame's cost [ms].
struct FrameCost {
    double update = 0;  ///< plan, record, submit to fence: what a redraw does as well
    double whole = 0;   ///< all of ShadowSystem::advance, streaming and certificates too
    uint64_t triangles = 0;
    bool submitted = false;
};

Result<FrameCost> advance(server::ShadowSystem& system, const world::Pose& pose, double time) {
    server::FrameInput input;
    input.time = time;
    input.camera = {pose.position, pose.orientation};
    const auto start = std::chrono::steady_clock::now();
    const auto report = system.advance(input);
    const auto end = std::chrono::steady_clock::now();
    if (!report) return report.error();
    const server::FrameReport& frame = report.value();
    FrameCost cost;
    cost.whole = std::chrono::duration<double, std::milli>(end - start).count();
    cost.update = frame.cpu.planMs + frame.cpu.recordMs + frame.gpu.wallMs;
    for (const cache::CascadeStatistics& cascade : frame.cascades) cost.triangles += cascade.total.triangles;
    cost.submitted = frame.gpu.submitted;
    return cost;
}

struct Bench {
    std::unique_ptr<gpu::Device> device;
    std::optional<world::WorldStore> store;
    std::vector<world::Pose> path;

    Result<std::unique_ptr<server::ShadowSystem>> system(server::Method method) {
        server::ShadowConfig config;
        config.method = method;
        return server::ShadowSystem::create(*device, *store, config);
    }
};

/// The frames of the built-in path's drive or, in a path that is over before it ends, all frames.
FrameRange drive(const std::vector<world::Pose>& path) {
    const double first = path.front().time;
    if (path.back().time - first < kDriveEnds) return {0, path.size()};
    const auto at = [&](double time) {
        return uint64_t(std::lower_bound(path.begin(), path.end(), first + time,
                                         [](const world::Pose& p, double t) { return p.time < t; }) -
                        path.begin());
    };
    return {at(kDriveBegins), at(kDriveEnds)};
}

/// Plays a segment and prints its row; the cached system is left at the segment's end.
Result<Done> measure(Bench& bench, server::ShadowSystem& cached, const FrameRange& range) {
    auto redrawing = bench.system(server::Method::kRedraw);
    if (!redrawing) return redrawing.error();
    std::vector<double> updates, wholes, sampledUpdates, redraws;
    uint64_t cachedTriangles = 0, redrawnTriangles = 0;
    const uint64_t step = samplingStep(range.end - range.begin);
    for (uint64_t k = range.begin; k < range.end; ++k) {
        const auto cost = advance(cached, bench.path[k], bench.path[k].time);
        if (!cost) return cost.error();
        updates.push_back(cost.value().update);
        wholes.push_back(cost.value().whole);
        // The first frame fills the maps: for both it is a whole redraw.
        if (k == range.begin || (k - range.begin) % step != 0) continue;
        const auto redraw = advance(*redrawing.value(), bench.path[k], bench.path[k].time);
        if (!redraw) return redraw.error();
        sampledUpdates.push_back(cost.value().update);
        redraws.push_back(redraw.value().update);
        cachedTriangles += cost.value().triangles;
        redrawnTriangles += redraw.value().triangles;
    }
    const auto share = [](double part, double whole) { return whole > 0 ? 100 * part / whole : 0; };
    char name[48];
    std::snprintf(name, sizeof name, "%llu:%llu", static_cast<unsigned long long>(range.begin),
                  static_cast<unsigned long long>(range.end));
    std::printf("%-12s %7zu %8zu %9.3f %9.3f %9.3f %7.2f %% %9.2f %% %9.3f %9.3f\n", name, updates.size(),
                redraws.size(), median(updates), median(sampledUpdates), median(redraws),
                share(median(sampledUpdates), median(redraws)),
                share(double(cachedTriangles), double(redrawnTriangles)), median(wholes),
                quantile(wholes, 0.95));
    return Done{};
}

/// Stands still at `pose`, from `time` on, and prints what that costs.
Result<Done> stand(server::ShadowSystem& cached, const world::Pose& pose, double time) {
    std::vector<double> wholes;
    int submissions = 0;
    for (int k = 1; k <= kStandingFrames; ++k) {
        const auto cost = advance(cached, pose, time + k / 30.0);
        if (!cost) return cost.error();
        wholes.push_back(cost.value().whole);
        submissions += cost.value().submitted ? 1 : 0;
    }
    std::printf("standing still, %d frames: median %.4f ms and max %.4f ms of CPU a frame, %d submissions\n",
                kStandingFrames, median(wholes), quantile(wholes, 1), submissions);
    return Done{};
}

Result<Done> run(const std::string& world, const std::string& path, const std::vector<std::string>& frames) {
    Bench bench;
    auto store = world::WorldStore::open(world);
    if (!store) return store.error();
    bench.store.emplace(std::move(store.value()));
    auto poses = world::readTum(path);
    if (!poses) return poses.error();
    bench.path = std::move(poses.value());
    std::vector<FrameRange> ranges;
    for (const std::string& text : frames) {
        const auto range = parseFrameRange(text);
        if (!range) return range.error();
        if (const auto cut = replayPoses(bench.path, 0, range.value()); !cut) return cut.error();
        ranges.push_back(range.value());
    }
    if (ranges.empty()) ranges.push_back(drive(bench.path));
    auto device = gpu::Device::create({});
    if (!device) return device.error();
    bench.device = std::move(device.value());

    std::printf("%s, %s; %s, %s; %zu threads\n", world.c_str(), path.c_str(), bench.device->name().c_str(),
                bench.device->driver().c_str(),
                tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism));
    std::printf("medians [ms]; update: plan, record, submit to fence; frame: all of it, p50 and p95\n");
    std::printf("%-12s %7s %8s %9s %9s %9s %9s %11s %9s %9s\n", "segment", "frames", "sampled", "cached",
                "sampled", "redraw", "of it", "triangles", "frame50", "frame95");
    std::unique_ptr<server::ShadowSystem> last;
    for (const FrameRange& range : ranges) {
        auto cached = bench.system(server::Method::kGnomon);
        if (!cached) return cached.error();
        last = std::move(cached.value());
        if (const auto done = measure(bench, *last, range); !done) return done.error();
    }
    const world::Pose& end = bench.path[ranges.back().end - 1];
    return stand(*last, end, end.time);
}

}  // namespace
}  // namespace tools

int main(int argc, char** argv) {
    CLI::App app("Measures cached shadow updates beside whole redraws", "gnomon-bench");
    std::string world, path;
    std::vector<std::string> frames;
    app.add_option("world", world, "world file")->required();
    app.add_option("path", path, "camera path, TUM trajectory")->required();
    app.add_option("--frames", frames,
                   "FIRST:END, a segment to measure; repeatable; the drive of the built-in "
                   "path by default")
        ->expected(1)
        ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
    app.failure_message([](const CLI::App*, const CLI::Error& error) {
        return "gnomon-bench: " + std::string(error.what()) + "; --help lists the options\n";
    });
    try {
        app.parse(argc, argv);
    } catch (const CLI::ParseError& error) {
        return app.exit(error) == 0 ? 0 : 2;
    }
    const auto done = tools::run(world, path, frames);
    if (done) return 0;
    std::cerr << "gnomon-bench: " << done.error().what << '\n';
    return tools::exitStatus(done.error().code);
}
