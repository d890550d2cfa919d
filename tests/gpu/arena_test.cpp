#include "gpu/arena.h"

#include <gtest/gtest.h>

#include <random>
#include <vector>

namespace {

/// The dumb arena: a flag per unit.
struct Flags {
    std::vector<bool> used;

    std::optional<uint32_t> firstFit(uint32_t count) const {
        uint32_t run = 0;
        for (uint32_t i = 0; i < used.size(); ++i) {
            run = used[i] ? 0 : run + 1;
            if (run == count) return i + 1 - count;
        }
        return std::nullopt;
    }
    uint32_t largestFree() const {
        uint32_t run = 0, largest = 0;
        for (const bool u : used) {
            run = u ? 0 : run + 1;
            largest = std::max(largest, run);
        }
        return largest;
    }
    void set(uint32_t offset, uint32_t count, bool value) {
        for (uint32_t i = offset; i < offset + count; ++i) used[i] = value;
    }
};

TEST(Arena, AgreesWithAFlagPerUnit) {
    for (const uint32_t capacity : {1u, 7u, 64u, 1000u}) {
        std::mt19937 rng(capacity);
        gpu::Arena arena(capacity);
        Flags flags{std::vector<bool>(capacity)};
        std::vector<std::pair<uint32_t, uint32_t>> live;
        for (int step = 0; step < 4000; ++step) {
            if (live.empty() || rng() % 2 == 0) {
                const uint32_t count = 1 + static_cast<uint32_t>(rng() % (1 + capacity / 6));
                const auto offset = arena.allocate(count);
                ASSERT_EQ(offset, flags.firstFit(count)) << "step " << step;
                if (offset) {
                    flags.set(*offset, count, true);
                    live.emplace_back(*offset, count);
                }
            } else {
                std::swap(live[rng() % live.size()], live.back());
                arena.release(live.back().first, live.back().second);
                flags.set(live.back().first, live.back().second, false);
                live.pop_back();
            }
            arena.validate();
            ASSERT_EQ(arena.used(), std::count(flags.used.begin(), flags.used.end(), true))
                << "step " << step;
            ASSERT_EQ(arena.largestFree(), flags.largestFree()) << "step " << step;
        }
        for (const auto& [offset, count] : live) arena.release(offset, count);
        arena.validate();
        ASSERT_EQ(arena.largestFree(), capacity) << "all of it in one piece again";
    }
}

TEST(Arena, HoldsNothingWithoutCapacity) {
    gpu::Arena arena(0);
    arena.validate();
    EXPECT_EQ(arena.allocate(1), std::nullopt);
}

TEST(Arena, FillsToTheLastUnitOfTheLargestCapacity) {
    gpu::Arena arena(UINT32_MAX);
    EXPECT_EQ(arena.allocate(UINT32_MAX - 1), 0u);
    EXPECT_EQ(arena.allocate(2), std::nullopt);
    EXPECT_EQ(arena.allocate(1), UINT32_MAX - 1);
    arena.release(0, UINT32_MAX - 1);
    arena.validate();
    arena.release(UINT32_MAX - 1, 1);
    arena.validate();
    EXPECT_EQ(arena.largestFree(), UINT32_MAX);
}

TEST(ArenaDeathTest, StopsAtASecondRelease) {
    GTEST_FLAG_SET(death_test_style, "threadsafe");  // a driver that other tests loaded has threads
    gpu::Arena arena(10);
    ASSERT_EQ(arena.allocate(4), 0u);
    ASSERT_EQ(arena.allocate(4), 4u);
    arena.release(0, 4);
    EXPECT_DEATH(arena.release(0, 4), "broken invariant");
    EXPECT_DEATH(arena.release(2, 4), "broken invariant");
    EXPECT_DEATH(arena.release(8, 4), "broken invariant");
}

}  // namespace
