// culling/receivers.h — which cascades nobody can see the shadows of.
// Source: our own.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <glm/gtc/quaternion.hpp>
#include <span>

#include "culling/cascades.h"
#include "world/casters.h"
#include "world/octree.h"

namespace culling {

/// A camera as far as it matters to what it can see.
struct View {
    glm::dvec3 eye{0};  ///< world [m]
    glm::dquat orientation{1, 0, 0, 0};  ///< camera-to-world, looks along -z
    double verticalFov = 0;  ///< [rad], 0 or in (0, pi); 0: it may look anywhere
    double aspect = 1;       ///< width over height, > 0
};

/// Cascades (bit c) that serve nothing the view can see: no caster, taken as its bounds, is in the
/// view's pyramid between the split before and the cascade's own. Casters are the receivers: a world
/// holds no others.
///   statics        world bounds of the static casters
///   active         the others, by id
///   servesNearer   every cascade must be able to stand in for those before it: nearer receivers count
uint32_t unseenCascades(const View& view, std::span<const Cascade> cascades, const world::Octree& statics,
                        const world::CasterTable& table, std::span<const world::CasterId> active,
                        bool servesNearer);

}  // namespace culling
