// world/octree.h — loose dynamic octree over boxes; finds what a swept light-space box may touch.
// Source: Ulrich, "Loose Octrees", in Game Programming Gems, 2000 (cells with bounds twice their size). A cell
// also knows the bounds of its contents, which are several times smaller where these lie on a ground: those of
// eight children, like eight of its items, are tested at once.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "world/box.h"
#include "world/turned_box.h"

namespace world {

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

    /// Appends every item whose box `query.mayTouch`, and perhaps some whose box is out of its reach by a few
    /// millionths of what the two measure and are off the tree's centre, in ascending order of item.
    /// Deterministic; allocates nothing once `items` has room for what is found and a bit for each item up to
    /// the largest.
    void query(const TurnedBox& query, std::vector<uint32_t>& items) const;

    /// Appends every item whose box `test` accepts, in ascending order of item. What it accepts of a box it
    /// must accept of every box around it.
    template <class Test>
    void accepted(Test test, std::vector<uint32_t>& items) const {
        const size_t first = items.size();
        acceptedBelow(0, test, items);
        sortFrom(first, items);
    }
    /// True if there is any such item. Stops at the first.
    template <class Test>
    bool any(Test test) const {
        return anyBelow(0, test);
    }

    size_t size() const;
    /// CHECKs that each item is in one cell whose loose bounds hold it, that no cell is empty, and that what is
    /// said of contents holds them.
    void validate() const;

private:
    static constexpr uint32_t kNone = 0xffffffffu;
    /// Up to eight items; the last lanes of a cell may be in part unused.
    struct Entries {
        BoxLanes boxes;
        std::array<uint32_t, BoxLanes::kLanes> item{};
    };
    struct Cell {
        glm::dvec3 centre{0};
        double half = 0;  ///< half edge of the tight cell; the loose one reaches twice as far
        Box content;      ///< around all items in and below; may stay larger for a while when some leave
        std::array<uint32_t, 8> child{kNone, kNone, kNone, kNone, kNone, kNone, kNone, kNone};
        BoxLanes childContent;  ///< of each child
        std::vector<Entries> entries;
        uint32_t count = 0;  ///< items in `entries`
        uint32_t loose = 0;  ///< of those that left, how many may have bounded the content since it was fitted
        uint32_t below = 0;  ///< items in this cell and its children
        uint32_t parent = kNone;
        uint32_t octant = 0;  ///< place among the parent's children
    };
    struct Slot {
        uint32_t cell = kNone, place = 0;  ///< place among that cell's items; kNone: not in the tree
    };
    static bool holds(const Cell& cell, const Box& box);
    static Cell childOf(const Cell& cell, uint32_t octant);
    uint32_t cellFor(const Box& box);
    uint32_t addCell(Cell cell);
    void tellParent(uint32_t cell);
    void fit(uint32_t cell);
    void visit(uint32_t cell, const LaneQuery& query, std::vector<uint32_t>& items) const;
    void collect(uint32_t cell, std::vector<uint32_t>& items) const;
    void sortFrom(size_t first, std::vector<uint32_t>& items) const;
    /// `visit(item)` for each item of a cell itself, until it returns true; whether it did.
    template <class Visit>
    static bool eachItem(const Cell& cell, Visit visit) {
        for (uint32_t k = 0; k < cell.count; ++k)
            if (visit(cell.entries[k / BoxLanes::kLanes].item[k % BoxLanes::kLanes])) return true;
        return false;
    }
    template <class Test>
    void acceptedBelow(uint32_t cell, Test& test, std::vector<uint32_t>& items) const {
        eachItem(cells_[cell], [&](uint32_t item) {
            if (test(boxes_[item])) items.push_back(item);
            return false;
        });
        for (const uint32_t child : cells_[cell].child)
            if (child != kNone && test(cells_[child].content)) acceptedBelow(child, test, items);
    }
    template <class Test>
    bool anyBelow(uint32_t cell, Test& test) const {
        // Most items are far below, so one of them is met sooner than one of those that no child could hold.
        for (const uint32_t child : cells_[cell].child)
            if (child != kNone && test(cells_[child].content) && anyBelow(child, test)) return true;
        return eachItem(cells_[cell], [&](uint32_t item) { return test(boxes_[item]); });
    }

    std::vector<Cell> cells_;     ///< the first is the root; bounds of free ones mean nothing
    std::vector<uint32_t> free_;  ///< cells to be used again
    std::vector<Slot> slots_;     ///< by item
    std::vector<Box> boxes_;      ///< likewise
    double smallest_ = 1;
    size_t size_ = 0;
};

}  // namespace world
