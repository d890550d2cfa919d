#include "tools/bench_occlusion.h"

#include <chrono>
#include <deque>
#include <limits>
#include <map>

#include "culling/bare_rays.h"
#include "culling/occlusion.h"
#include "tools/summary.h"

namespace tools {
namespace {

using world::Result;

constexpr int kRounds = 5;
constexpr double kSlack = 0.25;  ///< as the service: casters are asked about that far beyond the window [splits]
constexpr double kSmallestCell = 8;  ///< as the service [m]
constexpr uint64_t kUnlimited = std::numeric_limits<uint64_t>::max();
constexpr double kGoal = 0.8;

/// Static casters with all that they refer to.
struct StaticScene {
    std::deque<world::Chunk> chunks;
    std::map<uint32_t, world::Mesh> meshes;
    world::CasterTable table;
    std::vector<world::CasterId> ids;
};

template <class F>
double wallMs(const F& f) {
    const auto start = std::chrono::steady_clock::now();
    f();
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

bool over(const world::Box& bounds, glm::dvec2 at, double reach) {
    return bounds.min.x <= at.x + reach && bounds.max.x >= at.x - reach && bounds.min.y <= at.y + reach &&
           bounds.max.y >= at.y - reach;
}

/// The chunks that cast within `reach` [m] of `at` in the map plane.
Result<world::Done> read(const world::WorldStore& store, const culling::LightSpace& space, glm::dvec2 at, double reach,
                         StaticScene& scene) {
    std::map<uint32_t, world::MeshSlot> slots;
    for (const world::ChunkRecord& record : store.chunks()) {
        if (!over(space.toLight(record.bounds), at, reach)) continue;
        auto chunk = store.readChunk(record.key);
        if (!chunk) return chunk.error();
        const world::Chunk& c = scene.chunks.emplace_back(std::move(chunk.value()));
        const auto add = [&](world::MeshSlot mesh, const world::Placement& placement) {
            scene.ids.push_back(scene.table.add(mesh, placement, world::CasterState::kStatic, {}));
        };
        if (!c.terrain.levels.empty()) {
            world::Placement placement;
            placement.translation = glm::dvec3(c.key.x, 0, c.key.z) * store.header().chunkSize;
            add(scene.table.addMesh(c.terrain), placement);
        }
        for (const world::Instance& instance : c.instances) {
            if (!slots.contains(instance.mesh)) {
                auto mesh = store.readMesh(instance.mesh);
                if (!mesh) return mesh.error();
                const auto kept = scene.meshes.emplace(instance.mesh, std::move(mesh.value())).first;
                slots.emplace(instance.mesh, scene.table.addMesh(kept->second));
            }
            add(slots.at(instance.mesh), instance.placement);
        }
    }
    return world::Done{};
}

/// Rays a second of all cascades [1e6].
double millionsPerSecond(const std::vector<SearchCost>& costs, std::vector<double> SearchCost::*side) {
    double rays = 0, ms = 0;
    for (const SearchCost& c : costs) {
        rays += double(c.counts.rays);
        ms += median(c.*side);
    }
    return ms > 0 ? rays / ms / 1e3 : 0;
}

}  // namespace

Result<std::vector<SearchCost>> measureSearch(const world::WorldStore& store, glm::dvec3 eye,
                                              const server::ShadowConfig& config) {
    const auto cascades =
        culling::makeCascades(config.cascades, config.side, config.farDistance, config.splitRatio, config.guardBand);
    if (!cascades) return cascades.error();
    const auto space = culling::makeLightSpace(config.sun == glm::dvec3(0) ? store.header().sun : config.sun);
    if (!space) return space.error();
    const glm::dvec2 at(space.value().toLight(eye));
    const auto reachOf = [&](const culling::Cascade& c) {
        return c.texel * (config.side / 2.0 + config.guardBand) + kSlack * c.split;
    };
    StaticScene scene;
    if (const auto done = read(store, space.value(), at, reachOf(cascades.value().back()), scene); !done)
        return done.error();
    culling::LightCasters light(space.value(), cascades.value(), {config.levelError, config.smallestCaster});
    world::Octree statics(store.header().bounds, kSmallestCell);
    for (world::CasterId id : scene.ids) {
        light.addStatic(id, scene.table);
        statics.insert(id, scene.table[id].bounds);
    }
    const double range = std::max(1.0, space.value().toLight(store.header().bounds).extent().z);
    const culling::OcclusionConfig occlusionConfig{{config.raysPerCluster, range, config.side}};

    std::vector<SearchCost> costs;
    for (int c = 0; c < config.cascades; ++c) {
        const culling::Cascade& cascade = cascades.value()[size_t(c)];
        std::vector<world::CasterId> near;
        for (world::CasterId id : scene.ids)
            if (over(light[id].bounds, at, reachOf(cascade))) near.push_back(id);
        SearchCost cost{.texel = cascade.texel, .casters = near.size()};
        for (world::CasterId id : near)
            cost.triangles += scene.table.meshOf(id).levels[size_t(light.level(id, c))].indices.size() / 3;
        const auto rays = culling::BareRays::create(
            scene.table, light, c, near, culling::footprints(scene.table, light, c, near, config.raysPerCluster));
        if (!rays) return rays.error();
        for (int round = 0; round < kRounds; ++round) {
            cost.bare.push_back(wallMs([&] { rays.value()->shoot(); }));
            culling::Occlusion occlusion(scene.table, light, occlusionConfig);
            cost.search.push_back(wallMs([&] {
                occlusion.await(c, near);
                cost.counts = occlusion.search(statics, kUnlimited);
            }));
        }
        CHECK(cost.counts.rays == rays.value()->rays());
        costs.push_back(std::move(cost));
    }
    return costs;
}

std::string searchTable(const std::vector<SearchCost>& costs) {
    std::string text = "ms, medians of " + std::to_string(kRounds) + " turns; million rays a second\n";
    text += format("%7s %8s %8s %10s %9s %7s %10s  %16s  %16s\n", "cascade", "texel", "casters", "triangles", "clusters",
                   "hidden", "rays", "bare Embree", "search");
    for (size_t c = 0; c < costs.size(); ++c) {
        const SearchCost& cost = costs[c];
        const auto side = [&](std::vector<double> SearchCost::*times) {
            return format("%.1f %.2f", median(cost.*times), millionsPerSecond({cost}, times));
        };
        text += format("%7zu %8.3f %8zu %10llu %9llu %7llu %10llu  %16s  %16s\n", c, cost.texel, cost.casters,
                       static_cast<unsigned long long>(cost.triangles),
                       static_cast<unsigned long long>(cost.counts.clustersTested),
                       static_cast<unsigned long long>(cost.counts.certificates),
                       static_cast<unsigned long long>(cost.counts.rays), side(&SearchCost::bare).c_str(),
                       side(&SearchCost::search).c_str());
    }
    return text;
}

Goal searchGoal(const std::vector<SearchCost>& costs) {
    const double bare = millionsPerSecond(costs, &SearchCost::bare), search = millionsPerSecond(costs, &SearchCost::search);
    return {format("occlusion: at least %.1f of the rays a second of bare Embree", kGoal),
            format("%.2f, %.2f of %.2f M/s", bare > 0 ? search / bare : 0, search, bare), search >= kGoal * bare};
}

}  // namespace tools
