#include "server/lookup.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>

namespace server {
namespace {

/// Beyond this a point [m] is in no window, and no texel could be counted for it.
constexpr double kFarthestPoint = 1e9;
constexpr size_t kPointsAtOnce = 1024;  ///< of one task

}  // namespace

world::Result<std::vector<PointAnswer>> lookup(gpu::ShadowMaps& maps, const Sun& sun, int camera,
                                               std::span<const cache::RectSet> gaps,
                                               std::span<const glm::dvec3> points, const LookupBias& bias) {
    std::vector<PointAnswer> answers(points.size());
    std::vector<int64_t> slots(points.size());  // of the cascade's map; -1: none that could answer
    const cache::ShadowCache& held = sun.caches[size_t(camera)];
    for (int c = 0; c < held.cascades(); ++c) {
        if (!held.drawn(c)) continue;
        const int number = camera * held.cascades() + c;
        const cache::Lattice& lattice = held.lattice(c);
        const cache::TexelRect window = held.window(c);
        const CascadeView map = viewOf(sun, number);
        const cache::DepthRange& depth = held.depth(c);
        const bool followsEye = depth != held.config().scene;
        // Where each point that has no answer yet falls: in the window, and within depths that a longer range need not hold.
        tbb::parallel_for(tbb::blocked_range<size_t>(0, points.size(), kPointsAtOnce), [&](const auto& range) {
            for (size_t i = range.begin(); i < range.end(); ++i) {
                slots[i] = -1;
                if (answers[i].cascade >= 0) continue;
                const glm::dvec3 p = sun.space.toLight(points[i]);
                if (!(glm::length(p) <= kFarthestPoint)) continue;
                const cache::Texel texel = lattice.texelAt(glm::dvec2(p));
                if (!window.contains({texel, texel + int64_t(1)})) continue;
                // Depths beyond a range that follows the eye are clamped, or not there: a longer range may hold them.
                if (followsEye && (p.z < depth.near || p.z > depth.far())) continue;
                const cache::Texel slot = lattice.slot(texel);
                slots[i] = slot.y * lattice.side + slot.x;
            }
        });
        if (std::all_of(slots.begin(), slots.end(), [](int64_t slot) { return slot < 0; })) continue;
        const auto read = maps.read(int(held.map(c)), gpu::MapKind::kWorking);
        if (!read) return read.error();
        const std::vector<float>& depths = read.value();
        const std::vector<TexelState> states = texelStates(sun, number, gpu::MapKind::kWorking, gaps[size_t(number)].rects());
        tbb::parallel_for(tbb::blocked_range<size_t>(0, points.size(), kPointsAtOnce), [&](const auto& range) {
            for (size_t i = range.begin(); i < range.end(); ++i) {
                if (slots[i] < 0) continue;
                const auto at = size_t(slots[i]);
                if (depths[at] == cache::kUnknownDepth) {  // the next coarser cascade may know
                    answers[i].fell = true;
                    continue;
                }
                const double caster = map.depthNear + map.depthRange * double(depths[at]);
                const double z = sun.space.toLight(points[i]).z;
                const bool shadowed = depths[at] < cache::kEmptyDepth && caster + bias.texels * lattice.texel + bias.metres < z;
                answers[i] = {shadowed ? Light::kShadowed : Light::kLit, int8_t(number), answers[i].fell,
                              states[at] == TexelState::kStale};
            }
        });
    }
    return answers;
}

}  // namespace server
