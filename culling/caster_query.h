// culling/caster_query.h — which casters can reach a rectangle of the map plane.
#pragma once

#include <vector>

#include "culling/light_casters.h"
#include "world/octree.h"

namespace culling {

/// Casters of the octree whose light-space bounds meet the rectangle [min, max] [m], at any depth:
/// all that lies on the way between the sun and the rectangle, and behind it.
///   casters  replaced; ascending
void castersOver(const world::Octree& octree, const LightCasters& light, glm::dvec2 min, glm::dvec2 max,
                 std::vector<world::CasterId>& casters);

}  // namespace culling
