#include "gpu/arena.h"

#include <algorithm>

#include "world/check.h"

namespace gpu {

Arena::Arena(uint32_t capacity) : capacity_(capacity) {
    if (capacity > 0) free_.push_back({0, capacity});
}

std::optional<uint32_t> Arena::allocate(uint32_t count) {
    CHECK(count > 0);
    const auto fit =
        std::find_if(free_.begin(), free_.end(), [count](Stretch s) { return s.count >= count; });
    if (fit == free_.end()) return std::nullopt;
    const uint32_t offset = fit->offset;
    fit->offset += count;
    fit->count -= count;
    if (fit->count == 0) free_.erase(fit);
    used_ += count;
    return offset;
}

void Arena::release(uint32_t offset, uint32_t count) {
    CHECK(count > 0 && count <= used_ && offset <= capacity_ && count <= capacity_ - offset);
    const auto next = std::lower_bound(free_.begin(), free_.end(), offset,
                                       [](Stretch s, uint32_t at) { return s.offset < at; });
    const bool before = next != free_.begin() && std::prev(next)->offset + std::prev(next)->count >= offset;
    const bool after = next != free_.end() && offset + count >= next->offset;
    // Overlap with a free stretch means that it was freed twice.
    CHECK(!before || std::prev(next)->offset + std::prev(next)->count == offset);
    CHECK(!after || offset + count == next->offset);
    used_ -= count;
    if (before && after) {
        std::prev(next)->count += count + next->count;
        free_.erase(next);
    } else if (before) {
        std::prev(next)->count += count;
    } else if (after) {
        next->offset = offset;
        next->count += count;
    } else {
        free_.insert(next, {offset, count});
    }
}

uint32_t Arena::largestFree() const {
    uint32_t largest = 0;
    for (const Stretch& s : free_) largest = std::max(largest, s.count);
    return largest;
}

void Arena::validate() const {
    uint64_t sum = used_, end = 0;
    for (size_t i = 0; i < free_.size(); ++i) {
        CHECK(free_[i].count > 0);
        CHECK(i == 0 || free_[i].offset > end);
        end = uint64_t{free_[i].offset} + free_[i].count;
        sum += free_[i].count;
    }
    CHECK(end <= capacity_ && sum == capacity_);
}

}  // namespace gpu
