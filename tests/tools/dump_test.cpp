// tests/tools/dump_test.cpp — pictures come out of the torus in window order and tint what they must.
#include "tools/dump.h"

#include <gtest/gtest.h>

#include <random>

#include "server/cascade_images.h"

namespace {

using tools::RgbImage;
using tools::ScrollMaps;
using Rgb = std::array<uint8_t, 3>;

size_t storedAt(cache::Texel texel, int side) {
    int64_t x = texel.x, y = texel.y;
    while (x < 0) x += side;  // slow and plain: the yardstick
    while (y < 0) y += side;
    return size_t(y % side) * size_t(side) + size_t(x % side);
}

Rgb pixel(const RgbImage& image, int view, int x, int y) {
    const size_t at =
        3 * (size_t(view) * size_t(image.width) + size_t(y)) * size_t(image.width) + 3 * size_t(x);
    return {image.pixels[at], image.pixels[at + 1], image.pixels[at + 2]};
}

bool isGray(Rgb c) { return c[0] == c[1] && c[1] == c[2]; }

TEST(Unwrap, PutsEachTexelWhereTheWindowHasIt) {
    std::mt19937 rng(1);
    // The last offset is 1000 km in texels of 1 mm.
    for (int64_t far : {int64_t(0), int64_t(20), int64_t(1'000'000'000)}) {
        for (int side : {1, 2, 7, 16}) {
            for (int round = 0; round < 20; ++round) {
                const cache::Texel window{far + int64_t(rng() % 40), int64_t(rng() % 40) - 20};
                std::vector<float> stored(size_t(side) * size_t(side));
                for (size_t k = 0; k < stored.size(); ++k) stored[k] = float(k);
                const std::vector<float> image = server::unwrap(stored, side, window);
                for (int y = 0; y < side; ++y)
                    for (int x = 0; x < side; ++x)
                        ASSERT_EQ(image[size_t(y * side + x)],
                                  stored[storedAt(window + cache::Texel(x, y), side)])
                            << "side " << side << ", window " << window.x << ", " << window.y;
            }
        }
    }
}

/// A cache that scrolled: everything outside the old window cleared and drawn, one more region cleared.
struct Scene {
    int side = 16;
    cache::Texel window{-37, 1005}, move{3, -2};
    std::vector<float> before, after;
    std::vector<cache::StoreRect> cleared;

    explicit Scene(uint32_t seed) {
        std::mt19937 rng(seed);
        std::uniform_real_distribution<float> depth(0.25f, 0.75f);
        for (int k = 0; k < side * side; ++k) before.push_back(depth(rng));
        after = before;
        for (int y = 0; y < side; ++y)
            for (int x = 0; x < side; ++x)
                if (exposed(x, y) || departed(x, y)) {
                    const auto at = int(storedAt(window + cache::Texel(x, y), side));
                    cleared.push_back({{at % side, at / side}, {at % side + 1, at / side + 1}});
                    after[size_t(at)] = rng() % 4 == 0 ? 1.0f : depth(rng);
                }
    }
    bool exposed(int x, int y) const { return x >= side - 3 || y < 2; }
    bool departed(int x, int y) const { return x >= 4 && x < 7 && y >= 8 && y < 10; }
    ScrollMaps maps() const { return {side, window, move, before, after, after, cleared}; }
};

TEST(ScrollPicture, TintsWhatWasLostAndShowsWhatWasDrawn) {
    Scene scene(2);
    // One arrival: a kept texel that came nearer.
    const cache::Texel arrival{5, 5};
    scene.after[storedAt(scene.window + arrival, scene.side)] = 0.2f;
    const RgbImage image = tools::scrollPicture(scene.maps());
    ASSERT_EQ(image.width, scene.side);
    ASSERT_EQ(image.height, 3 * scene.side);
    const Rgb exposedTint = pixel(image, 1, scene.side - 1, 5), departedTint = pixel(image, 1, 5, 9);
    const Rgb untouched = pixel(image, 2, 0, 4);
    EXPECT_FALSE(isGray(exposedTint));
    EXPECT_FALSE(isGray(departedTint));
    EXPECT_NE(exposedTint, departedTint);
    for (int y = 0; y < scene.side; ++y) {
        for (int x = 0; x < scene.side; ++x) {
            const std::string at = std::to_string(x) + ", " + std::to_string(y);
            const bool empty = scene.after[storedAt(scene.window + cache::Texel(x, y), scene.side)] == 1;
            EXPECT_NE(isGray(pixel(image, 0, x, y)), empty) << at;  // empty texels are blue
            if (scene.exposed(x, y)) {
                EXPECT_EQ(pixel(image, 1, x, y), exposedTint) << at;
            } else if (scene.departed(x, y)) {
                EXPECT_EQ(pixel(image, 1, x, y), departedTint) << at;
            } else {
                EXPECT_TRUE(isGray(pixel(image, 1, x, y))) << at;
            }
            const bool drawn = scene.exposed(x, y) || scene.departed(x, y) || cache::Texel(x, y) == arrival;
            EXPECT_EQ(pixel(image, 2, x, y) != untouched, drawn) << at;
            if (drawn && !empty) {
                EXPECT_EQ(pixel(image, 2, x, y), pixel(image, 0, x, y)) << at;
            }
        }
    }
}

TEST(ScrollPicture, AnEmptyMapHasNoDepthToStretch) {
    const std::vector<float> empty(64, 1.0f), flat(64, 0.5f);
    EXPECT_FALSE(isGray(pixel(tools::scrollPicture({8, {0, 0}, {0, 0}, empty, empty, empty, {}}), 0, 3, 3)));
    EXPECT_TRUE(isGray(pixel(tools::scrollPicture({8, {0, 0}, {0, 0}, flat, flat, flat, {}}), 0, 3, 3)));
}

TEST(ScrollPicture, WhatStandsOnTiltedGroundStandsOut) {
    const int side = 32;
    std::vector<float> ground(size_t(side) * size_t(side));
    for (int y = 0; y < side; ++y)
        for (int x = 0; x < side; ++x) ground[size_t(y * side + x)] = 0.2f + 0.01f * float(x + y);
    for (int y = 10; y < 14; ++y)
        for (int x = 10; x < 14; ++x) ground[size_t(y * side + x)] -= 0.005f;  // a hundredth of the slope's span
    const RgbImage image = tools::scrollPicture({side, {0, 0}, {0, 0}, ground, ground, ground, {}});
    EXPECT_GT(pixel(image, 0, 12, 12)[0], pixel(image, 0, 20, 12)[0] + 100);
    EXPECT_NEAR(pixel(image, 0, 2, 2)[0], pixel(image, 0, 29, 29)[0], 20);
}

TEST(Dump, SpreadsEightFramesEvenly) {
    const auto folder = tools::OutputFolder::create(testing::TempDir() + "gnomon_dump_frames");
    ASSERT_TRUE(folder);
    for (size_t frames : {1u, 3u, 8u, 9u, 100u, 1980u}) {
        const tools::Dump dump(folder.value(), frames);
        size_t wanted = 0, last = 0, widest = 0;
        for (size_t k = 0; k < frames; ++k) {
            if (!dump.wants(k)) continue;
            if (wanted > 0) widest = std::max(widest, k - last);
            last = k;
            ++wanted;
        }
        EXPECT_EQ(wanted, std::min<size_t>(frames, 8)) << frames;
        EXPECT_LE(widest, frames / 8 + 1) << frames;
        EXPECT_FALSE(dump.wants(frames));
    }
}

}  // namespace
