// world/turned_box.h — a box turned any way, and which axis-parallel boxes it may touch: one at a time in
// double precision, or eight at a time in single precision, which never misses one.
// Source: Ericson, "Real-Time Collision Detection", 2004 (interval of a box along an axis); the error bounds
// are ours.
#pragma once

#include <array>
#include <cstdint>
#include <limits>

#include "world/box.h"

namespace world {

/// Points p with lo[k] <= dot(axis[k], p) <= hi[k] for k = 0, 1, 2: a box turned any way, open ends
/// as infinities. The axes are unit and mutually orthogonal.
struct TurnedBox {
    std::array<glm::dvec3, 3> axis{glm::dvec3(1, 0, 0), glm::dvec3(0, 1, 0), glm::dvec3(0, 0, 1)};
    glm::dvec3 lo{-std::numeric_limits<double>::infinity()};
    glm::dvec3 hi{std::numeric_limits<double>::infinity()};

    /// True if the box's extent along each axis meets [lo, hi]. Conservative: never false for a box
    /// that has a point inside.
    bool mayTouch(const Box& box) const;
};

/// Eight boxes as a structure of arrays, relative to an origin that all lanes of an owner share; half extents
/// are rounded up by what single precision may lose.
struct BoxLanes {
    static constexpr uint32_t kLanes = 8;
    using Lane = std::array<float, kLanes>;

    /// `box` is not empty; its ends may be infinite.
    void set(uint32_t lane, const Box& box, glm::dvec3 origin);
    void copy(uint32_t lane, const BoxLanes& from, uint32_t fromLane);

    std::array<Lane, 3> centre{}, half{};  ///< [axis][lane]
};

/// A turned box as lanes are tested against it.
class LaneQuery {
public:
    /// `origin` is that of the lanes.
    LaneQuery(const TurnedBox& query, glm::dvec3 origin);

    /// Bit i: box i may be touched. Set wherever `TurnedBox::mayTouch` is true, and seldom elsewhere; means
    /// nothing for lanes that were never set.
    uint32_t touched(const BoxLanes& boxes) const;
    /// Bit i: `TurnedBox::mayTouch` is true of every box within box i.
    uint32_t within(const BoxLanes& boxes) const;

private:
    struct Axis {
        std::array<float, 3> direction{}, absolute{};
        float lo = 0, hi = 0;            ///< rounded outwards
        float insideLo = 0, insideHi = 0;  ///< rounded inwards
    };
    static void extents(const Axis& axis, const BoxLanes& boxes, BoxLanes::Lane& low, BoxLanes::Lane& high);
    std::array<Axis, 3> axes_;
    int count_ = 0;  ///< of axes with a finite end
};

}  // namespace world
