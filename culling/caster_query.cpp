#include "culling/caster_query.h"

#include <algorithm>

namespace culling {

void castersOver(const world::Octree& octree, const LightCasters& light, glm::dvec2 min, glm::dvec2 max,
                 std::vector<world::CasterId>& casters) {
    casters.clear();
    const glm::dmat3 rows = glm::transpose(light.space().lightFromWorld);
    world::TurnedBox column;
    column.axis = {rows[0], rows[1], rows[2]};
    column.lo = {min.x, min.y, -std::numeric_limits<double>::infinity()};
    column.hi = {max.x, max.y, std::numeric_limits<double>::infinity()};
    octree.query(column, casters);
    // The octree knows world boxes only; the light-space bounds are tighter.
    std::erase_if(casters, [&](world::CasterId id) {
        const world::Box& b = light[id].bounds;
        return b.min.x > max.x || b.max.x < min.x || b.min.y > max.y || b.max.y < min.y;
    });
}

}  // namespace culling
