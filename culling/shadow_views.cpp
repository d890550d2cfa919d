#include "culling/shadow_views.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "culling/cascades.h"
#include "culling/warped_views.h"
#include "world/check.h"

namespace culling {
namespace {

/// Depths reach beyond the scene's bounds by this [m]: receivers that were found by rays in single precision are off
/// by less, and a flat scene has some depth.
constexpr double kDepthPad = 0.1;
/// Half an edge of the smallest map [m]: a slice that is seen edge on has no width.
constexpr double kLeastHalf = 0.01;

/// One slice of the view.
struct Slice {
    double begin = 0, end = 0;  ///< along the view [m]
    double from = 0;  ///< where what its map must hold begins: earlier, if the slice before is blended into it
};

/// What a map must hold, light space [m]: a box that is a cube wherever the fit does not turn with the camera.
struct Footprint {
    glm::dvec3 centre{0}, half{0};
};

std::vector<Slice> slicesOf(const ShadowMethod& method, double near, double far) {
    std::vector<Slice> slices;
    double begin = near, from = near;
    for (const double end : splitsOf(method.splits, near, far)) {
        slices.push_back({begin, end, from});
        from = end - method.blend * (end - begin);
        begin = end;
    }
    return slices;
}

Footprint boxOf(const Pyramid& view, double from, double to) {
    world::Box box;
    for (const glm::dvec3& corner : cornersOf(view, from, to)) box.add(corner);
    return {box.centre(), glm::max(box.extent() * 0.5, glm::dvec3(kLeastHalf))};
}

/// Around the middle of the view at `distance` along it.
Footprint sphere(const Pyramid& view, double distance, double radius) {
    return {view.eye + view.forward * distance, glm::dvec3(radius)};
}

/// The least sphere that holds a slice. Its centre is as far from the near corners as from the far ones; where that
/// lies beyond the far plane, in it.
/// Source: Valient, "Stable Rendering of Cascaded Shadow Maps", ShaderX6, 2008.
Footprint sliceSphere(const Pyramid& view, double from, double to) {
    const double t = view.diagonal, centre = std::min(to, (from + to) * (1 + t * t) / 2);
    return sphere(view, centre, std::hypot(to - centre, to * t));
}

/// Longest distance between two points of a slice: across its far end, or from one end to the other.
double diameter(const Pyramid& view, double from, double to) {
    return std::max(2 * to * view.diagonal, std::hypot(to - from, (to + from) * view.diagonal));
}

/// A sphere whose foremost ring on the view's four edges is at `slice.from`, and the end of what it holds, which
/// becomes the slice's. A radius of 0 is chosen to reach the slice's end.
/// Source: Sylvan, in the comments to Blow, "Graphics Tech: Shadow Maps (part 1)", 2010.
Footprint pushedSphere(const Pyramid& view, Slice& slice, double radius) {
    const double t = view.diagonal, stretch = 1 + t * t;
    if (radius == 0) {
        const double centre = (slice.from + slice.end) * stretch / 2;
        return sphere(view, centre, std::hypot(centre - slice.from, slice.from * t));
    }
    const double ring = slice.from * t;
    const double centre = slice.from + std::sqrt(std::max(0.0, radius * radius - ring * ring));
    slice.end = std::max(slice.begin, 2 * centre / stretch - slice.from);
    return sphere(view, centre, radius);
}

Footprint footprintOf(const ShadowMethod& method, const Pyramid& view, Slice& slice, size_t number) {
    const double from = slice.from, to = slice.end;
    switch (method.fit) {
        case Fit::kEyeBox:
            return sphere(view, 0, to);
        case Fit::kSliceSphere:
            return sliceSphere(view, from, to);
        case Fit::kSplitSphere:
            return sphere(view, (from + to) / 2, (to - from) / std::sqrt(2.0));
        case Fit::kSliceDiameter:
            return {boxOf(view, from, to).centre, glm::dvec3(diameter(view, from, to) / 2)};
        case Fit::kPushedSphere:
            return pushedSphere(view, slice, method.radii.empty() ? 0 : method.radii[number]);
        case Fit::kSliceBox:
        case Fit::kFacets:
        case Fit::kWarped:
            break;
    }
    return boxOf(view, from, to);
}

/// What is left of a polygon where a x + b y + c >= 0.
/// Source: Sutherland & Hodgman, "Reentrant Polygon Clipping", 1974.
std::vector<glm::dvec3> cut(const std::vector<glm::dvec3>& polygon, glm::dvec3 plane) {
    std::vector<glm::dvec3> kept;
    const auto above = [&](glm::dvec3 p) { return plane.x * p.x + plane.y * p.y + plane.z; };
    for (size_t i = 0; i < polygon.size(); ++i) {
        const glm::dvec3 p = polygon[i], q = polygon[(i + 1) % polygon.size()];
        const double d = above(p), e = above(q);
        if (d >= 0) kept.push_back(p);
        if ((d >= 0) != (e >= 0)) kept.push_back(p + (q - p) * (d / (d - e)));
    }
    return kept;
}

/// Bounds along the light of the part of the world's box `scene` whose rays fall between low and high. A corner of
/// that part lies on a face of the box, since the four planes of the map's edges all run with the light: so the six
/// faces, cut off, tell. Empty if nothing does.
world::Box clippedBounds(const world::Box& scene, const LightSpace& light, glm::dvec2 low, glm::dvec2 high) {
    std::array<glm::dvec3, 8> corners;
    for (int i = 0; i < 8; ++i)
        corners[size_t(i)] = light.toLight(glm::mix(scene.min, scene.max, glm::dvec3(i & 1, i >> 1 & 1, i >> 2 & 1)));
    world::Box bounds;
    for (int axis = 0; axis < 3; ++axis) {
        const int u = 1 << axis, v = 1 << (axis + 1) % 3, w = 1 << (axis + 2) % 3;
        for (const int face : {0, u}) {
            std::vector<glm::dvec3> polygon;
            for (const int corner : {face, face | v, face | v | w, face | w})
                polygon.push_back(corners[size_t(corner)]);
            for (const glm::dvec3 plane : {glm::dvec3(1, 0, -low.x), glm::dvec3(-1, 0, high.x),
                                           glm::dvec3(0, 1, -low.y), glm::dvec3(0, -1, high.y)})
                polygon = cut(polygon, plane);
            for (const glm::dvec3& p : polygon) bounds.add(p);
        }
    }
    return bounds;
}

Depths within(const world::Box& bounds) { return {bounds.min.z - kDepthPad, bounds.extent().z + 2 * kDepthPad}; }

/// How far before a point of the scene something may stand that shades it: no ray of light is longer inside [m].
double longestRay(const LightSpace& light, const world::Box& scene) {
    double longest = std::numeric_limits<double>::infinity();
    for (int axis = 0; axis < 3; ++axis)
        if (light.sun[axis] != 0) longest = std::min(longest, scene.extent()[axis] / std::abs(light.sun[axis]));
    return longest;
}

/// Depths of a map whose rays fall between low and high.
Depths depthsOf(const ShadowMethod& method, const LightSpace& light, const world::Box& scene, glm::dvec2 low,
                glm::dvec2 high, const Footprint& foot) {
    if (method.depth == DepthFit::kMoving) {
        // One unit more than needed: rounding down gives up to one away.
        const double before = longestRay(light, scene) + foot.half.z + kDepthPad, after = foot.half.z + kDepthPad;
        const double length = (before + after) * kDepthUnits / (kDepthUnits - 1), unit = length / kDepthUnits;
        return {std::floor((foot.centre.z - before) / unit) * unit, length};
    }
    if (method.depth == DepthFit::kClipped) {
        const world::Box clipped = clippedBounds(scene, light, low, high);
        if (!clipped.empty()) return within(clipped);
    }
    return within(light.toLight(scene));
}

/// Low corner of a map as wide as `texel` makes it, around `centre`; by whole steps of the lattice that is anchored
/// at light space's origin. The same windows as the cache's.
glm::dvec2 snappedLow(glm::dvec2 centre, double texel, int side, int step) {
    glm::dvec2 low;
    for (int axis = 0; axis < 2; ++axis) {
        const int64_t index = int64_t(std::floor(centre[axis] / texel + 0.5)) - side / 2 + step / 2;
        low[axis] = double(index - ((index % step) + step) % step) * texel;
    }
    return low;
}

/// A map that is not warped.
ShadowView flatView(glm::dvec2 low, glm::dvec2 high, int side, const Depths& depths) {
    ShadowView view;
    const glm::dvec2 scale = 2.0 / (high - low);
    view.clipFromLight = {{scale.x, 0, 0, 0}, {0, scale.y, 0, 0}, {0, 0, 1 / depths.length, 0}, {-1, -1, 0, 1}};
    view.origin = {low, depths.near};
    view.low = low;
    view.high = high;
    view.texel = std::min(high.x - low.x, high.y - low.y) / side;
    view.depthRange = depths.length;
    return view;
}

/// The map of a slice.
ShadowView sliceView(const ShadowMethod& method, const LightSpace& light, const Pyramid& pyramid, Slice slice,
                     size_t number, const world::Box& scene) {
    const Footprint foot = footprintOf(method, pyramid, slice, number);
    const double inner = method.side - 2 * (kWindowMargin + method.guardBand / 2);
    const glm::dvec2 texel = glm::dvec2(foot.half) * 2.0 / inner;
    const glm::dvec2 low = method.snapped ? snappedLow(foot.centre, texel.x, method.side, method.guardBand)
                                          : glm::dvec2(foot.centre) - texel * (method.side * 0.5);
    const glm::dvec2 high = low + texel * double(method.side);
    ShadowView view = flatView(low, high, method.side, depthsOf(method, light, scene, low, high, foot));
    view.begin = slice.begin;
    view.end = slice.end;
    view.texel = std::min(texel.x, texel.y);
    return view;
}

/// The map of all statics: nothing about it depends on the camera but the interval that it serves.
ShadowView staticView(const ShadowMethod& method, const LightSpace& light, double far, const world::Box& scene) {
    const world::Box bounds = light.toLight(scene);
    const double inner = double(method.side - 2 * kWindowMargin) / method.side;
    const glm::dvec2 half = glm::max(glm::dvec2(bounds.extent()) * 0.5, glm::dvec2(kLeastHalf)) / inner;
    const glm::dvec2 centre(bounds.centre());
    ShadowView view = flatView(centre - half, centre + half, method.side, within(bounds));
    view.end = far;
    view.statics = true;
    return view;
}

}  // namespace

std::vector<double> splitsOf(const Splits& splits, double near, double far) {
    CHECK(0 < near && near < far && splits.count > 0);
    std::vector<double> ends;
    for (int i = 1; i < splits.count; ++i) {
        const double share = double(i) / splits.count;
        const double even = near + (far - near) * share, logarithmic = near * std::pow(far / near, share);
        ends.push_back(splits.ratio > 0 ? std::max(near, far * std::pow(splits.ratio, i - splits.count))
                                        : splits.blend * logarithmic + (1 - splits.blend) * even);
    }
    ends.push_back(far);
    return ends;
}

std::vector<ShadowView> viewsOf(const ShadowMethod& method, const LightSpace& light, const View& camera, double near,
                                double far, const world::Box& scene) {
    CHECK(!scene.empty());
    CHECK(camera.verticalFov > 0 || method.fit == Fit::kEyeBox || method.fit == Fit::kFacets);
    const Pyramid pyramid = pyramidOf(light, camera);
    std::vector<ShadowView> views;
    if (method.fit == Fit::kFacets || method.fit == Fit::kWarped) {
        const Depths depths = within(light.toLight(scene));
        views = method.fit == Fit::kFacets ? facetViews(method, pyramid, near, far, depths)
                                           : std::vector{warpedView(method, pyramid, near, far, depths)};
    } else {
        size_t number = 0;
        double end = near;
        for (Slice slice : slicesOf(method, near, far)) {
            if (!method.radii.empty() && number > 0) {
                // Spheres of given radii end where they end, and the next begins there.
                slice.from = end - method.blend * (end - views.back().begin);
                slice.begin = end;
            }
            views.push_back(sliceView(method, light, pyramid, slice, number, scene));
            end = views.back().end;
            views.back().map = int(number++);
        }
    }
    if (method.staticMap) {
        const int map = views.back().map + 1;
        views.push_back(staticView(method, light, far, scene));
        views.back().map = map;
    }
    return views;
}

glm::dmat2 texelEdges(const ShadowView& view, int side, glm::dvec2 pLight) {
    const glm::dmat4& m = view.clipFromLight;
    const glm::dvec4 clip = m * glm::dvec4(pLight, 0, 1);
    const glm::dvec2 at = glm::dvec2(clip) / clip.w;
    const glm::dmat2 mapFromLight((glm::dvec2(m[0]) - at * m[0].w) / clip.w,
                                  (glm::dvec2(m[1]) - at * m[1].w) / clip.w);
    return glm::inverse(mapFromLight) * (2.0 / side);
}

}  // namespace culling
