// world/box.h — axis-aligned box in metres, double precision; the frame is the owner's to name.
#pragma once

#include <glm/glm.hpp>
#include <limits>

namespace world {

/// Closed box [min, max] [m]. Default-constructed it is empty (min > max) and grows by `add`.
struct Box {
    glm::dvec3 min{std::numeric_limits<double>::infinity()};
    glm::dvec3 max{-std::numeric_limits<double>::infinity()};

    bool empty() const { return min.x > max.x || min.y > max.y || min.z > max.z; }
    glm::dvec3 centre() const { return (min + max) * 0.5; }
    glm::dvec3 extent() const { return max - min; }  ///< full edge lengths
    void add(glm::dvec3 p) {
        min = glm::min(min, p);
        max = glm::max(max, p);
    }
    void add(const Box& b) {
        min = glm::min(min, b.min);
        max = glm::max(max, b.max);
    }
    bool overlaps(const Box& b) const {
        return glm::all(glm::lessThanEqual(min, b.max)) && glm::all(glm::lessThanEqual(b.min, max));
    }
    friend bool operator==(const Box&, const Box&) = default;
};

/// The box of `b` after p -> linear * p + shift; exact bounds of the eight moved corners.
inline Box transformed(const Box& b, const glm::dmat3& linear, glm::dvec3 shift) {
    if (b.empty()) return b;
    const glm::dvec3 centre = linear * b.centre() + shift;
    const glm::dvec3 half = b.extent() * 0.5;
    const glm::dmat3 a(glm::abs(linear[0]), glm::abs(linear[1]), glm::abs(linear[2]));
    const glm::dvec3 reach = a * half;
    return {centre - reach, centre + reach};
}

}  // namespace world
