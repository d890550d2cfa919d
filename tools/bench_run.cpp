#include "tools/bench_run.h"

#include <algorithm>
#include <chrono>
#include <optional>

namespace tools {
namespace {

using server::Method;
using server::ShadowSystem;
using world::Done;
using world::Result;

/// Frames: a jump, what it left active, and one to see that it is over. As many more as the search for certificates takes.
constexpr size_t kSettling = 3;

/// A system with the objects that move in it.
struct Player {
    std::unique_ptr<ShadowSystem> system;
    std::vector<server::ObjectId> movers;

    Result<Done> enter(const Motion& motion, std::optional<uint32_t> mesh) {
        for (uint32_t m = 0; mesh && m < motion.movers; ++m) {
            const auto id = system->spawn(*mesh, moverAt(m, motion.poses.front().position, 0));
            if (!id) return id.error();
            movers.push_back(id.value());
        }
        return Done{};
    }
    Result<Done> leave() {
        for (const server::ObjectId id : movers)
            if (const auto done = system->remove(id); !done) return done;
        movers.clear();
        return Done{};
    }
    /// `wholeMs` may be null.
    Result<server::FrameReport> advance(const world::Pose& pose, double time, double* wholeMs) {
        std::vector<server::ObjectUpdate> updates;
        for (uint32_t m = 0; m < movers.size(); ++m)
            updates.push_back({movers[m], moverAt(m, pose.position, time)});
        const server::FrameInput input{
            time, {.position = pose.position, .orientation = pose.orientation}, updates};
        const auto start = std::chrono::steady_clock::now();
        auto report = system->advance(input);
        if (report)
            if (const auto finished = system->finish(report.value()); !finished) return finished.error();
        const auto end = std::chrono::steady_clock::now();
        if (wholeMs) *wholeMs = std::chrono::duration<double, std::milli>(end - start).count();
        if (report && !report.value().errors.empty()) return report.value().errors.front();
        return report;
    }
};

double updateOf(const server::FrameReport& report) {
    return report.cpu.planMs + report.cpu.recordMs + report.gpu.wallMs;
}

void add(Drawn& sum, const server::FrameReport& report) {
    for (const cache::CascadeStatistics& cascade : report.cascades) {
        sum.triangles += cascade.total.triangles + cascade.active.triangles;
        sum.texels += cascade.total.texels + cascade.active.texels;
    }
}

void add(MotionCost& cost, const server::FrameReport& report) {
    cost.update.push_back(updateOf(report));
    add(cost.drawn, report);
    cost.stages.streamMs += report.cpu.streamMs;
    cost.stages.occlusionMs += report.cpu.occlusionMs;
    cost.stages.setsMs += report.cpu.setsMs;
    cost.stages.planMs += report.cpu.planMs;
    cost.stages.recordMs += report.cpu.recordMs;
    cost.gpuMs += report.gpu.wallMs;
    cost.submissions += report.submitted ? 1 : 0;
}

}  // namespace

struct BenchRun::Impl {
    Player cached, redrawing;  ///< the latter without a system if nothing is redrawn
    std::unique_ptr<gpu::Floor> floor;
    BenchConfig config;
    std::optional<uint32_t> mesh;  ///< of movers
    double time = 0;               ///< of the next frame [s]
    bool searching = false;        ///< the last frame looked for certificates

    /// The last plan of the cache, by the floor. All plans are: so its maps hold the same.
    Result<double> runFloor() {
        const auto prepared = floor->prepare(
            cached.system->plan(),
            [this](cache::GeometryId id) -> const world::MeshLevel& { return cached.system->geometry(id); });
        if (!prepared) return prepared.error();
        auto ms = floor->run(prepared.value());
        floor->discard();
        return ms;
    }
    Result<Done> frame(const world::Pose& pose, bool redraw, MotionCost* cost) {
        double wholeMs = 0;
        const auto report = cached.advance(pose, time, &wholeMs);
        if (!report) return report.error();
        searching = report.value().rays > 0;
        if (cost) {
            cost->whole.push_back(wholeMs);
            add(*cost, report.value());
        }
        if (floor) {
            const auto ms = runFloor();
            if (!ms) return ms.error();
            if (cost) cost->floor.push_back(ms.value());
        }
        if (redraw) {
            const auto drawn = redrawing.advance(pose, time, nullptr);
            if (!drawn) return drawn.error();
            if (cost) {
                cost->redraw.push_back(updateOf(drawn.value()));
                add(cost->redrawn, drawn.value());
            }
        }
        time += 1 / kBenchFps;
        return Done{};
    }
};

BenchRun::BenchRun(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
BenchRun::~BenchRun() = default;

Result<std::unique_ptr<BenchRun>> BenchRun::create(gpu::Device& device, const world::WorldStore& store,
                                                   const BenchConfig& config) {
    auto impl = std::make_unique<Impl>();
    impl->config = config;
    server::ShadowConfig shadows = config.shadows;
    shadows.timestamps = false;
    const auto make = [&](Method method, Player& player) -> Result<Done> {
        shadows.method = method;
        auto made = ShadowSystem::create(device, store, shadows);
        if (!made) return made.error();
        player.system = std::move(made.value());
        return Done{};
    };
    if (const auto done = make(Method::kGnomon, impl->cached); !done) return done.error();
    if (config.redraws > 0)
        if (const auto done = make(Method::kRedraw, impl->redrawing); !done) return done.error();
    if (config.floor) {
        gpu::ShadowMapsConfig maps;
        maps.cascades = shadows.cascades;
        maps.side = shadows.side;
        auto floor = gpu::Floor::create(device, maps);
        if (!floor) return floor.error();
        impl->floor = std::move(floor.value());
    }
    impl->mesh = moverMesh(store);
    return std::unique_ptr<BenchRun>(new BenchRun(std::move(impl)));
}

Result<MotionCost> BenchRun::play(const Motion& motion) {
    Impl& run = *impl_;
    const size_t frames = motion.poses.size();
    const size_t redraws = std::min(run.config.redraws, frames);
    MotionCost cost;
    cost.name = motion.name;
    for (Player* player : {&run.cached, &run.redrawing})
        if (player->system)
            if (const auto done = player->enter(motion, run.mesh); !done) return done.error();
    for (size_t k = 0; k < kSettling || run.searching; ++k)
        if (const auto done = run.frame(motion.poses.front(), k == 0 && redraws > 0, nullptr); !done)
            return done.error();
    for (size_t k = 0; k < frames; ++k) {
        // Spread evenly: frame k is redrawn where the count of redraws steps up.
        const bool redraw = (k + 1) * redraws / frames > k * redraws / frames;
        if (const auto done = run.frame(motion.poses[k], redraw, &cost); !done) return done.error();
    }
    for (Player* player : {&run.cached, &run.redrawing})
        if (const auto done = player->leave(); !done) return done.error();
    return cost;
}

}  // namespace tools
