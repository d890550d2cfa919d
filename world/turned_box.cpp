#include "world/turned_box.h"

#include <cmath>

namespace world {
namespace {

/// Bounds the rounding of a three-term dot product of doubles and of the sums around it: a few units of
/// 2^-53 of the magnitudes involved, rounded up generously.
constexpr double kRounding = 1e-14;

/// The same for single precision: positions, axes, products and sums lose less than 8 units of 2^-24 of the
/// magnitudes involved. This is 16.
constexpr double kSingleRounding = 1e-6;

constexpr float kInfinity = std::numeric_limits<float>::infinity();

double sum(glm::dvec3 v) { return std::abs(v.x) + std::abs(v.y) + std::abs(v.z); }

float up(double v) { return std::nextafter(static_cast<float>(v), kInfinity); }
float down(double v) { return std::nextafter(static_cast<float>(v), -kInfinity); }

}  // namespace

bool TurnedBox::mayTouch(const Box& box) const {
    if (box.empty()) return false;
    const glm::dvec3 centre = box.centre(), half = box.extent() * 0.5;
    const double slack = kRounding * (sum(centre) + sum(half));
    for (size_t k = 0; k < 3; ++k) {
        const double at = glm::dot(axis[k], centre), reach = glm::dot(glm::abs(axis[k]), half) + slack;
        if (at + reach < lo[static_cast<int>(k)] || at - reach > hi[static_cast<int>(k)]) return false;
    }
    return true;
}

void BoxLanes::set(uint32_t lane, const Box& box, glm::dvec3 origin) {
    const glm::dvec3 c = box.centre() - origin, h = box.extent() * 0.5;
    // An axis is unit, so what is added to each half extent is added to the reach along it at least once.
    const double slack = kSingleRounding * (sum(c) + sum(h)) + 4 * kRounding * (sum(box.centre()) + sum(h));
    for (size_t axis = 0; axis < 3; ++axis) {
        centre[axis][lane] = static_cast<float>(c[static_cast<int>(axis)]);
        half[axis][lane] = up(h[static_cast<int>(axis)] + slack);
    }
}

void BoxLanes::copy(uint32_t lane, const BoxLanes& from, uint32_t fromLane) {
    for (size_t axis = 0; axis < 3; ++axis) {
        centre[axis][lane] = from.centre[axis][fromLane];
        half[axis][lane] = from.half[axis][fromLane];
    }
}

LaneQuery::LaneQuery(const TurnedBox& query, glm::dvec3 origin) {
    for (size_t k = 0; k < 3; ++k) {
        const double lo = query.lo[static_cast<int>(k)], hi = query.hi[static_cast<int>(k)];
        if (lo == -std::numeric_limits<double>::infinity() && hi == std::numeric_limits<double>::infinity()) continue;
        Axis& axis = axes_[static_cast<size_t>(count_++)];
        for (size_t i = 0; i < 3; ++i) {
            axis.direction[i] = static_cast<float>(query.axis[k][static_cast<int>(i)]);
            axis.absolute[i] = std::abs(axis.direction[i]);
        }
        const double at = glm::dot(query.axis[k], origin);
        const double loSlack = kRounding * (sum(origin) + std::abs(lo)), hiSlack = kRounding * (sum(origin) + std::abs(hi));
        axis.lo = down(lo - at - loSlack);
        axis.hi = up(hi - at + hiSlack);
        axis.insideLo = std::isfinite(lo) ? up(lo - at + loSlack) : static_cast<float>(lo);
        axis.insideHi = std::isfinite(hi) ? down(hi - at - hiSlack) : static_cast<float>(hi);
    }
}

// Loops of eight, without branches, so that compilers turn them into vectors. A comparison with what is not a
// number is false, so no lane is refused for it.

/// The boxes' extents along the axis.
void LaneQuery::extents(const Axis& axis, const BoxLanes& boxes, BoxLanes::Lane& low, BoxLanes::Lane& high) {
    for (size_t i = 0; i < BoxLanes::kLanes; ++i) {
        const float at = axis.direction[0] * boxes.centre[0][i] + axis.direction[1] * boxes.centre[1][i] +
                         axis.direction[2] * boxes.centre[2][i];
        const float reach = axis.absolute[0] * boxes.half[0][i] + axis.absolute[1] * boxes.half[1][i] +
                            axis.absolute[2] * boxes.half[2][i];
        low[i] = at - reach;
        high[i] = at + reach;
    }
}

uint32_t LaneQuery::touched(const BoxLanes& boxes) const {
    std::array<uint32_t, BoxLanes::kLanes> refused{};
    for (int k = 0; k < count_; ++k) {
        const Axis& axis = axes_[static_cast<size_t>(k)];
        BoxLanes::Lane low, high;
        extents(axis, boxes, low, high);
        for (size_t i = 0; i < BoxLanes::kLanes; ++i)
            refused[i] |= static_cast<uint32_t>(high[i] < axis.lo) | static_cast<uint32_t>(low[i] > axis.hi);
    }
    uint32_t mask = 0;
    for (uint32_t i = 0; i < BoxLanes::kLanes; ++i) mask |= (refused[i] ^ 1u) << i;
    return mask;
}

uint32_t LaneQuery::within(const BoxLanes& boxes) const {
    std::array<uint32_t, BoxLanes::kLanes> inside;
    inside.fill(1);
    for (int k = 0; k < count_; ++k) {
        const Axis& axis = axes_[static_cast<size_t>(k)];
        BoxLanes::Lane low, high;
        extents(axis, boxes, low, high);
        for (size_t i = 0; i < BoxLanes::kLanes; ++i)
            inside[i] &= static_cast<uint32_t>(low[i] >= axis.insideLo) & static_cast<uint32_t>(high[i] <= axis.insideHi);
    }
    uint32_t mask = 0;
    for (uint32_t i = 0; i < BoxLanes::kLanes; ++i) mask |= inside[i] << i;
    return mask;
}

}  // namespace world
