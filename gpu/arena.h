// gpu/arena.h — who owns which stretch of a fixed number of units: first fit, neighbours coalesce.
// Source: Knuth, "The Art of Computer Programming" vol. 1, 1968, section 2.5 (boundary order).
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

namespace gpu {

/// Counts units and knows nothing of the memory behind them. Not thread-safe.
class Arena {
public:
    explicit Arena(uint32_t capacity);

    /// Lowest offset with room for `count` > 0 units; nothing if no free stretch is that long.
    std::optional<uint32_t> allocate(uint32_t count);
    /// Frees exactly what `allocate(count)` gave out at `offset`.
    void release(uint32_t offset, uint32_t count);

    uint32_t capacity() const { return capacity_; }
    uint32_t used() const { return used_; }
    uint32_t largestFree() const;
    /// CHECKs that the free stretches ascend, do not touch, and add up with `used` to `capacity`.
    void validate() const;

private:
    struct Stretch {
        uint32_t offset = 0, count = 0;
    };
    uint32_t capacity_ = 0, used_ = 0;
    std::vector<Stretch> free_;  ///< ascending; no two touch
};

}  // namespace gpu
