#include "culling/spot_light.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace culling {

namespace {

world::Error usage(const char* what, double value, const char* remedy) {
    char text[160];
    std::snprintf(text, sizeof text, "%s %g: %s", what, value, remedy);
    return {world::ErrorCode::kUsage, text};
}

bool finite(glm::dvec3 v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

}  // namespace

bool SpotSpace::touchesWithin(const world::Box& b, glm::dvec2 low, glm::dvec2 high) const {
    const double from = std::max(b.min.z, light.near), to = std::min(b.max.z, light.range);
    if (!(from <= to)) return false;
    // The box's section at z is the same for all z; the map's side widens or narrows evenly with z, so the
    // nearest or the farthest z decides.
    for (int axis = 0; axis < 2; ++axis) {
        const double most = std::max(high[axis] * from, high[axis] * to);
        const double least = std::min(low[axis] * from, low[axis] * to);
        if (b.min[axis] > most || b.max[axis] < least) return false;
    }
    return true;
}

world::Result<SpotSpace> makeSpotSpace(const SpotLight& light) {
    if (!finite(light.position))
        return world::Error{world::ErrorCode::kUsage, "its position is not finite; give metres in the world"};
    const double length = glm::length(light.direction);
    if (!std::isfinite(length) || length <= 0)
        return world::Error{world::ErrorCode::kUsage, "its direction is not a finite vector with a length; give one"};
    if (!(light.halfAngle >= kNarrowestSpot && light.halfAngle <= kWidestSpot))
        return usage("half-angle", light.halfAngle, "give radians from 0.001 to 1.5 (86 degrees)");
    if (!(light.range > 0 && std::isfinite(light.range))) return usage("range", light.range, "give metres above 0");
    if (!(light.near > 0 && light.near < light.range))
        return usage("near", light.near, "give metres above 0 and below the range");
    if (light.range > kMostReach * light.near)
        return usage("range", light.range, "more than 10,000 times near; lower it, or give a larger near");
    if (light.side < 64 || light.side > 4096) return usage("resolution", light.side, "give 64 to 4096 texels");
    SpotSpace space;
    space.light = light;
    const glm::dvec3 z = space.light.direction = light.direction / length;
    // Any fixed rule for x will do, as long as it depends on the axis alone.
    const glm::dvec3 helper = std::abs(z.x) < 0.9 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 0, 1);
    const glm::dvec3 y = glm::normalize(glm::cross(z, helper));
    space.lightFromWorld = glm::transpose(glm::dmat3(glm::cross(y, z), y, z));
    space.slope = std::tan(light.halfAngle);
    return space;
}

void castersIn(const SpotSpace& space, const world::Octree& octree, const world::CasterTable& table,
               std::vector<world::CasterId>& casters) {
    casters.clear();
    const glm::dmat3 rows = glm::transpose(space.lightFromWorld);
    const glm::dvec3 at = space.lightFromWorld * space.light.position;
    const double reach = space.light.range * space.slope;
    world::TurnedBox around;
    around.axis = {rows[0], rows[1], rows[2]};
    around.lo = at + glm::dvec3(-reach, -reach, space.light.near);
    around.hi = at + glm::dvec3(reach, reach, space.light.range);
    octree.query(around, casters);
    std::erase_if(casters, [&](world::CasterId id) { return !space.touches(space.toLight(table[id].bounds)); });
}

size_t spotLevel(const SpotSpace& space, const world::CasterTable& table, world::CasterId caster) {
    const world::Caster& c = table[caster];
    const world::Mesh& mesh = table.meshOf(caster);
    const double nearest = std::max(space.toLight(c.bounds).min.z, space.light.near);
    const double most = kSpotLevelError * space.texelAt(nearest), factor = world::stretch(c.placement);
    size_t level = mesh.levels.size() - 1;
    while (level > 0 && mesh.levels[level].error * factor > most) --level;
    return level;
}

}  // namespace culling
