// culling/light_space.h — the fixed sun-aligned frame in which shadow maps live.
#pragma once

#include <glm/glm.hpp>

#include "world/box.h"
#include "world/mesh.h"
#include "world/result.h"

namespace culling {

/// Sun-aligned metres: x, y span the map plane, z runs with the light, away from the sun; the origin
/// is the world's origin. Depends on the sun's direction alone, so a point keeps its coordinates
/// whatever the camera does.
struct LightSpace {
    glm::dvec3 sun{0, -1, 0};        ///< direction of the light's travel, unit
    glm::dmat3 lightFromWorld{1};    ///< rotation
    glm::dvec3 toLight(glm::dvec3 pWorld) const { return lightFromWorld * pWorld; }
    glm::dvec3 toWorld(glm::dvec3 pLight) const { return glm::transpose(lightFromWorld) * pLight; }
    world::Box toLight(const world::Box& box) const {
        return world::transformed(box, lightFromWorld, glm::dvec3(0));
    }
};

/// Lowest sun that a shadow map can serve [radians above the horizon]: below it a caster's shadow is
/// longer than 57 times its height and no window holds it.
constexpr double kLowestSun = 0.0174532925199433;

/// The frame of a sun. kUsage for a direction that is not finite, has no length, or comes from
/// lower than kLowestSun. A sun straight overhead is fine: the map's axes then follow world x and z.
world::Result<LightSpace> makeLightSpace(glm::dvec3 sunDirection);

/// Direction of travel of the light of a sun seen at `azimuth` (clockwise from north, -z; east is
/// +x) and `elevation` above the horizon [radians].
glm::dvec3 sunFromAngles(double azimuth, double elevation);

}  // namespace culling
