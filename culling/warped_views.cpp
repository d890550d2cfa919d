#include "culling/warped_views.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "culling/cascades.h"

namespace culling {
namespace {

/// Below this sine of the angle between view and light the view has no direction on the map, and the warp is none:
/// texels differ by less than a hundred thousandth.
constexpr double kAlongTheLight = 1e-6;

/// The rows of a projection, each over light space relative to the origin; x, y, w do not look at z.
glm::dmat4 matrixOf(glm::dvec3 x, glm::dvec3 y, double depthPerMetre, glm::dvec3 w) {
    return {{x[0], y[0], 0, w[0]}, {x[1], y[1], 0, w[1]}, {0, 0, depthPerMetre, 0}, {x[2], y[2], 0, w[2]}};
}

double shortestEdge(const ShadowView& view, int side, glm::dvec2 p) {
    const glm::dmat2 edges = texelEdges(view, side, p);
    return std::min(glm::length(edges[0]), glm::length(edges[1]));
}

glm::dvec2 direction(double angle) { return {std::cos(angle), std::sin(angle)}; }

}  // namespace

Pyramid pyramidOf(const LightSpace& light, const View& camera) {
    const double up = std::tan(camera.verticalFov / 2), right = up * camera.aspect;
    return {light.toLight(camera.eye), light.toLight(camera.orientation * glm::dvec3(0, 0, -1)),
            light.toLight(camera.orientation * glm::dvec3(right, 0, 0)),
            light.toLight(camera.orientation * glm::dvec3(0, up, 0)), std::hypot(up, right)};
}

std::array<glm::dvec3, 8> cornersOf(const Pyramid& view, double from, double to) {
    std::array<glm::dvec3, 8> corners;
    for (int i = 0; i < 8; ++i)
        corners[size_t(i)] =
            view.eye +
            (view.forward + view.right * (i & 1 ? 1.0 : -1.0) + view.up * (i & 2 ? 1.0 : -1.0)) * (i & 4 ? to : from);
    return corners;
}

std::vector<ShadowView> facetViews(const ShadowMethod& method, const Pyramid& pyramid, double near, double far,
                                   const Depths& depths) {
    const double step = 2 * std::numbers::pi / method.facets, s = method.facetDetail;
    const double inner = 1 - 2.0 * kWindowMargin / method.side;
    const double edge = far * (s + 1 - inner) / (inner * s), detail = s * edge;  // D and S
    // The polygon's corners lie between facets; so much smaller than the article's matrix makes it, all are on the
    // map.
    double widest = 0;
    for (int i = 0; i < method.facets; ++i) {
        const glm::dvec2 corner = glm::abs(direction((i + 0.5) * step)) / std::cos(step / 2);
        widest = std::max({widest, corner.x, corner.y});
    }
    const double perMetre = (edge + detail) / edge / detail / widest;  // d / S, at w = 1 in the middle
    std::vector<ShadowView> views;
    for (int i = 0; i < method.facets; ++i) {
        // Both neighbours take their common border from here, so that no point between them is left out.
        const glm::dvec2 before = direction(((i + method.facets - 1) % method.facets + 0.5) * step);
        const glm::dvec2 after = direction((i + 0.5) * step), middle = direction(i * step);
        ShadowView view;
        view.clipFromLight = matrixOf({perMetre, 0, 0}, {0, perMetre, 0}, 1 / depths.length, {middle / detail, 1});
        view.origin = {pyramid.eye.x, pyramid.eye.y, depths.near};
        view.wedge = {glm::dvec3(-before.y, before.x, 0), glm::dvec3(after.y, -after.x, 0)};
        const glm::dvec2 eye(pyramid.eye), out = eye + before * (edge / std::cos(step / 2)),
                                           in = eye + after * (edge / std::cos(step / 2));
        view.low = glm::min(eye, glm::min(out, in));
        view.high = glm::max(eye, glm::max(out, in));
        view.begin = near;
        view.end = far;
        view.texel = shortestEdge(view, method.side, {0, 0});
        view.depthRange = depths.length;
        views.push_back(view);
    }
    return views;
}

ShadowView warpedView(const ShadowMethod& method, const Pyramid& pyramid, double near, double far,
                      const Depths& depths) {
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    const glm::dvec2 eye(pyramid.eye), onMap(pyramid.forward);
    const double sine = std::max(kAlongTheLight, glm::length(onMap));
    const glm::dvec2 along = glm::length(onMap) > kAlongTheLight ? onMap / sine : glm::dvec2(1, 0);
    const glm::dvec2 across(-along.y, along.x);
    const std::array<glm::dvec3, 8> corners = cornersOf(pyramid, near, far);
    double first = kInfinity, last = -kInfinity;
    for (const glm::dvec3& corner : corners) {
        const double a = glm::dot(along, glm::dvec2(corner) - eye);
        first = std::min(first, a);
        last = std::max(last, a);
    }
    const double n = (near + std::sqrt(near * far)) / sine, length = last - first;
    // With s = along.p - first, w = 1 + s / n; what lies across is bounded after the division.
    double left = kInfinity, right = -kInfinity;
    for (const glm::dvec3& corner : corners) {
        const glm::dvec2 p = glm::dvec2(corner) - eye;
        const double b = glm::dot(across, p) / (1 + (glm::dot(along, p) - first) / n);
        left = std::min(left, b);
        right = std::max(right, b);
    }
    const double width = right - left;
    const glm::dvec3 s(along, -first), w = s / n + glm::dvec3(0, 0, 1);
    ShadowView view;
    view.clipFromLight = matrixOf(s * (2 / length + 1 / n) - glm::dvec3(0, 0, 1),
                                  (2.0 * glm::dvec3(across, 0) - (left + right) * w) / width, 1 / depths.length, w);
    view.origin = {eye, depths.near};
    view.low = glm::dvec2(kInfinity);
    view.high = glm::dvec2(-kInfinity);
    view.texel = kInfinity;
    for (const double a : {first, last}) {
        for (const double b : {left, right}) {
            const glm::dvec2 p = along * a + across * (b * (1 + (a - first) / n));
            view.low = glm::min(view.low, eye + p);
            view.high = glm::max(view.high, eye + p);
            view.texel = std::min(view.texel, shortestEdge(view, method.side, p));
        }
    }
    view.begin = near;
    view.end = far;
    view.depthRange = depths.length;
    return view;
}

}  // namespace culling
