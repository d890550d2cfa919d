// cache/scroll.h — what to redraw when a cascade's window moves over its lattice.
// Source: Losasso & Hoppe, "Geometry Clipmaps", 2004 (toroidal update).
#pragma once

#include <array>

#include "cache/texel_rect.h"

namespace cache {

/// At most two disjoint rectangles.
struct Slabs {
    std::array<TexelRect, 2> rect{};
    int count = 0;
    const TexelRect* begin() const { return rect.data(); }
    const TexelRect* end() const { return rect.data() + count; }
};

/// True when windows of edge `side` with low corners `from` and `to` share no texel.
bool isJump(Texel from, Texel to, int64_t side);

/// Texels in the side x side window at `to` but not in the one at `from`.
///   from, to  low corners [lattice texels, not metres]
///   side      window edge [texels], > 0
/// Returns 0 to 2 disjoint slabs; after a jump, the whole window.
/// Cannot fail, allocates nothing, safe from any thread.
Slabs exposedSlabs(Texel from, Texel to, int64_t side);

}  // namespace cache
