// culling/spot_light.h — a cone of light: its frame, the square map around it, and what can cast into it.
// Source: Williams, "Casting Curved Shadows on Curved Surfaces", 1978 (a map from the light's place).
#pragma once

#include <vector>

#include "world/casters.h"
#include "world/octree.h"
#include "world/result.h"

namespace culling {

struct SpotLight {
    glm::dvec3 position{0};   ///< world [m]
    glm::dvec3 direction{0};  ///< of the cone's axis; any length above 0
    double halfAngle = 0.5;   ///< between the axis and the cone's edge [rad], kNarrowestSpot to kWidestSpot
    double near = 0.1;        ///< what is nearer than this along the axis casts nothing [m], > 0
    double range = 30;        ///< how far from its position it shines [m], > near, at most kMostReach times near
    int side = 512;           ///< texels a side of its maps, 64 to 4096
    friend bool operator==(const SpotLight&, const SpotLight&) = default;
};

constexpr double kNarrowestSpot = 0.001;  ///< [rad]: less is a ray
constexpr double kWidestSpot = 1.5;       ///< [rad]: beyond it a flat map holds nearly nothing but its rim
/// A light draws the coarsest level of detail whose error is at most this fraction of its texel.
constexpr double kSpotLevelError = 0.5;
/// At the end of the range two float depths are at most range * kMostReach * 2^-24 apart: 0.6 mm a metre.
constexpr double kMostReach = 10000;

/// A light's own frame: x, y span its map, z runs along its axis, the origin is its position. The map is the
/// square around the cone: it holds what satisfies |x|, |y| <= z * tan(halfAngle).
struct SpotSpace {
    SpotLight light;  ///< direction unit
    glm::dmat3 lightFromWorld{1};  ///< rotation
    double slope = 1;  ///< tan(halfAngle)

    glm::dvec3 toLight(glm::dvec3 pWorld) const { return lightFromWorld * (pWorld - light.position); }
    world::Box toLight(const world::Box& box) const {
        return world::transformed({box.min - light.position, box.max - light.position}, lightFromWorld, glm::dvec3(0));
    }
    /// Edge of a texel at distance z along the axis [m].
    double texelAt(double z) const { return 2 * z * slope / light.side; }
    /// Where a point of the light's frame falls on the map [texels]; z > 0.
    glm::dvec2 onMap(glm::dvec3 pLight) const {
        return (glm::dvec2(pLight) / (pLight.z * slope) + 1.0) * (light.side / 2.0);
    }
    /// False only if no point of the box, in the light's frame, lies between near and range along the axis
    /// with low <= x / z, y / z <= high. A texel's centre is half a texel inside the map, farther than any
    /// rounding here.
    bool touchesWithin(const world::Box& boxLight, glm::dvec2 low, glm::dvec2 high) const;
    /// The same for the whole map.
    bool touches(const world::Box& boxLight) const {
        return touchesWithin(boxLight, glm::dvec2(-slope), glm::dvec2(slope));
    }
};

/// kUsage for what is not finite or out of range: the text names the number and what to give.
world::Result<SpotSpace> makeSpotSpace(const SpotLight& light);

/// Casters of the octree whose bounds touch the light's map.
///   casters  replaced; ascending
void castersIn(const SpotSpace& space, const world::Octree& octree, const world::CasterTable& table,
               std::vector<world::CasterId>& casters);

/// The coarsest level of the caster's mesh whose error is at most kSpotLevelError of a texel where the
/// caster's bounds come nearest along the axis.
size_t spotLevel(const SpotSpace& space, const world::CasterTable& table, world::CasterId caster);

}  // namespace culling
