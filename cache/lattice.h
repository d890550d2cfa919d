// cache/lattice.h — a cascade's texels, fixed in light space; windows slide over them.
// Source: Losasso & Hoppe, "Geometry Clipmaps", 2004 (toroidal storage).
#pragma once

#include <cmath>
#include <glm/glm.hpp>

#include "cache/texel_rect.h"

namespace cache {

/// Texel (i, j) is the square [i, i + 1) x [j, j + 1) times `texel` metres of light space, counted
/// from the world's origin and never from the camera: a texel keeps its index, and so its depth,
/// while windows slide over it.
struct Lattice {
    double texel = 1;  ///< edge of one texel [m], > 0
    int64_t side = 1;  ///< window edge [texels], > 0
    int64_t step = 1;  ///< windows start at multiples of this [texels], > 0

    /// The texel that holds (x, y) [m, light space].
    Texel texelAt(glm::dvec2 pLight) const { return Texel(glm::floor(pLight / texel)); }

    /// Low corner of the window centred nearest (x, y) [m, light space]: the texel snap. The centre is
    /// off by half a texel and half a step at most.
    Texel windowAt(glm::dvec2 pLight) const {
        const Texel low = Texel(glm::floor(pLight / texel + 0.5)) - side / 2 + step / 2;
        return low - ((low % step) + step) % step;
    }
    TexelRect window(Texel low) const { return {low, low + side}; }

    /// Where texel `t` lives in the stored map; wraps, so a scroll moves no memory.
    Texel slot(Texel t) const { return ((t % side) + side) % side; }
    /// Which copy of the stored map `t` falls into: t = quadrant * side + slot.
    Texel quadrant(Texel t) const { return (t - slot(t)) / side; }

    /// Texels that a draw within [min, max] [m] may touch: the box grown by one texel, since the
    /// rasteriser rounds positions to 1/256 texel and single precision to a few hundredths.
    TexelRect footprint(glm::dvec2 min, glm::dvec2 max) const {
        return {Texel(glm::floor(min / texel)) - Texel(1), Texel(glm::floor(max / texel)) + Texel(2)};
    }
};

}  // namespace cache
