// cache/invalidation.h — which rectangles of a window a frame's events made untrue, and why.
// Source: our own.
#pragma once

#include <vector>

#include "cache/lattice.h"
#include "cache/shadow_cache.h"

namespace cache {

/// Texels that a box of light space [m] may touch; none for an empty box.
TexelRect footprint(const Lattice& lattice, const world::Box& light);

struct Invalidation {
    TexelRect rect;  ///< inside the window
    Cause cause = Cause::kDeparture;
};

/// Appends where static casters left a cascade, merged where that is cheaper; rectangles of one cause are disjoint.
void departed(const Lattice& lattice, int cascade, const TexelRect& window, const Events& events,
              std::vector<Invalidation>& list);
/// Appends where static casters joined and show in a cascade; likewise.
void arrived(const Scene& scene, const Lattice& lattice, int cascade, const TexelRect& window, const Events& events,
             std::vector<Invalidation>& list);

}  // namespace cache
