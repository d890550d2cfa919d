// server/shading.h — the light at points of the view as a deferred pass would find it in a method's maps.
// Sources: Williams, "Casting Curved Shadows on Curved Surfaces", 1978; Reeves, Salesin & Cook, "Rendering
// Antialiased Shadows with Depth Maps", 1987 (depths are compared before they are averaged); Schueler, "Eliminating
// Surface Acne with Gradient Shadow Maps", ShaderX4, 2006 (the gradient bias).
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "culling/shadow_views.h"

namespace server {

/// Most that a point's own plane falls on the way to a tap (ShadowBias::plane) [texels]: of ground under a sun at 2
/// degrees, 1.4 texels away.
constexpr double kMostFall = 40;

/// A point that asks for light.
struct Receiver {
    glm::dvec3 point{0};  ///< world [m]
    glm::vec3 normal{0};  ///< of the surface, unit, on the side that faces the sun
    uint32_t pixel = 0;   ///< turns the rotated filters: the same number, the same angle
};

struct ReceiverLight {
    float light = 1;       ///< from 0, in shadow, to 1
    float texel = 0;       ///< longer edge of the texel that answered [m]; 0: no map did, and the point counts as lit
    int8_t view = -1;      ///< that answered; where two are blended, the first; -1: none
    bool tapLeft = false;  ///< a tap fell beside the map, and counted as lit
};

/// Light for each receiver, in their order. A map answers for a point that lies on it, in the rectangle and the
/// depths of its view; where a texel that the filter needs is unknown, the next coarser one is asked.
///   views   what `viewsOf` made of `method` and `camera`
///   images  a map each, row by row, side * side depths as maps store them (cache/frame_plan.h). Row y covers clip y
///           from -1 + 2 y / side on, column x clip x likewise
/// Runs on all threads; the answers do not depend on how many.
std::vector<ReceiverLight> shade(const culling::ShadowMethod& method, std::span<const culling::ShadowView> views,
                                 const culling::LightSpace& light, const culling::View& camera,
                                 std::span<const std::span<const float>> images, std::span<const Receiver> receivers);

}  // namespace server
