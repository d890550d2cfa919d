// server/filter_taps.h — the texels that a filter reads, as steps from the point that asks: the same for both who shade.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/glm.hpp>

#include "culling/shadow_method.h"

namespace server {

/// Radius of the disks that taps lie on [texels].
constexpr double kDiskRadius = 1.5;

struct FilterTaps {
    std::array<glm::dvec2, 9> steps{};  ///< from the point [texels]
    size_t count = 1;                   ///< of them
    bool turned = false;                ///< steps are turned by `angleOf` the pixel
    /// Steps are 0 or 1, from the texel whose middle comes before the point, along each axis, and a tap counts by how near
    /// the point is to it. Else all count alike.
    bool between = false;
    double reach = 0;  ///< how far from the point taps may lie, along x or y [texels]
};

FilterTaps tapsOf(culling::Filter filter);

/// An angle as good as random for each pixel [rad].
double angleOf(uint32_t pixel);

}  // namespace server
