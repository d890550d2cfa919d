#include "server/shading.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "cache/frame_plan.h"
#include "server/filter_taps.h"
#include "world/check.h"

namespace server {
namespace {

using culling::ShadowView;

/// A texel that a filter reads, and what it counts.
struct Tap {
    glm::ivec2 texel{0};
    double weight = 0;
};

/// Tap `i` of a filter for a point at `at` [texels]; weights of all add up to 1.
///   turn  cosine and sine of the pixel's angle
Tap tapOf(const FilterTaps& taps, size_t i, glm::dvec2 at, glm::dvec2 turn) {
    const glm::dvec2 step = taps.steps[i];
    if (taps.between) {
        const glm::dvec2 first = glm::floor(at - 0.5), weights = glm::mix(1.0 - (at - 0.5 - first), at - 0.5 - first, step);
        return {glm::ivec2(first + step), weights.x * weights.y};
    }
    const glm::dvec2 turned(turn.x * step.x - turn.y * step.y, turn.y * step.x + turn.x * step.y);
    return {glm::ivec2(glm::floor(at + (taps.turned ? turned : step))), 1.0 / double(taps.count)};
}

/// What is the same for all points.
struct Shading {
    const culling::ShadowMethod& method;
    std::span<const ShadowView> views;
    const culling::LightSpace& light;
    const culling::View& camera;
    std::span<const std::span<const float>> images;
    std::vector<glm::dmat4> lightFromClip;        // per view, relative to its origin
    std::vector<std::pair<size_t, size_t>> maps;  // first and end of each map's views
    glm::dvec3 forward{0};                        // of the camera, world
    FilterTaps taps{};
    double far = 0;                               // where shadows end [m]
};

/// A map's answer.
struct Sample {
    ReceiverLight answer;
    double outward = 0;  ///< from 0 in the map's middle to 1 where it ends, filter and all
};

double insideWedge(const ShadowView& view, glm::dvec3 xyw) {
    return std::min(glm::dot(view.wedge[0], xyw), glm::dot(view.wedge[1], xyw));
}

glm::dvec4 clipOf(const ShadowView& view, glm::dvec3 pLight) {
    return view.clipFromLight * glm::dvec4(pLight - view.origin, 1);
}

/// The view of a map that a point belongs to: the one in whose wedge it lies deepest, so that none falls between two.
template <class Inside>
size_t viewAt(std::pair<size_t, size_t> views, Inside inside) {
    size_t best = views.first;
    for (size_t v = views.first + 1; v < views.second; ++v)
        if (inside(v) > inside(best)) best = v;
    return best;
}

size_t viewOver(const Shading& s, std::pair<size_t, size_t> views, glm::dvec3 pLight) {
    return viewAt(views, [&](size_t v) {
        const glm::dvec4 clip = clipOf(s.views[v], pLight);
        return insideWedge(s.views[v], {clip.x, clip.y, clip.w});
    });
}

/// How far toward the sun the point's depth is moved before it is compared [m].
double biasOf(const culling::ShadowBias& bias, const glm::dmat2& edges, double texel, glm::dvec3 normalLight) {
    double moved = bias.receiver * texel;
    if (bias.gradient > 0) {
        const glm::dvec2 rises = glm::abs(glm::dvec2(normalLight) * edges);
        const double rise = rises.x + rises.y;
        const double most = bias.gradientMost * texel, asked = bias.gradient * rise, run = std::abs(normalLight.z);
        moved += asked < most * run ? asked / run : most;
    }
    return moved;
}

/// How much deeper a point's own plane is at so far from it across the light [m].
double fallOf(glm::dvec2 away, double texel, glm::dvec3 normalLight) {
    const double most = kMostFall * texel, fall = -glm::dot(glm::dvec2(normalLight), away), run = normalLight.z;
    if (std::abs(fall) < most * std::abs(run)) return fall / run;
    return (fall < 0) != (run < 0) ? -most : most;
}

/// What one map says, unless the point lies beside it or something that the filter needs is not known.
std::optional<Sample> sample(const Shading& s, size_t map, const Receiver& receiver) {
    const std::pair<size_t, size_t> views = s.maps[map];
    const glm::dvec3 normal = s.light.toLight(glm::dvec3(receiver.normal));
    glm::dvec3 p = s.light.toLight(receiver.point);
    size_t v = viewOver(s, views, p);
    if (clipOf(s.views[v], p).w <= 0) return std::nullopt;
    const int side = s.method.side;
    const glm::dmat2 edges = culling::texelEdges(s.views[v], side, glm::dvec2(p - s.views[v].origin));
    const double texel = std::max(glm::length(edges[0]), glm::length(edges[1]));
    // In light space the sine of the angle between normal and sun is what lies across the light.
    if (s.method.bias.normalOffset > 0) {
        p += normal * (s.method.bias.normalOffset * texel * glm::length(glm::dvec2(normal)));
        v = viewOver(s, views, p);
    }

    const ShadowView& view = s.views[v];
    const glm::dvec2 onPlane(p);
    if (glm::any(glm::lessThan(onPlane, view.low)) || glm::any(glm::greaterThan(onPlane, view.high)))
        return std::nullopt;
    const glm::dvec4 clip = clipOf(view, p);
    if (clip.w <= 0 || clip.z > clip.w) return std::nullopt;
    const glm::dvec2 at = (glm::dvec2(clip) / clip.w + 1.0) * (side / 2.0);
    const double room = s.method.selection == culling::Selection::kMap ? s.taps.reach : 0;
    if (std::min(at.x, at.y) < room || std::max(at.x, at.y) >= side - room) return std::nullopt;

    const double depth = p.z - biasOf(s.method.bias, edges, texel, normal);
    Sample found;
    double lit = 0;
    const double angle = s.taps.turned ? angleOf(receiver.pixel) : 0;
    const glm::dvec2 turn(std::cos(angle), std::sin(angle));
    for (size_t i = 0; i < s.taps.count; ++i) {
        const Tap tap = tapOf(s.taps, i, at, turn);
        if (glm::any(glm::lessThan(tap.texel, glm::ivec2(0))) ||
            glm::any(glm::greaterThanEqual(tap.texel, glm::ivec2(side)))) {
            found.answer.tapLeft = true;
            lit += tap.weight;
            continue;
        }
        const float stored = s.images[map][size_t(tap.texel.y) * size_t(side) + size_t(tap.texel.x)];
        if (stored == cache::kUnknownDepth) return std::nullopt;
        const glm::dvec2 centre = (glm::dvec2(tap.texel) + 0.5) * (2.0 / side) - 1.0;
        // A facet's neighbour has another warp: what a texel's depth means is its own facet's to say.
        const size_t owner = viewAt(views, [&](size_t n) { return insideWedge(s.views[n], {centre, 1}); });
        const double drawn = (double(stored) - cache::kNearestDepth) / (1.0 - cache::kNearestDepth);
        const glm::dvec4 caster = s.lightFromClip[owner] * glm::dvec4(centre, drawn, 1);
        const glm::dvec3 texelMiddle = s.views[owner].origin + glm::dvec3(caster) / caster.w;
        const double fall = s.method.bias.plane ? fallOf(glm::dvec2(texelMiddle - p), texel, normal) : 0;
        const bool shadowed = stored < cache::kEmptyDepth && texelMiddle.z < depth + fall;
        lit += shadowed ? 0 : tap.weight;
    }
    found.answer.light = float(std::min(lit, 1.0));
    found.answer.texel = float(texel);
    found.answer.view = int8_t(v);
    const glm::dvec2 away = glm::abs(at - side / 2.0);
    found.outward = std::max(away.x, away.y) / (side / 2.0 - s.taps.reach);
    return found;
}

/// How much of the next map is mixed into a map's answer.
double blendOf(const Shading& s, const Sample& found, double depth) {
    if (s.method.blend <= 0) return 0;
    const ShadowView& view = s.views[size_t(found.answer.view)];
    const double through = s.method.selection == culling::Selection::kMap
                               ? found.outward
                               : (depth - view.begin) / (view.end - view.begin);
    return std::clamp((through - (1 - s.method.blend)) / s.method.blend, 0.0, 1.0);
}

ReceiverLight lightAt(const Shading& s, const Receiver& receiver) {
    const glm::dvec3 away = receiver.point - s.camera.eye;
    const double depth = glm::dot(away, s.forward);
    size_t map = 0;
    if (s.method.selection == culling::Selection::kInterval)
        while (map < s.maps.size() && s.views[s.maps[map].first].end < depth) ++map;
    std::optional<Sample> found;
    for (; map < s.maps.size() && !found; ++map) found = sample(s, map, receiver);
    if (!found) return {};

    ReceiverLight answer = found->answer;
    if (const double weight = blendOf(s, *found, depth); weight > 0) {
        std::optional<Sample> next;
        for (; map < s.maps.size() && !next; ++map) next = sample(s, map, receiver);
        if (next) {
            answer.light = float(glm::mix(double(answer.light), double(next->answer.light), weight));
            answer.tapLeft |= next->answer.tapLeft;
        }
    }
    if (s.method.fade > 0) {
        const double gone = std::clamp((glm::length(away) / s.far - (1 - s.method.fade)) / s.method.fade, 0.0, 1.0);
        answer.light = float(glm::mix(double(answer.light), 1.0, gone));
    }
    return answer;
}

}  // namespace

std::vector<ReceiverLight> shade(const culling::ShadowMethod& method, std::span<const ShadowView> views,
                                 const culling::LightSpace& light, const culling::View& camera,
                                 std::span<const std::span<const float>> images,
                                 std::span<const Receiver> receivers) {
    Shading s{.method = method,
              .views = views,
              .light = light,
              .camera = camera,
              .images = images,
              .lightFromClip = {},
              .maps = {}};
    for (size_t v = 0; v < views.size(); ++v) {
        s.lightFromClip.push_back(glm::inverse(views[v].clipFromLight));
        if (v == 0 || views[v].map != views[v - 1].map) s.maps.push_back({v, v});
        s.maps.back().second = v + 1;
        s.far = std::max(s.far, views[v].end);
    }
    CHECK(images.size() == s.maps.size());
    for (const std::span<const float> image : images)
        CHECK(image.size() == size_t(method.side) * size_t(method.side));
    s.forward = camera.orientation * glm::dvec3(0, 0, -1);
    s.taps = tapsOf(method.filter);
    std::vector<ReceiverLight> answers(receivers.size());
    tbb::parallel_for(size_t{0}, receivers.size(), [&](size_t i) { answers[i] = lightAt(s, receivers[i]); });
    return answers;
}

}  // namespace server
