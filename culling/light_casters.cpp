#include "culling/light_casters.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace culling {

namespace {

/// The next floats outwards, so that narrowing never shrinks a rectangle.
ClusterRect outwards(glm::dvec2 min, glm::dvec2 max) {
    constexpr float inf = std::numeric_limits<float>::infinity();
    return {{std::nextafter(float(min.x), -inf), std::nextafter(float(min.y), -inf)},
            {std::nextafter(float(max.x), inf), std::nextafter(float(max.y), inf)}};
}

}  // namespace

LightCasters::LightCasters(const LightSpace& space, std::vector<Cascade> cascades, double smallestTexels)
    : space_(space), smallestTexels_(smallestTexels), cascades_(std::move(cascades)) {
    CHECK(!cascades_.empty() && cascades_.size() <= kMaxCascades);
}

LightCaster& LightCasters::place(world::CasterId id, const world::CasterTable& table) {
    if (casters_.size() <= id) casters_.resize(id + 1);
    LightCaster& caster = casters_[id];
    const world::Placement& placement = table[id].placement;
    const world::Mesh& mesh = table.meshOf(id);
    caster.lightFromMesh = space_.lightFromWorld * glm::dmat3(placement.linear);
    caster.origin = space_.toLight(placement.translation);
    caster.bounds = {};
    caster.rects.resize(mesh.levels.size());
    for (auto& rects : caster.rects) rects.clear();
    const double factor = world::stretch(placement);
    for (size_t c = 0; c < cascades_.size(); ++c) {
        size_t level = mesh.levels.size() - 1;
        while (level > 0 && mesh.levels[level].error * factor > kLevelErrorTexels * cascades_[c].texel) --level;
        caster.level[c] = static_cast<uint8_t>(level);
    }
    return caster;
}

void LightCasters::drop(LightCaster& caster) const {
    caster.dropped = 0;
    const glm::dvec2 size(caster.bounds.extent());
    for (size_t c = 0; c < cascades_.size(); ++c)
        if (std::max(size.x, size.y) < smallestTexels_ * cascades_[c].texel) caster.dropped |= 1u << c;
}

void LightCasters::addStatic(world::CasterId id, const world::CasterTable& table) {
    LightCaster& caster = place(id, table);
    const world::Mesh& mesh = table.meshOf(id);
    std::vector<glm::dvec3> placed;
    for (size_t c = 0; c < cascades_.size(); ++c) {
        const size_t at = caster.level[c];
        if (!caster.rects[at].empty()) continue;
        const world::MeshLevel& level = mesh.levels[at];
        placed.clear();
        placed.reserve(level.positions.size());
        for (const glm::vec3& p : level.positions) placed.push_back(caster.lightFromMesh * glm::dvec3(p));
        caster.rects[at].reserve(level.clusters.size());
        for (const world::Cluster& cluster : level.clusters) {
            world::Box box;
            for (uint32_t i = 0; i < cluster.indexCount; ++i) box.add(placed[level.indices[cluster.firstIndex + i]]);
            caster.rects[at].push_back(outwards(glm::dvec2(box.min), glm::dvec2(box.max)));
            caster.bounds.add({box.min + caster.origin, box.max + caster.origin});
        }
    }
    drop(caster);
}

void LightCasters::addActive(world::CasterId id, const world::CasterTable& table) {
    LightCaster& caster = place(id, table);
    const world::Mesh& mesh = table.meshOf(id);
    for (size_t c = 0; c < cascades_.size(); ++c) {
        const size_t at = caster.level[c];
        if (!caster.rects[at].empty()) continue;
        const world::MeshLevel& level = mesh.levels[at];
        caster.rects[at].reserve(level.clusters.size());
        for (const world::Cluster& cluster : level.clusters) {
            const world::Box box = world::transformed({glm::dvec3(cluster.min), glm::dvec3(cluster.max)},
                                                      caster.lightFromMesh, glm::dvec3(0));
            caster.rects[at].push_back(outwards(glm::dvec2(box.min), glm::dvec2(box.max)));
            caster.bounds.add({box.min + caster.origin, box.max + caster.origin});
        }
    }
    caster.bounds = world::grown(caster.bounds, double(table[id].margin));
    drop(caster);
}

}  // namespace culling
