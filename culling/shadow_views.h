// culling/shadow_views.h — the maps that a method draws for one frame: how light space falls on each.
#pragma once

#include <array>
#include <glm/glm.hpp>
#include <vector>

#include "culling/light_space.h"
#include "culling/receivers.h"
#include "culling/shadow_method.h"
#include "world/box.h"
#include "world/result.h"

namespace culling {

/// How light space falls on one map. Several may share a map: the facets.
struct ShadowView {
    /// Light space [m], relative to `origin`, to clip space: x and y in [-w, w] with y down the image, depth in [0,
    /// w]. w depends on x and y alone, so that a ray of light stays in one place.
    glm::dmat4 clipFromLight{1};
    glm::dvec3 origin{0};  ///< light space [m]
    /// Half planes (a, b, c) of clip space, a x + b y + c w >= 0, outside of which it draws nothing and answers for
    /// nothing; zeros: everywhere.
    std::array<glm::dvec3, 2> wedge{};
    glm::dvec2 low{0}, high{0};  ///< rectangle of the map plane that holds all it draws, light space [m]
    double begin = 0,
           end = 0;    ///< of the interval that it serves, along the view [m]; around the eye: `end` away from it
    double texel = 0;  ///< edge of its finest texels [m]
    double depthRange = 0;  ///< from depth 0 to depth 1 at w = 1 [m]
    int map = 0;            ///< that it is drawn to
    bool statics = false;   ///< static casters alone, and the same whatever the camera does
};

/// Units of a 16 bit depth in a view's range: between the first that a caster leaves, 1, and that of an empty texel,
/// 65535.
constexpr double kDepthUnits = 65534;

/// Where the slices of a view end, ascending, the last at `far` exactly. 0 < near < far. By `ratio` they are counted
/// from `far`, whatever `near` is; none ends before it.
std::vector<double> splitsOf(const Splits& splits, double near, double far);

/// The views of a frame, finest first; those of one map follow each other. A pure function of its arguments. Squares
/// and boxes leave kWindowMargin texels (and half a guard band) on each side for the snap and for filters.
///   method     one that requireMethod has nothing against
///   camera     with a field of view, but for kEyeBox and kFacets, which do not look at it
///   near, far  of what is to be shadowed, along the view [m]; for kEyeBox and kFacets away from the eye
///   scene      bounds of all that casts or receives, world [m]; not empty
std::vector<ShadowView> viewsOf(const ShadowMethod& method, const LightSpace& light, const View& camera, double near,
                                double far, const world::Box& scene);

/// The edges of the texel, along x and y of the map, where light space's (x, y), relative to the view's origin,
/// falls: columns, light space [m]. w > 0 there.
glm::dmat2 texelEdges(const ShadowView& view, int side, glm::dvec2 pLight);

/// The named methods, each as its source has it; in the order in which they are listed to users.
std::vector<ShadowMethod> namedMethods();
/// kUsage for a name that there is not; the text names the nearest.
world::Result<ShadowMethod> methodNamed(const std::string& name);
/// kUsage for values that cannot work; the text names the value and its range.
world::Result<world::Done> requireMethod(const ShadowMethod& method);

}  // namespace culling
