#include "server/sun.h"

#include <algorithm>

namespace server {

bool Sun::complete() const {
    return std::all_of(caches.begin(), caches.end(), [](const cache::ShadowCache& c) { return c.complete(); });
}

void Sun::forget() {
    for (cache::ShadowCache& c : caches) c.forget();
}

CascadeView viewOf(const Sun& sun, int number) {
    const auto [held, cascade] = sun.of(number);
    const cache::DepthRange& depth = held.depth(cascade);
    // Stored depths of casters begin at kNearestDepth.
    const double range = depth.length / (1.0 - cache::kNearestDepth);
    return {held.lattice(cascade).texel, held.split(cascade), held.window(cascade).min,
            depth.near - cache::kNearestDepth * range, range, held.drawn(cascade), sun.space.lightFromWorld};
}

std::vector<TexelState> texelStates(const Sun& sun, int number, gpu::MapKind map,
                                    std::span<const cache::TexelRect> gaps) {
    const auto [held, cascade] = sun.of(number);
    const cache::Lattice& lattice = held.lattice(cascade);
    std::vector<TexelState> states(size_t(lattice.side * lattice.side), TexelState::kValid);
    const auto paint = [&](const cache::TexelRect& rect, TexelState state) {
        for (int64_t y = rect.min.y; y < rect.max.y; ++y)
            for (int64_t x = rect.min.x; x < rect.max.x; ++x) {
                const cache::Texel slot = lattice.slot({x, y});
                states[size_t(slot.y * lattice.side + slot.x)] = state;
            }
    };
    for (const cache::TexelRect& rect : gaps) paint(rect, TexelState::kStale);
    if (map == gpu::MapKind::kWorking)
        for (const cache::TexelRect& rect : held.slept(cascade)) paint(rect, TexelState::kStale);
    for (const cache::OwedRegion& region : held.owed(cascade))
        paint(region.rect, region.owes == cache::Owes::kUnknown ? TexelState::kUnknown : TexelState::kStale);
    return states;
}

}  // namespace server
