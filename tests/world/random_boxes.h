// tests/world/random_boxes.h — seeded boxes and turned boxes of all sizes.
#pragma once

#include <cmath>
#include <limits>
#include <random>

#include "world/turned_box.h"

namespace world_tests {

using world::Box;
using world::TurnedBox;

constexpr double kInf = std::numeric_limits<double>::infinity();

inline glm::dvec3 randomPoint(std::mt19937& rng, glm::dvec3 centre, double reach) {
    std::uniform_real_distribution<double> d(-reach, reach);
    const double x = d(rng), y = d(rng), z = d(rng);
    return centre + glm::dvec3(x, y, z);
}

/// Sizes from points to many times the tree.
inline Box randomBox(std::mt19937& rng, glm::dvec3 centre, double reach) {
    const glm::dvec3 p = randomPoint(rng, centre, reach);
    const double scale = std::exp2(static_cast<double>(rng() % 16) - 8) * (rng() % 50 == 0 ? 100 : 1);
    const glm::dvec3 half =
        rng() % 10 == 0 ? glm::dvec3(0) : glm::abs(randomPoint(rng, glm::dvec3(0), scale));
    return {p - half, p + half};
}

inline TurnedBox randomQuery(std::mt19937& rng, glm::dvec3 centre, double reach) {
    TurnedBox q;
    const glm::dvec3 a = glm::normalize(randomPoint(rng, glm::dvec3(0), 1));
    const glm::dvec3 b = glm::normalize(glm::cross(a, glm::dvec3(0.3, 0.5, -0.8)));
    if (rng() % 4 != 0) q.axis = {a, b, glm::cross(a, b)};
    const glm::dvec3 p = randomPoint(rng, centre, reach);
    for (int k = 0; k < 3; ++k) {
        const double at = glm::dot(q.axis[static_cast<size_t>(k)], p);
        const double half = std::abs(randomPoint(rng, glm::dvec3(0), reach).x);
        q.lo[k] = rng() % 8 == 0 ? -kInf : at - half;
        q.hi[k] = rng() % 8 == 0 ? kInf : at + half;
    }
    return q;
}

/// What a test in single precision may find besides: the box with room for rounding, as far as it measures
/// and is off `origin`. Half extents are stored with a millionth of that on top and sums lose half of one; a
/// query's ends are rounded by less than the same again.
inline Box roomy(const Box& box, glm::dvec3 origin) {
    const glm::dvec3 centre = glm::abs(box.centre() - origin), half = box.extent() * 0.5;
    const double off = centre.x + centre.y + centre.z + half.x + half.y + half.z;
    const double room = 4e-6 * off + 1e-12 * (1 + glm::length(origin));
    return {box.min - room, box.max + room};
}

}  // namespace world_tests
