#include "cache/spot_cache.h"

#include <algorithm>
#include <optional>

namespace cache {

namespace {

/// Writes one light's draws: whole casters cut down to the clusters that touch the map.
class SpotWriter {
public:
    SpotWriter(const culling::SpotSpace& space, const Scene& scene, const GeometryOf& geometry, size_t map,
               FramePlan& plan)
        : space_(space),
          scene_(scene),
          geometry_(geometry),
          map_(plan.cascades[map]),
          plan_(plan),
          whole_{glm::ivec2(0), glm::ivec2(space.light.side)} {}

    world::Result<world::Done> drawStatics(Cost& cost) {
        std::vector<world::CasterId> casters;
        culling::castersIn(space_, scene_.statics, scene_.table, casters);
        map_.clears.push_back(whole_);
        return draw(casters, map_.staticPasses, cost);
    }
    world::Result<world::Done> drawActive(Cost& cost) {
        map_.restores.push_back(whole_);
        return draw(scene_.active, map_.activePasses, cost);
    }

private:
    world::Result<world::Done> draw(std::span<const world::CasterId> casters, std::vector<DrawPass>& passes,
                                    Cost& cost);
    world::Result<world::Done> add(world::CasterId caster, Cost& cost);

    const culling::SpotSpace& space_;
    const Scene& scene_;
    const GeometryOf& geometry_;
    CascadePlan& map_;
    FramePlan& plan_;
    const StoreRect whole_;
};

world::Result<world::Done> SpotWriter::draw(std::span<const world::CasterId> casters, std::vector<DrawPass>& passes,
                                            Cost& cost) {
    const auto side = static_cast<uint64_t>(space_.light.side);
    cost.texels += side * side;
    const auto first = static_cast<uint32_t>(plan_.items.size());
    for (const world::CasterId caster : casters)
        if (space_.touches(space_.toLight(scene_.table[caster].bounds)))
            if (auto added = add(caster, cost); !added) return added;
    const auto count = static_cast<uint32_t>(plan_.items.size()) - first;
    if (count > 0) passes.push_back({whole_, first, count});
    return world::Done{};
}

world::Result<world::Done> SpotWriter::add(world::CasterId id, Cost& cost) {
    const world::Placement& placement = scene_.table[id].placement;
    const glm::dmat3 linear = space_.lightFromWorld * glm::dmat3(placement.linear);
    const glm::dvec3 origin = space_.toLight(placement.translation);
    const size_t at = culling::spotLevel(space_, scene_.table, id);
    const auto geometry = geometry_(id, at);
    if (!geometry) return geometry.error();
    bool placed = false;
    for (const world::Cluster& run : scene_.table.meshOf(id).levels[at].clusters) {
        const world::Box box = world::transformed({glm::dvec3(run.min), glm::dvec3(run.max)}, linear, origin);
        if (!space_.touches(box)) continue;
        cost.triangles += run.indexCount / 3;
        if (placed && plan_.items.back().firstIndex + plan_.items.back().indexCount == run.firstIndex) {
            plan_.items.back().indexCount += run.indexCount;
            continue;
        }
        if (!placed) {
            // In double precision, rounded once: a function of light and caster alone.
            const glm::dvec3 scale = glm::dvec3(1 / space_.slope, 1 / space_.slope, 1) / space_.light.near;
            glm::mat3x4 rows;
            for (int axis = 0; axis < 3; ++axis) {
                for (int k = 0; k < 3; ++k) rows[axis][k] = static_cast<float>(linear[k][axis] * scale[axis]);
                rows[axis][3] = static_cast<float>(origin[axis] * scale[axis]);
            }
            plan_.transforms.push_back(rows);
            placed = true;
            ++cost.casters;
        }
        plan_.items.push_back(
            {geometry.value(), run.firstIndex, run.indexCount, static_cast<uint32_t>(plan_.transforms.size() - 1)});
        ++cost.draws;
    }
    return world::Done{};
}

}  // namespace

double distanceOf(float depth, double near) {
    const double kept = (1 - double(depth)) / (1 - double(kNearestDepth));  // near / z
    return near / kept;
}

void SpotCache::turn(const culling::SpotSpace& space) {
    if (space.light != wanted_.light) wanted_ = space;
}

world::Result<world::Done> SpotCache::plan(const Scene& scene, const Events& events, const GeometryOf& geometry,
                                           size_t map, FramePlan& plan, SpotStatistics& statistics) {
    CHECK(map < plan.cascades.size());
    std::optional<Cause> cause;
    const auto note = [&cause](Cause c) { cause = std::min(cause.value_or(c), c); };
    if (!drawn_ || wanted_.light != held_.light) note(Cause::kStart);
    held_ = wanted_;
    drawn_ = true;
    const auto touched = [this](const world::Box& world) { return held_.touches(held_.toLight(world)); };
    if (sabotage_ != Sabotage::kDeafDeparture)
        for (const Departure& d : events.departures)
            if (touched(d.bounds)) note(d.cause);
    for (const Arrival& a : events.arrivals)  // what level the cascades draw is nothing to a light
        if (a.cause != Cause::kLevel && touched(scene.table[a.caster].bounds)) note(a.cause);

    SpotWriter writer(held_, scene, geometry, map, plan);
    if (cause) {
        statistics.cause = *cause;
        if (auto drawn = writer.drawStatics(statistics.statics); !drawn) return drawn;
    }
    if (!cause && std::none_of(events.activeDirt.begin(), events.activeDirt.end(), touched)) return world::Done{};
    return writer.drawActive(statistics.active);
}

world::Result<world::Done> SpotCache::planRedraw(const Scene& scene, const GeometryOf& geometry, size_t map,
                                                 FramePlan& plan) const {
    CHECK(map < plan.cascades.size());
    SpotWriter writer(held_, scene, geometry, map, plan);
    Cost statics, active;
    if (auto drawn = writer.drawStatics(statics); !drawn) return drawn;
    return writer.drawActive(active);
}

}  // namespace cache
