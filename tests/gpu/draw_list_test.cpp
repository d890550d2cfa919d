#include "gpu/draw_list.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <random>
#include <set>

namespace {

using cache::DrawItem;

/// One drawn range: index range in the arena, base vertex, transform.
using Drawn = std::array<int64_t, 4>;

/// Transforms that tell their number.
std::vector<glm::mat3x4> numbered() {
    std::vector<glm::mat3x4> transforms;
    for (int i = 0; i < 50; ++i) transforms.emplace_back(static_cast<float>(i));
    return transforms;
}

struct Lists {
    std::vector<VkDrawIndexedIndirectCommand> commands;
    std::vector<glm::mat3x4> instances;
    gpu::DrawList list;

    explicit Lists(size_t items) : commands(items), instances(items) { list.begin(commands, instances); }
    /// What the GPU makes of a run.
    std::vector<Drawn> expand(gpu::DrawRun run) const {
        std::vector<Drawn> drawn;
        for (uint32_t c = run.first; c < run.first + run.count; ++c)
            for (uint32_t i = 0; i < commands[c].instanceCount; ++i)
                drawn.push_back({commands[c].firstIndex, commands[c].indexCount, commands[c].vertexOffset,
                                 static_cast<int64_t>(instances[commands[c].firstInstance + i][0].x)});
        std::sort(drawn.begin(), drawn.end());
        return drawn;
    }
};

TEST(DrawList, DrawsEachItemOnceAndEachRangeWithOneCommand) {
    std::mt19937 rng(1);
    std::vector<gpu::ArenaRange> geometries;
    for (int g = 0; g < 12; ++g)
        geometries.push_back({static_cast<int32_t>(rng() % 1000000), static_cast<uint32_t>(rng()) >> 1, 90});
    for (int round = 0; round < 200; ++round) {
        std::vector<DrawItem> items(rng() % 300);
        for (DrawItem& item : items)
            item = {static_cast<uint32_t>(rng() % geometries.size()), static_cast<uint32_t>(rng() % 3 * 30),
                    static_cast<uint32_t>(rng() % 3 * 15), static_cast<uint32_t>(rng() % 50)};
        Lists lists(items.size());
        // Several passes, one after the other, share the frame's lists.
        for (size_t first = 0; first < items.size();) {
            const size_t count = std::min(items.size() - first, 1 + rng() % 200);
            const auto pass = std::span(items).subspan(first, count);
            const gpu::DrawRun run = lists.list.add(pass, geometries, numbered());
            std::vector<Drawn> expected;
            std::set<std::array<uint32_t, 3>> ranges;
            for (const DrawItem& item : pass) {
                if (item.indexCount == 0) continue;
                const gpu::ArenaRange& g = geometries[item.geometry];
                expected.push_back(
                    {int64_t{g.firstIndex} + item.firstIndex, item.indexCount, g.baseVertex, item.transform});
                ranges.insert({item.geometry, item.firstIndex, item.indexCount});
            }
            std::sort(expected.begin(), expected.end());
            ASSERT_EQ(lists.expand(run), expected) << "round " << round;
            ASSERT_EQ(run.count, ranges.size()) << "round " << round;
            first += count;
        }
    }
}

TEST(DrawList, AnEmptyPassHasNoDraws) {
    Lists lists(0);
    EXPECT_EQ(lists.list.add({}, {}, {}).count, 0u);
    EXPECT_EQ(lists.list.commandCount(), 0u);
    EXPECT_EQ(lists.list.instanceCount(), 0u);
}

TEST(DrawListDeathTest, StopsAtARangeOutsideItsMesh) {
    GTEST_FLAG_SET(death_test_style, "threadsafe");  // a driver that other tests loaded has threads
    const std::vector<gpu::ArenaRange> geometries{{0, 0, 30}};
    Lists lists(1);
    const DrawItem beyond{0, 15, 18, 0}, wraps{0, 3, UINT32_MAX, 0}, foreign{1, 0, 3, 0},
        nowhere{0, 0, 3, 50};
    EXPECT_DEATH(lists.list.add({&beyond, 1}, geometries, numbered()), "broken invariant");
    EXPECT_DEATH(lists.list.add({&wraps, 1}, geometries, numbered()), "broken invariant");
    EXPECT_DEATH(lists.list.add({&foreign, 1}, geometries, numbered()), "broken invariant");
    EXPECT_DEATH(lists.list.add({&nowhere, 1}, geometries, numbered()), "broken invariant");
}

}  // namespace
