#include "cache/scroll.h"

#include <cstdlib>

namespace cache {

bool isJump(Texel from, Texel to, int64_t side) {
    // Compared without subtracting first: windows may lie at opposite ends of the number range.
    return to.x >= from.x + side || from.x >= to.x + side || to.y >= from.y + side || from.y >= to.y + side;
}

Slabs exposedSlabs(Texel from, Texel to, int64_t side) {
    Slabs slabs;
    const TexelRect window{to, to + side};
    if (isJump(from, to, side)) {
        slabs.rect[0] = window;
        slabs.count = 1;
        return slabs;
    }
    const Texel move = to - from;
    if (move.x != 0) {  // the full height of the columns that came in
        TexelRect slab = window;
        if (move.x > 0) slab.min.x = from.x + side;
        else slab.max.x = from.x;
        slabs.rect[static_cast<size_t>(slabs.count++)] = slab;
    }
    if (move.y != 0) {  // the rows that came in, without the columns above
        TexelRect slab = window;
        if (move.y > 0) slab.min.y = from.y + side;
        else slab.max.y = from.y;
        if (move.x > 0) slab.max.x = from.x + side;
        if (move.x < 0) slab.min.x = from.x;
        slabs.rect[static_cast<size_t>(slabs.count++)] = slab;
    }
    return slabs;
}

}  // namespace cache
