// culling/cascades.h — how far each cascade reaches and how fine its texels are.
// Source: Losasso & Hoppe, "Geometry Clipmaps", 2004 (nested windows around the eye); Engel,
// "Cascaded Shadow Maps", ShaderX5, 2006 (splits that grow by a constant factor).
#pragma once

#include <vector>

#include "world/result.h"

namespace culling {

/// One depth range of the sun and its map's scale. Windows are squares around the eye, so turning
/// the camera moves nothing: for a 60 degree view at 16:9 the texels are 1.31 times as long as those
/// of a sphere around the view's slice (radius sqrt(1 + 1.18^2) f against 1.18 f for a slice that
/// ends at f), and a turn costs nothing instead of a redraw.
struct Cascade {
    double split = 0;  ///< serves points up to this far from the eye [m]
    double texel = 0;  ///< edge of a texel [m]; depends on split and side alone
    friend bool operator==(const Cascade&, const Cascade&) = default;
};

/// Texels of a window that lie beyond its split on each side: one for the snap, the rest for filters.
constexpr int kWindowMargin = 4;

/// Cascades from the eye outwards; the last serves up to `farDistance` [m], each one `ratio` times
/// as far as the one before. `guardBand` >= 1 are the steps [texels] in which windows will move: texels
/// grow a little, so that a window off by half a step still holds its split. kUsage where a number makes no sense; the text names it and its range.
world::Result<std::vector<Cascade>> makeCascades(int count, int side, double farDistance, double ratio,
                                                 int guardBand = 1);

}  // namespace culling
