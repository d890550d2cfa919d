// tests/world/level_set_test.cpp — the stored form of a band: exact, and nothing else decodes.
#include "world/level_set.h"

#include <gtest/gtest.h>

#include <cstring>
#include <random>

#include "tests/world/terrain_fields.h"
#include "world/terrain.h"

namespace world {
namespace {

/// Leaves at random places with random values: smooth in some, noise and voids in others.
LevelSet randomSet(std::mt19937& rng, int leaves) {
    LevelSet set{.voxel = 0.5 + double(rng() % 100), .side = int32_t(8 + rng() % 57), .leaves = {}};
    const auto columns = static_cast<unsigned>(bandSamples(set.side) / kLeafSide);
    for (int n = 0; n < leaves; ++n) {
        LevelSetLeaf leaf;
        leaf.origin = {int(rng() % columns) * 8 - kBandMargin, (int(rng() % 40) - 20) * 8,
                       int(rng() % columns) * 8 - kBandMargin};
        const unsigned kind = rng() % 3;
        for (int i = 0; i < kLeafSamples; ++i) {
            leaf.values[size_t(i)] = kind == 0   ? int16_t(rng())
                                     : kind == 1 ? int16_t(100 * (i >> 6) - 40 * (i & 7) + 3)
                                                 : kVoidSample;
        }
        set.leaves.push_back(leaf);
    }
    const auto key = [](const LevelSetLeaf& l) { return std::tuple(l.origin.x, l.origin.y, l.origin.z); };
    std::sort(set.leaves.begin(), set.leaves.end(), [&](auto& a, auto& b) { return key(a) < key(b); });
    set.leaves.erase(
        std::unique(set.leaves.begin(), set.leaves.end(), [&](auto& a, auto& b) { return key(a) == key(b); }),
        set.leaves.end());
    return set;
}

TEST(LevelSet, ComesBackAsItWas) {
    std::mt19937 rng(3);
    for (const int leaves : {0, 1, 2, 50, 400}) {
        const LevelSet set = randomSet(rng, leaves);
        const Result<LevelSet> back = decodeLevelSet(encodeLevelSet(set));
        ASSERT_TRUE(back) << back.error().what;
        EXPECT_EQ(back.value(), set);
    }
}

TEST(LevelSet, EveryTruncationIsRefused) {
    std::mt19937 rng(4);
    const std::vector<std::byte> bytes = encodeLevelSet(randomSet(rng, 3));
    for (size_t n = 0; n < bytes.size(); ++n) {
        const Result<LevelSet> cut = decodeLevelSet(std::span(bytes).first(n));
        ASSERT_FALSE(cut) << n << " bytes";
        ASSERT_EQ(cut.error().code, ErrorCode::kBadData);
    }
    std::vector<std::byte> longer = bytes;
    longer.push_back(std::byte{0});
    EXPECT_FALSE(decodeLevelSet(longer));
}

TEST(LevelSet, RefusesWhatEncodingCannotMake) {
    std::mt19937 rng(5);
    const auto refused = [](LevelSet set, auto&& spoil) {
        spoil(set);
        return !decodeLevelSet(encodeLevelSet(set));
    };
    const LevelSet set = randomSet(rng, 6);
    EXPECT_FALSE(refused(set, [](LevelSet&) {}));
    EXPECT_TRUE(refused(set, [](LevelSet& s) { s.voxel = 0; }));
    EXPECT_TRUE(refused(set, [](LevelSet& s) { s.voxel = NAN; }));
    EXPECT_TRUE(refused(set, [](LevelSet& s) { s.side = 0; }));
    EXPECT_TRUE(refused(set, [](LevelSet& s) { s.side = kMaxBandSide + 1; }));
    EXPECT_TRUE(refused(set, [](LevelSet& s) { s.leaves[0].origin.x += 1; }));
    EXPECT_TRUE(refused(set, [](LevelSet& s) { s.leaves[0].origin.x -= 8000; }));
    EXPECT_TRUE(refused(set, [](LevelSet& s) { s.leaves.back().origin.z = INT32_MAX; }));
    EXPECT_TRUE(refused(set, [](LevelSet& s) { s.leaves.back().origin.y = INT32_MIN; }));
    EXPECT_TRUE(refused(set, [](LevelSet& s) { s.leaves[1].origin = s.leaves[0].origin; }));
    EXPECT_TRUE(refused(set, [](LevelSet& s) { std::swap(s.leaves[0], s.leaves[1]); }));
    EXPECT_TRUE(refused(set, [](LevelSet& s) {
        s.leaves.back().origin = {s.side - 4 + 4 - (s.side + 0) % 8, 1 << 23, -4};
    }));
}

TEST(LevelSet, MutatedBytesAreRefusedOrMeshed) {
    std::mt19937 rng(6);
    const auto field = test::fieldOf(test::hillsWithCave, -60, 60);
    const std::vector<std::byte> bytes = encodeLevelSet(sampleLevelSet(field, {0, 0, 0}, 16, 4).value());
    int decoded = 0;
    for (int n = 0; n < 400; ++n) {
        std::vector<std::byte> bad = bytes;
        const size_t reach = n % 2 ? 300 : bad.size();  // half of them hit the head and the origins
        for (unsigned k = 0; k < 1 + rng() % 4; ++k) bad[rng() % reach] = std::byte(rng());
        const Result<LevelSet> set = decodeLevelSet(bad);
        if (!set) continue;
        ++decoded;
        if (bandSamples(set.value().side) <= 64) {
            for (const MeshLevel& level : meshLevelSet(set.value()).levels) {
                for (const uint32_t v : level.indices) ASSERT_LT(v, level.positions.size());
            }
        }
    }
    EXPECT_GT(decoded, 50);
}

TEST(LevelSet, ASurfaceCostsAboutAByteASample) {
    // Most residuals fit the low byte: the high plane is nearly all zero and compresses away.
    const auto field = test::fieldOf(test::hillsWithCave, -60, 60);
    const LevelSet set = sampleLevelSet(field, {0, 0, 0}, 64, 2).value();
    const std::vector<std::byte> bytes = encodeLevelSet(set);
    const size_t samples = set.leaves.size() * kLeafSamples;
    const size_t high = size_t(std::count_if(bytes.end() - ptrdiff_t(samples), bytes.end(),
                                             [](std::byte b) { return b != std::byte{0}; }));
    EXPECT_LT(high, samples / 3);
}

}  // namespace
}  // namespace world
