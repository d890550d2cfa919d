#include "culling/receivers.h"

#include <array>
#include <cmath>

namespace culling {

namespace {

/// The pyramid's four sides: a point is inside while dot(normal, p - eye) >= 0 for all.
std::array<glm::dvec3, 4> sides(const View& view) {
    const double up = std::tan(view.verticalFov / 2), right = up * view.aspect;
    return {view.orientation * glm::dvec3(1, 0, -right), view.orientation * glm::dvec3(-1, 0, -right),
            view.orientation * glm::dvec3(0, 1, -up), view.orientation * glm::dvec3(0, -1, -up)};
}

}  // namespace

uint32_t unseenCascades(const View& view, std::span<const Cascade> cascades, const world::Octree& statics,
                        const world::CasterTable& table, std::span<const world::CasterId> active,
                        bool servesNearer) {
    if (view.verticalFov <= 0) return 0;
    const std::array<glm::dvec3, 4> normals = sides(view);
    uint32_t unseen = 0;
    double from = 0;
    for (size_t c = 0; c < cascades.size(); ++c) {
        const double to = cascades[c].split;
        const auto seen = [&](const world::Box& box) {
            const glm::dvec3 low = box.min - view.eye, high = box.max - view.eye;
            const glm::dvec3 nearest = glm::clamp(glm::dvec3(0), low, high);
            const glm::dvec3 farthest = glm::max(glm::abs(low), glm::abs(high));
            if (glm::dot(nearest, nearest) > to * to || glm::dot(farthest, farthest) < from * from) return false;
            for (const glm::dvec3& n : normals) {
                const glm::dvec3 most(n.x > 0 ? high.x : low.x, n.y > 0 ? high.y : low.y, n.z > 0 ? high.z : low.z);
                if (glm::dot(n, most) < 0) return false;
            }
            return true;
        };
        bool any = statics.any(seen);
        for (size_t i = 0; i < active.size() && !any; ++i) any = seen(table[active[i]].bounds);
        if (!any) unseen |= 1u << c;
        // Filters at a split read a few texels of the next cascade's side of it.
        if (!servesNearer) from = std::max(0.0, to - kWindowMargin * cascades[c].texel);
    }
    return unseen;
}

}  // namespace culling
