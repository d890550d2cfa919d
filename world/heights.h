// world/heights.h — a grid of heights: mends what cannot be true, and is a terrain field.
#pragma once

#include <cmath>
#include <cstdint>
#include <vector>

#include "world/terrain_field.h"

namespace world {

/// Heights [m] at posts (x0 + column * dx, z0 + row * dz), row by row; NaN where void.
struct Heights {
    double x0 = 0, z0 = 0;  ///< world frame [m]
    double dx = 0, dz = 0;  ///< [m], dx > 0, dz of any sign but not 0
    int32_t columns = 0, rows = 0;
    std::vector<float> values;

    /// NaN outside.
    float at(int64_t column, int64_t row) const {
        if (column < 0 || row < 0 || column >= columns || row >= rows) return NAN;
        return values[static_cast<size_t>(row * columns + column)];
    }
    /// Bilinear; NaN if a post that it needs is void or outside.
    double between(double x, double z) const;
};

/// Replaces heights that no terrain has (beyond 12 km either way, or more than 1 km and a slope of 10
/// away from the median of their neighbours) by that median of the believable ones among the eight,
/// or by NaN if there are none. Returns how many.
int64_t mendHeights(Heights& heights);

/// Distances to the surface to first order: height difference over the length of the slope's normal.
/// `heights` must outlive the field.
TerrainField fieldOf(const Heights& heights);

/// True if a surface could be made somewhere over the box [x0, x1] x [z0, z1]: four posts of one cell
/// are known there or next to it.
bool anyGround(const Heights& heights, double x0, double z0, double x1, double z1);

}  // namespace world
