// world/octree.h — loose dynamic octree over boxes; finds what a swept light-space box may touch.
// Source: Ulrich, "Loose Octrees", in Game Programming Gems, 2000 (cells with bounds twice their size).
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <vector>

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

/// Items are numbers that the owner gives (caster indices), each with a box in world metres.
/// A box of any size and place is accepted, also outside the bounds given at construction: it is
/// then kept at the root. No operation fails. One thread at a time; queries may run side by side.
class Octree {
public:
    /// `bounds` is where most items will be; `smallestCell` [m] bounds the depth.
    Octree(const Box& bounds, double smallestCell);

    /// `item` must not be in the tree; its box must not be empty.
    void insert(uint32_t item, const Box& box);
    /// `item` must be in the tree.
    void remove(uint32_t item);
    /// Same as remove and insert, cheaper when the item stays in its cell.
    void move(uint32_t item, const Box& box);

    /// Appends every item whose box `query.mayTouch`, in ascending order of item. Deterministic.
    void query(const TurnedBox& query, std::vector<uint32_t>& items) const;

    /// True if `test` accepts the box of any item. What it accepts of a box it must accept of every box
    /// around it. Stops at the first.
    template <class Test>
    bool any(Test test) const {
        return anyBelow(0, test);
    }

    size_t size() const;
    /// CHECKs that each item is in one cell whose loose bounds hold it, and that no cell is empty.
    void validate() const;

private:
    static constexpr uint32_t kNone = 0xffffffffu;
    struct Entry {
        Box box;
        uint32_t item = 0;
    };
    struct Cell {
        glm::dvec3 centre{0};
        double half = 0;  ///< half edge of the tight cell; the loose one reaches twice as far
        std::array<uint32_t, 8> child{kNone, kNone, kNone, kNone, kNone, kNone, kNone, kNone};
        std::vector<Entry> entries;
        uint32_t below = 0;  ///< entries in this cell and its children
        uint32_t parent = kNone;
        uint32_t octant = 0;  ///< place among the parent's children
    };
    struct Slot {
        uint32_t cell = kNone, place = 0;  ///< place among that cell's entries; kNone: not in the tree
    };
    struct Probe;
    static bool holds(const Cell& cell, const Box& box);
    static Cell childOf(const Cell& cell, uint32_t octant);
    uint32_t cellFor(const Box& box);
    uint32_t addCell(Cell cell);
    void visit(uint32_t cell, const Probe& probe, std::vector<uint32_t>& items) const;
    void collect(uint32_t cell, std::vector<uint32_t>& items) const;
    void sortFrom(size_t first, std::vector<uint32_t>& items) const;
    template <class Test>
    bool anyBelow(uint32_t cell, Test& test) const {
        for (const Entry& e : cells_[cell].entries)
            if (test(e.box)) return true;
        for (const uint32_t child : cells_[cell].child) {
            if (child == kNone) continue;
            const double reach = 2 * cells_[child].half;
            const Box loose{cells_[child].centre - reach, cells_[child].centre + reach};
            if (test(loose) && anyBelow(child, test)) return true;
        }
        return false;
    }

    std::vector<Cell> cells_;     ///< the first is the root; bounds of free ones mean nothing
    std::vector<uint32_t> free_;  ///< cells to be used again
    std::vector<Slot> slots_;     ///< by item
    double smallest_ = 1;
    size_t size_ = 0;
};

}  // namespace world
