#include "world/octree.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "world/check.h"

namespace world {
namespace {

/// Items that a cell gathers before it makes children for more: smaller cells would cost a query more in
/// scattered memory than the tests that they save. Of 8, 16, 32 and 64 this is the fastest, in scenes of 15,000
/// and 150,000 boxes, for strips and for whole windows.
constexpr uint32_t kRoomy = 4 * BoxLanes::kLanes;

/// Items that may have bounded a cell's content leave, up to this share of those that stay, before it is bounded
/// anew: so emptying a crowded cell takes a time in proportion.
constexpr uint32_t kLooseShare = 8;

constexpr double kMostDivisions = 1 << 20;  ///< of the root's edge: bounds the depth

/// Smallest power of two that is at least `v` > 0.
double powerOfTwo(double v) { return std::exp2(std::ceil(std::log2(v))); }

bool contains(const Box& around, const Box& box) {
    return glm::all(glm::lessThanEqual(around.min, box.min)) && glm::all(glm::lessThanEqual(box.max, around.max));
}

/// True if taking `box` out of what `around` bounds cannot shrink it.
bool strictlyInside(const Box& box, const Box& around) {
    return glm::all(glm::lessThan(around.min, box.min)) && glm::all(glm::lessThan(box.max, around.max));
}

}  // namespace

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
            if (cells_[at].count < kRoomy) break;
            child.parent = at;
            next = addCell(std::move(child));
            cells_[at].child[octant] = next;
        }
        at = next;
    }
    return at;
}

/// Hands a cell's content on to where its parent looks.
void Octree::tellParent(uint32_t cell) {
    const Cell& c = cells_[cell];
    if (c.parent != kNone) cells_[c.parent].childContent.set(c.octant, c.content, cells_[0].centre);
}

/// Bounds a cell's contents anew.
void Octree::fit(uint32_t cell) {
    Cell& c = cells_[cell];
    c.content = {};
    c.loose = 0;
    eachItem(c, [&](uint32_t item) {
        c.content.add(boxes_[item]);
        return false;
    });
    for (const uint32_t child : c.child)
        if (child != kNone) c.content.add(cells_[child].content);
    tellParent(cell);
}

void Octree::insert(uint32_t item, const Box& box) {
    CHECK(!box.empty());
    if (item >= slots_.size()) {
        slots_.resize(size_t{item} + 1);
        boxes_.resize(size_t{item} + 1);
    }
    CHECK(slots_[item].cell == kNone);
    const uint32_t at = cellFor(box);
    Cell& cell = cells_[at];
    slots_[item] = {at, cell.count};
    boxes_[item] = box;
    if (cell.count % BoxLanes::kLanes == 0) cell.entries.emplace_back();
    cell.entries.back().boxes.set(cell.count % BoxLanes::kLanes, box, cells_[0].centre);
    cell.entries.back().item[cell.count % BoxLanes::kLanes] = item;
    ++cell.count;
    for (uint32_t c = at; c != kNone; c = cells_[c].parent) {
        ++cells_[c].below;
        const Box before = cells_[c].content;
        cells_[c].content.add(box);
        if (cells_[c].content != before) tellParent(c);
    }
    ++size_;
}

void Octree::remove(uint32_t item) {
    CHECK(item < slots_.size() && slots_[item].cell != kNone);
    const Slot slot = slots_[item];
    slots_[item] = {};
    Cell& cell = cells_[slot.cell];
    const uint32_t last = --cell.count, lane = last % BoxLanes::kLanes;
    if (slot.place < last) {
        Entries& to = cell.entries[slot.place / BoxLanes::kLanes];
        const uint32_t moved = cell.entries.back().item[lane];
        to.boxes.copy(slot.place % BoxLanes::kLanes, cell.entries.back().boxes, lane);
        to.item[slot.place % BoxLanes::kLanes] = moved;
        slots_[moved].place = slot.place;
    }
    if (lane == 0) cell.entries.pop_back();
    for (uint32_t c = slot.cell; c != kNone;) {
        const uint32_t parent = cells_[c].parent;
        if (--cells_[c].below == 0 && parent != kNone) {
            cells_[parent].child[cells_[c].octant] = kNone;
            cells_[c].entries = {};
            free_.push_back(c);
        } else if (parent != kNone && !strictlyInside(boxes_[item], cells_[c].content) &&
                   ++cells_[c].loose * kLooseShare >= cells_[c].count) {
            fit(c);
        }
        c = parent;
    }
    --size_;
}

void Octree::visit(uint32_t cell, const LaneQuery& query, std::vector<uint32_t>& items) const {
    const Cell& c = cells_[cell];
    for (uint32_t first = 0; first < c.count; first += BoxLanes::kLanes) {
        const Entries& e = c.entries[first / BoxLanes::kLanes];
        const uint32_t used = std::min(c.count - first, BoxLanes::kLanes);
        for (uint32_t hits = query.touched(e.boxes) & ((1u << used) - 1); hits != 0; hits &= hits - 1)
            items.push_back(e.item[static_cast<size_t>(std::countr_zero(hits))]);
    }
    if (c.below == c.count) return;
    const uint32_t touched = query.touched(c.childContent), within = query.within(c.childContent);
    for (uint32_t octant = 0; octant < 8; ++octant) {
        if (c.child[octant] == kNone || (touched >> octant & 1) == 0) continue;
        if (within >> octant & 1) collect(c.child[octant], items);
        else visit(c.child[octant], query, items);
    }
}

void Octree::collect(uint32_t cell, std::vector<uint32_t>& items) const {
    eachItem(cells_[cell], [&](uint32_t item) {
        items.push_back(item);
        return false;
    });
    for (const uint32_t child : cells_[cell].child)
        if (child != kNone) collect(child, items);
}

void Octree::query(const TurnedBox& query, std::vector<uint32_t>& items) const {
    const size_t first = items.size();
    visit(0, LaneQuery(query, cells_[0].centre), items);
    sortFrom(first, items);
}

/// Items are unique and below slots_.size(): where many are found, marking them in a bitmap and reading
/// it back is several times faster than comparing them. The bitmap lies behind what was found.
void Octree::sortFrom(size_t first, std::vector<uint32_t>& items) const {
    const size_t end = items.size(), words = slots_.size() / 32 + 1;
    if ((end - first) * 8 < words) {
        std::sort(items.begin() + static_cast<std::ptrdiff_t>(first), items.end());
        return;
    }
    items.resize(end + words);
    for (size_t i = first; i < end; ++i) items[end + items[i] / 32] |= 1u << items[i] % 32;
    size_t to = first;
    for (size_t word = 0; word < words; ++word)
        for (uint32_t bits = items[end + word]; bits != 0; bits &= bits - 1)
            items[to++] = static_cast<uint32_t>(word * 32 + static_cast<size_t>(std::countr_zero(bits)));
    items.resize(end);
}

size_t Octree::size() const { return size_; }

void Octree::validate() const {
    std::vector<uint32_t> counted(cells_.size(), 0);
    size_t used = 0;
    for (uint32_t item = 0; item < slots_.size(); ++item) {
        const Slot& slot = slots_[item];
        if (slot.cell == kNone) continue;
        ++used;
        CHECK(slot.cell < cells_.size() && slot.place < cells_[slot.cell].count);
        const Entries& entries = cells_[slot.cell].entries[slot.place / BoxLanes::kLanes];
        CHECK(entries.item[slot.place % BoxLanes::kLanes] == item);
        CHECK(slot.cell == 0 || holds(cells_[slot.cell], boxes_[item]));
        for (uint32_t c = slot.cell; c != kNone; c = cells_[c].parent) {
            ++counted[c];
            CHECK(contains(cells_[c].content, boxes_[item]));
        }
    }
    CHECK(used == size_);
    std::vector<bool> isFree(cells_.size(), false);
    for (const uint32_t cell : free_) isFree[cell] = true;
    for (uint32_t c = 0; c < cells_.size(); ++c) {
        if (isFree[c]) continue;
        CHECK(counted[c] == cells_[c].below && (c == 0 || counted[c] > 0));
        CHECK(c == 0 || cells_[cells_[c].parent].child[cells_[c].octant] == c);
        CHECK(cells_[c].entries.size() == (cells_[c].count + BoxLanes::kLanes - 1) / BoxLanes::kLanes);
        for (const uint32_t child : cells_[c].child) CHECK(child == kNone || cells_[child].parent == c);
    }
}

}  // namespace world
