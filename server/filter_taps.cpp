#include "server/filter_taps.h"

#include <cmath>
#include <numbers>

namespace server {
namespace {

/// A Poisson disk of eight: no two are nearer than 0.69 radii, and their mean is the centre to 0.03. The best of
/// 4,000 sets grown from random candidates.
constexpr glm::dvec2 kPoissonDisk[8] = {{0.47, -0.81}, {-0.75, -0.33}, {0.60, 0.71},  {-0.67, 0.57},
                                        {-0.08, 0.95}, {-0.04, -0.10}, {0.94, -0.07}, {-0.22, -0.93}};

}  // namespace

FilterTaps tapsOf(culling::Filter filter) {
    FilterTaps taps;
    switch (filter) {
        case culling::Filter::kNone:
            break;
        case culling::Filter::kBox2:
            taps.count = 4;
            for (int i = 0; i < 4; ++i) taps.steps[size_t(i)] = glm::dvec2(i % 2, i / 2);
            taps.between = true;
            taps.reach = 0.5;
            break;
        case culling::Filter::kBox3:
            taps.count = 9;
            for (int i = 0; i < 9; ++i) taps.steps[size_t(i)] = glm::dvec2(i % 3 - 1, i / 3 - 1);
            taps.reach = 1;
            break;
        case culling::Filter::kPoisson:
        case culling::Filter::kPoissonRotated:
            taps.count = 8;
            for (size_t i = 0; i < 8; ++i) taps.steps[i] = kPoissonDisk[i] * kDiskRadius;
            taps.turned = filter == culling::Filter::kPoissonRotated;
            taps.reach = kDiskRadius;
            break;
        case culling::Filter::kDiskRotated:
            // A quarter turn apart, each in the middle of a ring of the same area.
            taps.count = 4;
            for (int i = 0; i < 4; ++i) {
                const double radius = kDiskRadius * std::sqrt((i + 0.5) / 4) * (i < 2 ? 1 : -1);
                taps.steps[size_t(i)] = i % 2 ? glm::dvec2(0, radius) : glm::dvec2(radius, 0);
            }
            taps.turned = true;
            taps.reach = kDiskRadius;
            break;
    }
    return taps;
}

double angleOf(uint32_t pixel) {
    uint32_t bits = (pixel ^ pixel >> 16) * 0x9e3779b1u;
    bits = (bits ^ bits >> 15) * 0x85ebca6bu;
    return (bits ^ bits >> 13) * (2 * std::numbers::pi / 4294967296.0);
}

}  // namespace server
