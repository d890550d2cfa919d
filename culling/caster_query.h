// culling/caster_query.h — which casters can reach a rectangle of the map plane.
#pragma once

#include <span>
#include <vector>

#include "culling/light_casters.h"
#include "world/octree.h"

namespace culling {

/// Casters of the octree whose light-space bounds meet the rectangle [min, max] [m], at any depth:
/// all that lies on the way between the sun and the rectangle, and behind it.
///   casters  replaced; ascending
void castersOver(const world::Octree& octree, const LightCasters& light, glm::dvec2 min, glm::dvec2 max,
                 std::vector<world::CasterId>& casters);

/// Bounds of some casters in the map plane, kept as rows for many questions, in single precision and rounded
/// outwards. Keeps its memory.
class CasterRows {
public:
    /// `casters` as they lie now, in their order.
    void fill(const LightCasters& light, std::span<const world::CasterId> casters);
    /// Those whose bounds meet the rectangle [min, max] [m], and perhaps some that all but meet it, in order.
    ///   casters  replaced
    void over(glm::dvec2 min, glm::dvec2 max, std::vector<world::CasterId>& casters) const;

private:
    std::vector<world::CasterId> ids_;
    glm::dvec2 origin_{0};  ///< of the rows [m]
    std::vector<float> minX_, minY_, maxX_, maxY_;
};

}  // namespace culling
