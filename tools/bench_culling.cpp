#include "tools/bench_culling.h"

#include <time.h>

#include <algorithm>
#include <glm/gtc/constants.hpp>
#include <limits>
#include <map>
#include <memory>
#include <optional>

#include "cache/plan_writer.h"
#include "cache/scroll.h"
#include "cache/shadow_cache.h"
#include "culling/caster_query.h"
#include "culling/receivers.h"
#include "server/shadow_system.h"
#include "tools/bench_report.h"
#include "world/hash.h"
#include "world/streamer.h"

namespace tools {
namespace {

using world::Done;
using world::Result;

constexpr double kSmallestCell = 8;  ///< of the octree [m]
constexpr double kRoom = 150;        ///< around the windows, wanted as well [m]

double threadMs() {
    timespec now{};
    ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return double(now.tv_sec) * 1e3 + double(now.tv_nsec) * 1e-6;
}

/// The least time of several rounds of `work`.
template <class Work>
double least(int rounds, Work work) {
    double best = std::numeric_limits<double>::infinity();
    for (int round = 0; round < rounds; ++round) {
        const double start = threadMs();
        work();
        best = std::min(best, threadMs() - start);
    }
    return best;
}

/// A rectangle that a frame draws from nothing, and the pieces of the map that it falls into.
struct Rect {
    int cascade = 0;
    cache::TexelRect rect;
    std::vector<cache::Piece> pieces;
};

constexpr uint64_t kAnyBytes = std::numeric_limits<uint64_t>::max() / 4;

/// The casters around some places, with all that a plan looks at.
class Casters {
public:
    Casters(const world::WorldStore& store, const culling::LightSpace& space,
            const std::vector<culling::Cascade>& cascades)
        : streamer(store, {.memoryBytes = kAnyBytes, .geometryBytes = kAnyBytes}),
          light(space, cascades),
          statics(store.header().bounds, kSmallestCell) {}

    world::MeshSlot slotOf(const world::Mesh& mesh) {
        const world::MeshSlot slot = table.addMesh(mesh);
        for (uint32_t& id : table.mesh(slot).geometry) id = geometries++;
        return slot;
    }
    void place(world::MeshSlot slot, const world::Placement& placement) {
        const world::CasterId id = table.add(slot, placement, world::CasterState::kStatic, {});
        light.addStatic(id, table);
        statics.insert(id, table[id].bounds);
    }
    void fill(const world::StreamEvents& events, double chunkSize) {
        for (const uint32_t id : events.meshArrivals) slots.emplace(id, slotOf(streamer.mesh(id)));
        for (const auto& chunk : events.arrivals) {
            chunks.push_back(chunk);
            if (!chunk->terrain.levels.empty()) {
                world::Placement placement;
                placement.translation = glm::dvec3(chunk->key.x, 0, chunk->key.z) * chunkSize;
                place(slotOf(chunk->terrain), placement);
            }
            for (const world::Instance& i : chunk->instances) place(slots.at(i.mesh), i.placement);
        }
    }
    cache::Scene view() const { return {table, light, statics, active, nullptr}; }

    world::Streamer streamer;
    world::CasterTable table;
    culling::LightCasters light;
    world::Octree statics;
    std::vector<world::CasterId> active;

private:
    std::vector<std::shared_ptr<const world::Chunk>> chunks;
    std::map<uint32_t, world::MeshSlot> slots;
    cache::GeometryId geometries = 0;
};

/// One motion, planned and taken apart.
class Drive {
public:
    Drive(Casters& scene, const cache::CacheConfig& config, const Motion& motion, std::optional<uint32_t> mesh)
        : casters_(scene), config_(config), motion_(motion) {
        if (!mesh || motion.movers == 0) return;
        const world::MeshSlot slot = scene.slotOf(scene.streamer.mesh(*mesh));
        for (uint32_t m = 0; m < motion.movers; ++m) {
            const auto id = scene.table.add(slot, moverAt(m, motion.poses.front().position, 0),
                                            world::CasterState::kActive, {});
            scene.light.addActive(id, scene.table);
            scene.active.push_back(id);
        }
        std::sort(scene.active.begin(), scene.active.end());
    }
    ~Drive() {
        for (const world::CasterId id : casters_.active) casters_.table.remove(id);
        casters_.active.clear();
    }

    CullingCost cost(int rounds) {
        CullingCost cost{.motion = motion_.name, .frames = motion_.poses.size(), .stages = {}};
        listRects();
        if (!rects_.empty()) {
            cost.stages.push_back(octreeStage(rounds));
            cost.stages.push_back(casterStage(rounds));
            cost.stages.back().castersTested = cost.stages.front().castersFound;
            cost.stages.push_back(clusterStage(rounds));
        }
        cost.stages.push_back(planStage(rounds, cost));
        cost.stages.push_back(receiverStage(rounds));
        return cost;
    }

private:
    glm::dvec2 eye(const world::Pose& pose) const {
        return glm::dvec2(casters_.light.space().toLight(pose.position));
    }
    glm::dvec2 metres(int cascade, cache::Texel t) const {
        return glm::dvec2(t) * casters_.light.cascades()[size_t(cascade)].texel;
    }
    void listRects() {
        const cache::ShadowCache shadows(casters_.light.cascades(), config_);
        for (size_t k = 1; k < motion_.poses.size(); ++k)
            for (int c = 0; c < int(casters_.light.cascades().size()); ++c) {
                const cache::TexelRect before = shadows.windowAround(c, eye(motion_.poses[k - 1])),
                                       after = shadows.windowAround(c, eye(motion_.poses[k]));
                for (const cache::TexelRect& slab : cache::exposedSlabs(before.min, after.min, config_.side)) {
                    rects_.push_back({c, slab, {}});
                    cache::splitAtWrap(shadows.lattice(c), slab, rects_.back().pieces);
                }
            }
    }
    /// `visit(rect, min, max)` with the rectangle in metres, with the texel of room that drawing leaves.
    template <class Visit>
    void eachRect(Visit visit) const {
        for (const Rect& r : rects_)
            visit(r, metres(r.cascade, r.rect.min - cache::Texel(1)), metres(r.cascade, r.rect.max + cache::Texel(1)));
    }

    CullingStage octreeStage(int rounds) const {
        CullingStage stage{.name = "octree", .queries = rects_.size()};
        const glm::dmat3 rows = glm::transpose(casters_.light.space().lightFromWorld);
        world::TurnedBox column;
        column.axis = {rows[0], rows[1], rows[2]};
        std::vector<uint32_t> found;
        stage.ms = least(rounds, [&] {
            stage.castersFound = 0;
            eachRect([&](const Rect&, glm::dvec2 min, glm::dvec2 max) {
                column.lo = {min.x, min.y, -std::numeric_limits<double>::infinity()};
                column.hi = {max.x, max.y, std::numeric_limits<double>::infinity()};
                found.clear();
                casters_.statics.query(column, found);
                stage.castersFound += found.size();
            });
        });
        return stage;
    }
    CullingStage casterStage(int rounds) {
        CullingStage stage{.name = "casters", .queries = rects_.size()};
        stage.ms = least(rounds, [&] {
            stage.castersFound = 0;
            found_.clear();
            firstFound_.assign(1, 0);
            eachRect([&](const Rect&, glm::dvec2 min, glm::dvec2 max) {
                culling::castersOver(casters_.statics, casters_.light, min, max, query_);
                found_.insert(found_.end(), query_.begin(), query_.end());
                firstFound_.push_back(found_.size());
            });
        });
        stage.castersFound = found_.size();
        return stage;
    }
    CullingStage clusterStage(int rounds) {
        CullingStage stage{.name = "clusters"};
        cache::FramePlan plan;
        const cache::ShadowCache shadows(casters_.light.cascades(), config_);
        const cache::Scene scene = casters_.view();
        std::vector<cache::PlanWriter> writers;
        for (int c = 0; c < int(casters_.light.cascades().size()); ++c)
            writers.emplace_back(scene, config_.scene, c, shadows.lattice(c), plan);
        for (size_t r = 0; r < rects_.size(); ++r)
            for (size_t k = firstFound_[r]; k < firstFound_[r + 1]; ++k) {
                stage.castersTested += rects_[r].pieces.size();
                stage.clustersTested +=
                    rects_[r].pieces.size() * casters_.light.rects(found_[k], rects_[r].cascade).size();
            }
        std::vector<cache::DrawPass> passes;
        stage.ms = least(rounds, [&] {
            stage.clustersFound = stage.castersFound = stage.queries = 0;
            for (size_t r = 0; r < rects_.size(); ++r)
                for (const cache::Piece& piece : rects_[r].pieces) {
                    plan.reset(0);
                    passes.clear();
                    const auto counts = writers[size_t(rects_[r].cascade)].draw(
                        piece, std::span(found_).subspan(firstFound_[r], firstFound_[r + 1] - firstFound_[r]), false,
                        passes);
                    ++stage.queries;
                    stage.castersFound += counts.cost.casters;
                    stage.clustersFound += counts.clustersFound;
                }
        });
        return stage;
    }
    CullingStage planStage(int rounds, CullingCost& cost) {
        CullingStage stage{.name = "plan", .queries = motion_.poses.size()};
        cache::FramePlan plan;
        std::vector<cache::CascadeStatistics> statistics;
        std::vector<world::Box> dirt;
        stage.ms = std::numeric_limits<double>::infinity();
        for (int round = 0; round < rounds; ++round) {
            cache::ShadowCache shadows(casters_.light.cascades(), config_);
            stage.castersFound = stage.clustersFound = cost.planHash = 0;
            double ms = 0;
            for (size_t k = 0; k < motion_.poses.size(); ++k) {
                const world::Pose& pose = motion_.poses[k];
                dirt.clear();
                for (uint32_t m = 0; m < casters_.active.size(); ++m) {
                    const world::CasterId id = casters_.active[m];
                    dirt.push_back(casters_.light[id].bounds);
                    casters_.table.place(id, moverAt(m, pose.position, pose.time));
                    casters_.light.addActive(id, casters_.table);
                    dirt.push_back(casters_.light[id].bounds);
                }
                const double start = threadMs();
                plan.reset(casters_.light.cascades().size());
                shadows.plan(casters_.view(), {{}, {}, dirt},
                             {.eye = casters_.light.space().toLight(pose.position)}, plan, statistics);
                if (k > 0) ms += threadMs() - start;  // the first draws everything
                const uint64_t hash = plan.hash();
                cost.planHash = world::hashValues(std::span(&hash, 1), cost.planHash);
                for (const cache::CascadeStatistics& s : statistics) {
                    if (k == 0) break;
                    stage.castersFound += s.total.casters + s.active.casters;
                    stage.clustersFound += s.clustersFound;
                }
            }
            stage.ms = std::min(stage.ms, ms);
        }
        return stage;
    }
    CullingStage receiverStage(int rounds) const {
        CullingStage stage{.name = "receivers", .queries = motion_.poses.size()};
        stage.ms = least(rounds, [&] {
            for (const world::Pose& pose : motion_.poses)
                culling::unseenCascades({pose.position, pose.orientation, glm::radians(60.0), 16.0 / 9},
                                        casters_.light.cascades(), casters_.statics, casters_.table, casters_.active,
                                        false);
        });
        return stage;
    }

    Casters& casters_;
    const cache::CacheConfig& config_;
    const Motion& motion_;
    std::vector<Rect> rects_;
    std::vector<world::CasterId> query_, found_;
    std::vector<size_t> firstFound_;  ///< per rectangle, and the end
};

}  // namespace

Result<CullingBench> benchCulling(const world::WorldStore& store, std::span<const Motion> motions, int rounds) {
    const server::ShadowConfig defaults;
    const auto space = culling::makeLightSpace(store.header().sun);
    if (!space) return space.error();
    const auto cascades = culling::makeCascades(defaults.cascades, defaults.side, defaults.farDistance,
                                                defaults.splitRatio, defaults.guardBand);
    if (!cascades) return cascades.error();
    world::Box around;  // light space
    for (const Motion& motion : motions)
        for (const world::Pose& pose : motion.poses) around.add(space.value().toLight(pose.position));
    const double reach = cascades.value().back().texel * (defaults.side / 2.0 + defaults.guardBand) + kRoom;
    const auto wanted = [&](const world::Box& bounds) -> std::optional<world::Want> {
        const world::Box b = space.value().toLight(bounds);
        const bool near = b.min.x <= around.max.x + reach && b.max.x >= around.min.x - reach && b.min.y <= around.max.y + reach &&
               b.max.y >= around.min.y - reach && b.min.z <= around.max.z + reach;
        return near ? std::optional(world::Want{}) : std::nullopt;
    };
    Casters casters(store, space.value(), cascades.value());
    const std::optional<uint32_t> mesh = moverMesh(store);
    casters.streamer.want(wanted, 0);
    casters.fill(casters.streamer.advance(0), store.header().chunkSize);
    if (mesh)
        if (auto pinned = casters.streamer.pin(*mesh); !pinned) return pinned.error();

    CullingBench bench;
    bench.chunks = casters.streamer.residentChunks();
    bench.casters = casters.table.size();
    for (world::CasterId id = 0; id < casters.table.slots(); ++id)
        bench.clusters += casters.light.rects(id, 0).size();
    bench.wantedUs = 1e3 * least(rounds, [&] { casters.streamer.want(wanted, 0); });
    const world::Box extent = space.value().toLight(store.header().bounds);
    cache::CacheConfig config;
    config.guardBand = defaults.guardBand;
    config.side = defaults.side;
    config.scene = {extent.min.z, std::max(1.0, extent.extent().z)};
    for (const Motion& motion : motions)
        bench.costs.push_back(Drive(casters, config, motion, mesh).cost(rounds));
    return bench;
}

std::string cullingTable(const CullingBench& bench) {
    std::string text = format("in memory: %zu chunks, %zu casters, %zu clusters of the finest levels\n", bench.chunks,
                              bench.casters, bench.clusters);
    text += format("%-12s %-10s %7s  %8s %8s  %8s %8s  %9s %12s %11s\n", "motion", "stage", "queries", "casters",
                   "found", "clusters", "found", "us/frame", "1000 queries", "1e6 tests");
    text += format("%-12s %-10s %7s  %8s %8s  %8s %8s  %9s %12s %11s\n", "", "", "", "tested", "", "tested", "", "",
                   "a second", "a second");
    for (const CullingCost& cost : bench.costs) {
        for (const CullingStage& s : cost.stages) {
            const uint64_t tests = s.castersTested + s.clustersTested;
            text += format("%-12s %-10s %7llu  %8llu %8llu  %8llu %8llu  %9.2f %12.0f %11s\n", cost.motion.c_str(),
                           s.name.c_str(), static_cast<unsigned long long>(s.queries),
                           static_cast<unsigned long long>(s.castersTested),
                           static_cast<unsigned long long>(s.castersFound),
                           static_cast<unsigned long long>(s.clustersTested),
                           static_cast<unsigned long long>(s.clustersFound), 1e3 * s.ms / double(cost.frames),
                           double(s.queries) / s.ms, tests > 0 ? format("%.1f", double(tests) / s.ms / 1e3).c_str() : "-");
        }
        text += format("%-12s plans %016llx\n", cost.motion.c_str(), static_cast<unsigned long long>(cost.planHash));
    }
    text += format("chunks: %.1f us to find that all wanted ones are there\n", bench.wantedUs);
    return text;
}

}  // namespace tools
