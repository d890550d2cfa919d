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

void CasterRows::fill(const LightCasters& light, std::span<const world::CasterId> casters) {
    ids_.assign(casters.begin(), casters.end());
    for (auto* row : {&minX_, &minY_, &maxX_, &maxY_}) row->resize(casters.size());
    origin_ = casters.empty() ? glm::dvec2(0) : glm::dvec2(light[casters.front()].origin);
    for (size_t k = 0; k < casters.size(); ++k) {
        const world::Box& b = light[casters[k]].bounds;
        minX_[k] = roundedDown(b.min.x - origin_.x);
        minY_[k] = roundedDown(b.min.y - origin_.y);
        maxX_[k] = roundedUp(b.max.x - origin_.x);
        maxY_[k] = roundedUp(b.max.y - origin_.y);
    }
}

void CasterRows::over(glm::dvec2 min, glm::dvec2 max, std::vector<world::CasterId>& casters) const {
    casters.clear();
    const glm::dvec2 low = min - origin_, high = max - origin_;
    eachMeeting({minX_.data(), minY_.data(), maxX_.data(), maxY_.data(), ids_.size()},
                {roundedDown(low.x), roundedDown(low.y)}, {roundedUp(high.x), roundedUp(high.y)},
                [&](size_t k) { casters.push_back(ids_[k]); });
}

}  // namespace culling
