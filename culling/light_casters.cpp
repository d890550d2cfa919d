#include "culling/light_casters.h"

#include <algorithm>

namespace culling {

LightCasters::LightCasters(const LightSpace& space, std::vector<Cascade> cascades, const Detail& detail)
    : space_(space), detail_(detail), cascades_(std::move(cascades)) {
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
    const double factor = world::stretch(placement);
    for (size_t c = 0; c < cascades_.size(); ++c) {
        size_t level = mesh.levels.size() - 1;
        while (level > 0 && mesh.levels[level].error * factor > detail_.levelError * cascades_[c].texel) --level;
        caster.level[c] = static_cast<uint8_t>(level);
    }
    return caster;
}

void LightCasters::drop(LightCaster& caster) const {
    caster.dropped = 0;
    const glm::dvec2 size(caster.bounds.extent());
    for (size_t c = 0; c < cascades_.size(); ++c)
        if (std::max(size.x, size.y) < detail_.smallestTexels * cascades_[c].texel) caster.dropped |= 1u << c;
}

template <class Bounds>
void LightCasters::fit(LightCaster& caster, const world::Mesh& mesh, Bounds bounds) const {
    caster.rects.clear();
    for (size_t c = 0; c < cascades_.size(); ++c) {
        const auto known = std::find(caster.level.begin(), caster.level.begin() + std::ptrdiff_t(c), caster.level[c]);
        if (const auto same = size_t(known - caster.level.begin()); same < c) {
            caster.firstRect[c] = caster.firstRect[same];
            caster.rectCount[c] = caster.rectCount[same];
            continue;
        }
        const world::MeshLevel& level = mesh.levels[caster.level[c]];
        const size_t first = caster.rects.size(), count = level.clusters.size();
        caster.firstRect[c] = static_cast<uint32_t>(first);
        caster.rectCount[c] = static_cast<uint32_t>(count);
        caster.rects.resize(first + 4 * count);
        float* const to = caster.rects.data() + first;
        for (size_t k = 0; k < count; ++k) {
            const world::Box box = bounds(level, level.clusters[k]);
            to[k] = roundedDown(box.min.x);
            to[count + k] = roundedDown(box.min.y);
            to[2 * count + k] = roundedUp(box.max.x);
            to[3 * count + k] = roundedUp(box.max.y);
            caster.bounds.add({box.min + caster.origin, box.max + caster.origin});
        }
    }
}

void LightCasters::addStatic(world::CasterId id, const world::CasterTable& table) {
    LightCaster& caster = place(id, table);
    std::vector<glm::dvec3> placed;
    const world::MeshLevel* placedLevel = nullptr;
    fit(caster, table.meshOf(id), [&](const world::MeshLevel& level, const world::Cluster& cluster) {
        if (placedLevel != &level) {
            placedLevel = &level;
            placed.clear();
            placed.reserve(level.positions.size());
            for (const glm::vec3& p : level.positions) placed.push_back(caster.lightFromMesh * glm::dvec3(p));
        }
        world::Box box;
        for (uint32_t i = 0; i < cluster.indexCount; ++i) box.add(placed[level.indices[cluster.firstIndex + i]]);
        return box;
    });
    drop(caster);
}

void LightCasters::addActive(world::CasterId id, const world::CasterTable& table) {
    LightCaster& caster = place(id, table);
    fit(caster, table.meshOf(id), [&](const world::MeshLevel&, const world::Cluster& cluster) {
        return world::transformed({glm::dvec3(cluster.min), glm::dvec3(cluster.max)}, caster.lightFromMesh,
                                  glm::dvec3(0));
    });
    caster.bounds = world::grown(caster.bounds, double(table[id].margin));
    drop(caster);
}

}  // namespace culling
