// culling/warped_views.h — maps whose texels grow with the distance from the eye: facets, and LiSPSM.
// Sources: Tran, "Facetted Shadow Mapping for Large Dynamic Game Environments", 2009; Wimmer, Scherzer & Purgathofer,
// "Light Space Perspective Shadow Maps", 2004.
#pragma once

#include "culling/shadow_views.h"

namespace culling {

/// The camera in light space. What it sees at depth d are the points eye + d (forward + a right + b up), with a and b
/// in [-1, 1].
struct Pyramid {
    glm::dvec3 eye{0}, forward{0}, right{0}, up{0};
    double diagonal =
        0;  ///< tangent of half the angle from corner to corner; however the camera is turned, the same bits
};

Pyramid pyramidOf(const LightSpace& light, const View& camera);

/// Of the slice between two distances along the view, the nearer end first. Light space [m].
std::array<glm::dvec3, 8> cornersOf(const Pyramid& view, double from, double to);

/// Depths that a map tells apart, along the light [m].
struct Depths {
    double near = 0, length = 1;
};

/// One view per facet, counterclockwise from light space's x, all on map 0. A facet is warped along its middle F by
///   x = d x / (F.p + S), d = (D + S) / D, S = facetDetail * D,
/// the same for y, p measured from the eye: F D falls on the polygon's edge, and neighbours agree where they meet,
/// since F.p is the same for both there. The polygon touches the map's edge. D is so much more than `far` that
/// kWindowMargin texels are left beyond it. Depths, too, are divided by w = (F.p + S) / S.
std::vector<ShadowView> facetViews(const ShadowMethod& method, const Pyramid& pyramid, double near, double far,
                                   const Depths& depths);

/// The whole view in one map, its x along the view: seen by a perspective whose centre lies n = (z_n + sqrt(z_n z_f))
/// / sin(gamma) before the view's nearest point along the map, gamma being the angle between view and light, z_n and
/// z_f `near` and `far`. Where gamma is 0 it is the plain map. No margin is left: at the far end it would be longer
/// than the view.
ShadowView warpedView(const ShadowMethod& method, const Pyramid& pyramid, double near, double far,
                      const Depths& depths);

}  // namespace culling
