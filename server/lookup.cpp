#include "server/lookup.h"

namespace server {
namespace {

/// Beyond this a point [m] is in no window, and no texel could be counted for it.
constexpr double kFarthestPoint = 1e9;

}  // namespace

world::Result<std::vector<PointAnswer>> lookup(gpu::ShadowMaps& maps, const Sun& sun, int camera,
                                               std::span<const cache::RectSet> gaps,
                                               std::span<const glm::dvec3> points, const LookupBias& bias) {
    std::vector<PointAnswer> answers(points.size());
    const cache::ShadowCache& held = sun.caches[size_t(camera)];
    for (int c = 0; c < held.cascades(); ++c) {
        if (!held.drawn(c)) continue;
        const int number = camera * held.cascades() + c;
        const cache::Lattice& lattice = held.lattice(c);
        const cache::TexelRect window = held.window(c);
        const CascadeView map = viewOf(sun, number);
        std::vector<float> depths;  // read only if a point asks for it
        std::vector<TexelState> states;
        for (size_t i = 0; i < points.size(); ++i) {
            if (answers[i].cascade >= 0) continue;
            const glm::dvec3 p = sun.space.toLight(points[i]);
            if (!(glm::length(p) <= kFarthestPoint)) continue;
            const cache::Texel texel = lattice.texelAt(glm::dvec2(p));
            if (!window.contains({texel, texel + int64_t(1)})) continue;
            // Depths beyond a range that follows the eye are clamped, or not there: a longer range may hold them.
            const cache::DepthRange& range = held.depth(c);
            const bool followsEye = range != held.config().scene;
            if (followsEye && (p.z < range.near || p.z > range.far())) continue;
            if (depths.empty()) {
                auto read = maps.read(int(held.map(c)), gpu::MapKind::kWorking);
                if (!read) return read.error();
                depths = std::move(read.value());
                states = texelStates(sun, number, gpu::MapKind::kWorking, gaps[size_t(number)].rects());
            }
            const cache::Texel slot = lattice.slot(texel);
            const auto at = size_t(slot.y * lattice.side + slot.x);
            if (depths[at] == cache::kUnknownDepth) {  // the next coarser cascade may know
                answers[i].fell = true;
                continue;
            }
            const double caster = map.depthNear + map.depthRange * double(depths[at]);
            const bool shadowed =
                depths[at] < cache::kEmptyDepth && caster + bias.texels * lattice.texel + bias.metres < p.z;
            answers[i] = {shadowed ? Light::kShadowed : Light::kLit, int8_t(number), answers[i].fell,
                          states[at] == TexelState::kStale};
        }
    }
    return answers;
}

}  // namespace server
