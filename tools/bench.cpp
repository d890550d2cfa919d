// tools/bench.cpp — the `gnomon-bench` program: cached updates beside whole redraws and a bare Vulkan
// loop, in one run. docs/benchmarks.md says what is measured and how.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <iostream>

#include "tools/bench_culling.h"
#include "tools/bench_occlusion.h"
#include "tools/bench_report.h"
#include "tools/bench_run.h"
#include "tools/bench_service.h"
#include "tools/bench_sizes.h"
#include "tools/bench_streaming.h"
#include "tools/options.h"
#include "tools/summary.h"
#include "tools/temporary_folder.h"
#include "tools/yardstick.h"
#include "world/bake.h"
#include "world/gltf.h"
#include "world/path.h"
#include "world/store.h"

namespace tools {
namespace {

namespace fs = std::filesystem;
using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

struct BenchOptions {
    std::string world, path, sizes, work;
    bool yardstick = false, culling = false, occlusion = false, streaming = false, service = false;
    size_t frames = 900, redraws = 20;
    CrowdConfig crowd{.sessions = 0};
};

constexpr double kYardstickMs = 2;  ///< of the goal
constexpr uint32_t kYardstickSeed = 7;
constexpr int kCullingRounds = 7, kStreamingRounds = 5, kQuestions = 9;
constexpr double kDrive = 15;  ///< speed of sessions along the path [m/s]

/// Plays the motions, then prints machine, world and tables; what they cost.
Result<std::vector<MotionCost>> measure(const world::WorldStore& store, const std::vector<Motion>& motions,
                                        const BenchOptions& options) {
    const auto device = gpu::Device::create({});
    if (!device) return device.error();
    BenchConfig config;
    config.redraws = options.redraws;
    const auto run = BenchRun::create(*device.value(), store, config);
    if (!run) return run.error();
    std::printf("%s\nbefore: %s\n", worldText(store).c_str(), machineText(*device.value()).c_str());
    std::vector<MotionCost> costs;
    for (const Motion& motion : motions) {
        auto cost = run.value()->play(motion);
        if (!cost) return cost.error();
        costs.push_back(std::move(cost.value()));
    }
    const server::ShadowConfig& shadows = config.shadows;
    std::printf("after:  %s\n%d cascades of %d x %d texels, far %.0f m", machineText(*device.value()).c_str(),
                shadows.cascades, shadows.side, shadows.side, shadows.farDistance);
    const bool moving =
        std::any_of(motions.begin(), motions.end(), [](const Motion& m) { return m.movers > 0; });
    if (const auto mesh = moverMesh(store); moving && mesh)
        std::printf("; movers of %u triangles", store.meshes()[*mesh].levels.front().triangles);
    std::printf("\n\n%s\n", costTables(costs).c_str());
    return costs;
}

/// The track of --path, or of the path beside the world.
Result<std::vector<world::Pose>> trackOf(const BenchOptions& options) {
    const std::string file =
        options.path.empty() ? fs::path(options.world).replace_extension(".tum").string() : options.path;
    const auto path = world::readTum(file);
    if (!path) return path.error();
    auto track = travelled(path.value());
    if (!track) return Error{track.error().code, file + ": " + track.error().what};
    return track;
}

Result<Done> benchWorld(const BenchOptions& options) {
    const auto store = world::WorldStore::open(options.world);
    if (!store) return store.error();
    const auto track = trackOf(options);
    if (!track) return track.error();
    std::vector<Motion> motions = benchMotions(track.value(), options.frames);
    if (!moverMesh(store.value()))  // terrain alone
        std::erase_if(motions, [](const Motion& motion) { return motion.movers > 0; });
    if (options.culling) {
        const auto bench = benchCulling(store.value(), motions, kCullingRounds);
        if (!bench) return bench.error();
        std::printf("%s\n%s", worldText(store.value()).c_str(), cullingTable(bench.value()).c_str());
        return Done{};
    }
    const auto costs = measure(store.value(), motions, options);
    if (!costs) return costs.error();
    std::printf("%s", goalText(motionGoals(costs.value(), instancesOf(store.value()))).c_str());
    return Done{};
}

Result<Done> benchStreaming(const BenchOptions& options) {
    const auto store = world::WorldStore::open(options.world);
    if (!store) return store.error();
    const auto cost = measureStreaming(store.value(), kStreamingRounds);
    if (!cost) return cost.error();
    std::printf("%s\n%s\n%s", worldText(store.value()).c_str(), streamingText(cost.value()).c_str(),
                goalText({streamingGoal(cost.value())}).c_str());
    return Done{};
}

Result<Done> benchSearch(const BenchOptions& options) {
    const auto store = world::WorldStore::open(options.world);
    if (!store) return store.error();
    const auto track = trackOf(options);
    if (!track) return track.error();
    std::printf("%s\nbefore: %s\n", worldText(store.value()).c_str(), hostText().c_str());
    const auto costs = measureSearch(store.value(), track.value().front().position, {});
    if (!costs) return costs.error();
    std::printf("after:  %s\n\n%s\n%s", hostText().c_str(), searchTable(costs.value()).c_str(),
                goalText({searchGoal(costs.value())}).c_str());
    return Done{};
}

Result<Done> benchService(const BenchOptions& options) {
    const auto track = trackOf(options);
    if (!track) return track.error();
    const std::vector<world::Pose> poses = follow(track.value(), kDrive, options.frames);
    std::printf("before: %s\n", hostText().c_str());
    if (options.crowd.sessions > 0) {
        const auto cost = measureCrowd(options.world, poses, options.crowd);
        if (!cost) return cost.error();
        std::printf("after:  %s\n\n%s\n%s", hostText().c_str(), crowdText(cost.value(), options.crowd).c_str(), goalText(crowdGoals(cost.value())).c_str());
        return Done{};
    }
    const auto cost = measureService(options.world, poses, kQuestions);
    if (!cost) return cost.error();
    std::printf("after:  %s\n\n%s\n%s", hostText().c_str(), serviceText(cost.value()).c_str(), goalText(serviceGoals(cost.value())).c_str());
    return Done{};
}

Result<Done> benchYardstick(const BenchOptions& options) {
    const TemporaryFolder folder;
    if (folder.path().empty()) return Error{ErrorCode::kIo, "no temporary folder can be made: check TMPDIR"};
    const std::string glb = folder.path() + "/yardstick.glb",
                      file = folder.path() + "/yardstick.world";
    if (const auto done = writeYardstick(glb, kYardstickSeed); !done) return done.error();
    const auto source = world::openGltf(glb, {.chunkSize = 0, .sun = yardstickSun()});
    if (!source) return source.error();
    if (const auto baked = world::bake(source.value(), file, [](size_t, size_t) {}); !baked)
        return baked.error();
    const auto store = world::WorldStore::open(file);
    if (!store) return store.error();
    const auto costs =
        measure(store.value(), {{"yardstick", follow(yardstickTrack(), 15, options.frames)}}, options);
    if (!costs) return costs.error();
    const double update = median(costs.value().front().update);
    std::printf("%s", goalText({{format("yardstick: update at most %.0f ms", kYardstickMs),
                                 format("%.3f ms", update), update <= kYardstickMs}})
                          .c_str());
    return Done{};
}

Result<Done> run(const BenchOptions& options) {
    const int tasks = int(!options.world.empty()) + int(options.yardstick) + int(!options.sizes.empty());
    if (tasks != 1)
        return Error{ErrorCode::kUsage, "give one of a world, --yardstick and --sizes; --help explains"};
    const int parts = int(options.culling) + int(options.occlusion) + int(options.streaming) + int(options.service);
    if ((!options.path.empty() || parts > 0) && options.world.empty())
        return Error{ErrorCode::kUsage,
                     "--path, --culling, --occlusion, --streaming, --service: only with a world; leave them out"};
    if (parts > 1) return Error{ErrorCode::kUsage, "give one of --culling, --occlusion, --streaming and --service"};
    if (options.crowd.sessions > 0 && !options.service) return Error{ErrorCode::kUsage, "--sessions: only with --service"};
    if (options.yardstick) return benchYardstick(options);
    if (options.occlusion) return benchSearch(options);
    if (options.streaming) return benchStreaming(options);
    if (options.service) return benchService(options);
    if (options.sizes.empty()) return benchWorld(options);
    const auto sizes = parseSizes(options.sizes);
    if (!sizes) return sizes.error();
    if (options.work.empty())
        return Error{ErrorCode::kUsage, "--sizes: worlds need a place; give a folder with --work"};
    return benchSizes(sizes.value(), options.work, options.frames);
}

}  // namespace
}  // namespace tools

int main(int argc, char** argv) {
    CLI::App app("Measures cached shadow updates beside whole redraws and a bare Vulkan loop",
                 "gnomon-bench");
    tools::BenchOptions options;
    app.add_option("world", options.world, "world file to walk, drive, turn and stand in");
    app.add_option("--path", options.path,
                   "camera path, TUM trajectory; beside the world by default: NAME.tum");
    app.add_flag("--yardstick", options.yardstick, "a fixed scene of 10,000 boxes on a large ground");
    app.add_flag("--culling", options.culling, "the queries behind the plans on their own, without a GPU");
    app.add_flag("--occlusion", options.occlusion, "the search for hidden clusters on its own, beside bare Embree");
    app.add_flag("--streaming", options.streaming, "the streamer on its own, beside a bare loop of reads");
    app.add_flag("--service", options.service, "sessions over the wire beside one in process, and points a second");
    app.add_option("--sessions", options.crowd.sessions, "with --service: so many sessions at once instead")->check(CLI::Range(1, 1024));
    app.add_option("--idle", options.crowd.idle, "with --sessions: connections beside them that ask nothing")->check(CLI::Range(0, 8192))->capture_default_str();
    app.add_option("--seconds", options.crowd.seconds, "with --sessions: for so long [s]")->check(CLI::Range(1.0, 86400.0))->capture_default_str();
    app.add_option("--sizes", options.sizes, "N,N,...: the built-in world with so many instances each");
    app.add_option("--work", options.work, "folder that keeps the worlds of --sizes");
    app.add_option("--frames", options.frames, "most frames of a motion")->check(CLI::Range(1, 1'000'000));
    app.add_option("--redraws", options.redraws, "frames of a motion that are drawn whole as well")
        ->check(CLI::Range(0, 1'000'000));
    app.failure_message([](const CLI::App*, const CLI::Error& error) {
        return "gnomon-bench: " + std::string(error.what()) + "; --help lists the options\n";
    });
    try {
        app.parse(argc, argv);
    } catch (const CLI::ParseError& error) {
        return app.exit(error) == 0 ? 0 : 2;
    }
    const auto done = tools::run(options);
    if (done) return 0;
    std::cerr << "gnomon-bench: " << done.error().what << '\n';
    return tools::exitStatus(done.error().code);
}
