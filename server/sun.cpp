#include "server/sun.h"

namespace server {

CascadeView viewOf(const Sun& sun, int cascade) {
    const cache::DepthRange& depth = sun.cache.depth(cascade);
    // Stored depths of casters begin at kNearestDepth.
    const double range = depth.length / (1.0 - cache::kNearestDepth);
    return {sun.cache.lattice(cascade).texel, sun.cache.split(cascade), sun.cache.window(cascade).min,
            depth.near - cache::kNearestDepth * range, range, sun.cache.drawn(cascade), sun.space.lightFromWorld};
}

std::vector<TexelState> texelStates(const Sun& sun, int cascade, gpu::MapKind map,
                                    std::span<const cache::TexelRect> gaps) {
    const cache::Lattice& lattice = sun.cache.lattice(cascade);
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
        for (const cache::TexelRect& rect : sun.cache.slept(cascade)) paint(rect, TexelState::kStale);
    for (const cache::OwedRegion& region : sun.cache.owed(cascade))
        paint(region.rect, region.owes == cache::Owes::kUnknown ? TexelState::kUnknown : TexelState::kStale);
    return states;
}

}  // namespace server
