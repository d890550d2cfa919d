#include "world/octree.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "world/check.h"

namespace world {
namespace {

/// Bounds the rounding of a three-term dot product of doubles and of the sums around it: a few units of
/// 2^-53 of the magnitudes involved, rounded up generously.
constexpr double kRounding = 1e-14;

/// Entries that a cell gathers before it makes children for more: a cell each for most items would cost
/// a query more in scattered memory than the tests that it saves.
constexpr size_t kRoomy = 8;

constexpr double kMostDivisions = 1 << 20;  ///< of the root's edge: bounds the depth

double sum(glm::dvec3 v) { return std::abs(v.x) + std::abs(v.y) + std::abs(v.z); }

/// Smallest power of two that is at least `v` > 0.
double powerOfTwo(double v) { return std::exp2(std::ceil(std::log2(v))); }

using Axes = std::array<glm::dvec3, 3>;

Axes absolute(const Axes& axis) { return {glm::abs(axis[0]), glm::abs(axis[1]), glm::abs(axis[2])}; }

bool touches(const TurnedBox& query, const Axes& absolute, const Box& box) {
    const glm::dvec3 centre = box.centre(), half = box.extent() * 0.5;
    const double slack = kRounding * (sum(centre) + sum(half));
    for (size_t k = 0; k < 3; ++k) {
        const double at = glm::dot(query.axis[k], centre), reach = glm::dot(absolute[k], half) + slack;
        if (at + reach < query.lo[static_cast<int>(k)] || at - reach > query.hi[static_cast<int>(k)])
            return false;
    }
    return true;
}

enum class Side { kOutside, kAcross, kInside };

}  // namespace

bool TurnedBox::mayTouch(const Box& box) const { return !box.empty() && touches(*this, absolute(axis), box); }

/// A query with the absolute values of its axes, which turn half extents into reaches.
struct Octree::Probe {
    explicit Probe(const TurnedBox& turned) : query(turned), absolutes(absolute(turned.axis)) {
        for (size_t k = 0; k < 3; ++k) cubeReach[k] = sum(turned.axis[k]);
    }
    /// Where the cell's loose bounds lie. What a cell holds is then on the same side by `mayTouch`: the
    /// slack of the cell exceeds that of the item.
    Side side(const Cell& cell) const {
        const double half = 2 * cell.half, slack = 4 * kRounding * (sum(cell.centre) + 3 * half);
        bool inside = true;
        for (size_t k = 0; k < 3; ++k) {
            const double at = glm::dot(query.axis[k], cell.centre), reach = cubeReach[k] * half + slack;
            const double lo = query.lo[static_cast<int>(k)], hi = query.hi[static_cast<int>(k)];
            if (at + reach < lo || at - reach > hi) return Side::kOutside;
            inside = inside && at - reach >= lo && at + reach <= hi;
        }
        return inside ? Side::kInside : Side::kAcross;
    }

    const TurnedBox& query;
    Axes absolutes;
    std::array<double, 3> cubeReach{};  ///< of a cube of half edge 1, along each axis
};

Octree::Octree(const Box& bounds, double smallestCell) {
    CHECK(smallestCell > 0 && std::isfinite(smallestCell));
    Cell root;
    root.half = powerOfTwo(smallestCell) / 2;
    const glm::dvec3 extent = bounds.empty() ? glm::dvec3(0) : bounds.extent();
    const double longest = std::max({extent.x, extent.y, extent.z});
    if (std::isfinite(longest) && longest > 0) {
        // Edges are powers of two and centres multiples of one, so that cells are exact in double: what
        // lies in a cell is then a matter of comparisons alone, however far out it is.
        root.half = std::max(root.half, powerOfTwo(longest * 0.501));
        const double unit = root.half / 1024;
        root.centre = glm::floor(bounds.centre() / unit + 0.5) * unit;
    }
    smallest_ = std::max(powerOfTwo(smallestCell), 2 * root.half / kMostDivisions);
    addCell(std::move(root));
}

bool Octree::holds(const Cell& cell, const Box& box) {
    const glm::dvec3 reach(2 * cell.half);
    return glm::all(glm::lessThanEqual(cell.centre - reach, box.min)) &&
           glm::all(glm::lessThanEqual(box.max, cell.centre + reach));
}

Octree::Cell Octree::childOf(const Cell& cell, uint32_t octant) {
    Cell child;
    child.half = cell.half / 2;
    for (int axis = 0; axis < 3; ++axis)
        child.centre[axis] = cell.centre[axis] + (octant >> axis & 1 ? child.half : -child.half);
    child.octant = octant;
    return child;
}

uint32_t Octree::addCell(Cell cell) {
    if (free_.empty()) {
        cells_.push_back(std::move(cell));
        return static_cast<uint32_t>(cells_.size() - 1);
    }
    const uint32_t index = free_.back();
    free_.pop_back();
    cells_[index] = std::move(cell);
    return index;
}

/// The smallest cell around the box's centre that holds it, but no smaller than the contents ask for;
/// made if need be.
uint32_t Octree::cellFor(const Box& box) {
    const glm::dvec3 centre = box.centre();
    uint32_t at = 0;
    while (cells_[at].half >= smallest_) {
        uint32_t octant = 0;
        for (uint32_t axis = 0; axis < 3; ++axis)
            octant |= uint32_t{centre[static_cast<int>(axis)] >= cells_[at].centre[static_cast<int>(axis)]}
                      << axis;
        Cell child = childOf(cells_[at], octant);
        if (!holds(child, box)) break;
        uint32_t next = cells_[at].child[octant];
        if (next == kNone) {
            if (cells_[at].entries.size() < kRoomy) break;
            child.parent = at;
            next = addCell(std::move(child));
            cells_[at].child[octant] = next;
        }
        at = next;
    }
    return at;
}

void Octree::insert(uint32_t item, const Box& box) {
    CHECK(!box.empty());
    if (item >= slots_.size()) slots_.resize(size_t{item} + 1);
    CHECK(slots_[item].cell == kNone);
    const uint32_t cell = cellFor(box);
    slots_[item] = {cell, static_cast<uint32_t>(cells_[cell].entries.size())};
    cells_[cell].entries.push_back({box, item});
    for (uint32_t c = cell; c != kNone; c = cells_[c].parent) ++cells_[c].below;
    ++size_;
}

void Octree::remove(uint32_t item) {
    CHECK(item < slots_.size() && slots_[item].cell != kNone);
    const Slot slot = slots_[item];
    slots_[item] = {};
    std::vector<Entry>& entries = cells_[slot.cell].entries;
    if (slot.place + 1 < entries.size()) {
        entries[slot.place] = entries.back();
        slots_[entries[slot.place].item].place = slot.place;
    }
    entries.pop_back();
    for (uint32_t c = slot.cell; c != kNone;) {
        const uint32_t parent = cells_[c].parent;
        if (--cells_[c].below == 0 && parent != kNone) {
            cells_[parent].child[cells_[c].octant] = kNone;
            cells_[c].entries = {};
            free_.push_back(c);
        }
        c = parent;
    }
    --size_;
}

void Octree::move(uint32_t item, const Box& box) {
    CHECK(item < slots_.size() && slots_[item].cell != kNone && !box.empty());
    const Slot slot = slots_[item];
    if (slot.cell != 0 && holds(cells_[slot.cell], box)) {
        cells_[slot.cell].entries[slot.place].box = box;
        return;
    }
    remove(item);
    insert(item, box);
}

void Octree::visit(uint32_t cell, const Probe& probe, std::vector<uint32_t>& items) const {
    const Cell& c = cells_[cell];
    for (const Entry& e : c.entries)
        if (touches(probe.query, probe.absolutes, e.box)) items.push_back(e.item);
    for (const uint32_t child : c.child) {
        if (child == kNone) continue;
        const Side side = probe.side(cells_[child]);
        if (side == Side::kInside) collect(child, items);
        if (side == Side::kAcross) visit(child, probe, items);
    }
}

void Octree::collect(uint32_t cell, std::vector<uint32_t>& items) const {
    for (const Entry& e : cells_[cell].entries) items.push_back(e.item);
    for (const uint32_t child : cells_[cell].child)
        if (child != kNone) collect(child, items);
}

void Octree::query(const TurnedBox& query, std::vector<uint32_t>& items) const {
    const size_t first = items.size();
    visit(0, Probe(query), items);
    sortFrom(first, items);
}

/// Items are unique and below slots_.size(): where many are found, marking them in a bitmap and reading
/// it back is several times faster than comparing them.
void Octree::sortFrom(size_t first, std::vector<uint32_t>& items) const {
    if ((items.size() - first) * 16 < slots_.size() / 64 + 16) {
        std::sort(items.begin() + static_cast<std::ptrdiff_t>(first), items.end());
        return;
    }
    std::vector<uint64_t> marks(slots_.size() / 64 + 1);
    for (size_t i = first; i < items.size(); ++i) marks[items[i] / 64] |= uint64_t{1} << items[i] % 64;
    size_t to = first;
    for (size_t word = 0; word < marks.size(); ++word)
        for (uint64_t bits = marks[word]; bits != 0; bits &= bits - 1)
            items[to++] = static_cast<uint32_t>(word * 64 + static_cast<size_t>(std::countr_zero(bits)));
}

size_t Octree::size() const { return size_; }

void Octree::validate() const {
    std::vector<uint32_t> counted(cells_.size(), 0);
    size_t used = 0;
    for (uint32_t item = 0; item < slots_.size(); ++item) {
        const Slot& slot = slots_[item];
        if (slot.cell == kNone) continue;
        ++used;
        CHECK(slot.cell < cells_.size() && slot.place < cells_[slot.cell].entries.size());
        const Entry& entry = cells_[slot.cell].entries[slot.place];
        CHECK(entry.item == item);
        CHECK(slot.cell == 0 || holds(cells_[slot.cell], entry.box));
        for (uint32_t c = slot.cell; c != kNone; c = cells_[c].parent) ++counted[c];
    }
    CHECK(used == size_);
    std::vector<bool> isFree(cells_.size(), false);
    for (const uint32_t cell : free_) isFree[cell] = true;
    for (uint32_t c = 0; c < cells_.size(); ++c) {
        if (isFree[c]) continue;
        CHECK(counted[c] == cells_[c].below && (c == 0 || counted[c] > 0));
        CHECK(c == 0 || cells_[cells_[c].parent].child[cells_[c].octant] == c);
        for (const uint32_t child : cells_[c].child) CHECK(child == kNone || cells_[child].parent == c);
    }
}

}  // namespace world
