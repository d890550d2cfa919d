// culling/rect_rows.h — which of many rectangles meet one: a structure of arrays, compared a block at a time.
// Source: our own.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <glm/glm.hpp>
#include <limits>

namespace culling {

/// The next float above the nearest, so that narrowing never shrinks a rectangle: std::nextafter without a call.
inline float roundedUp(double v) {
    const float f = static_cast<float>(v);
    if (!(f < std::numeric_limits<float>::infinity())) return f;
    if (f == 0) return std::numeric_limits<float>::denorm_min();
    const auto bits = std::bit_cast<uint32_t>(f);
    return std::bit_cast<float>(f > 0 ? bits + 1 : bits - 1);
}
inline float roundedDown(double v) { return -roundedUp(-v); }

/// `count` closed rectangles, their sides in four arrays that another owns.
struct RectRows {
    const float* minX = nullptr;
    const float* minY = nullptr;
    const float* maxX = nullptr;
    const float* maxY = nullptr;
    size_t count = 0;
};

/// Sets apart[k], of as many as there are rectangles, to 0 if rectangle k shares a point with [min, max], else to 1.
/// Flags are as wide as what is compared, and nothing else is in the loop: so compilers make vectors of it.
inline void flagApart(const RectRows& rows, glm::vec2 min, glm::vec2 max, int32_t* __restrict apart) {
    const float *minX = rows.minX, *minY = rows.minY, *maxX = rows.maxX, *maxY = rows.maxY;
    const float lowX = min.x, lowY = min.y, highX = max.x, highY = max.y;
    for (size_t k = 0; k < rows.count; ++k)
        apart[k] = int32_t(minX[k] > highX) | int32_t(maxX[k] < lowX) | int32_t(minY[k] > highY) |
                   int32_t(maxY[k] < lowY);
}

/// `visit(k)` for each rectangle k, ascending, that shares a point with [min, max]. Allocates nothing.
template <class Visit>
void eachMeeting(const RectRows& rows, glm::vec2 min, glm::vec2 max, Visit visit) {
    constexpr size_t kBlock = 64;
    std::array<int32_t, kBlock> apart;
    for (size_t first = 0; first < rows.count; first += kBlock) {
        const size_t size = std::min(kBlock, rows.count - first);
        flagApart({rows.minX + first, rows.minY + first, rows.maxX + first, rows.maxY + first, size}, min, max,
                  apart.data());
        for (size_t k = 0; k < size; ++k)
            if (apart[k] == 0) visit(first + k);
    }
}

}  // namespace culling
