// The proof of coverage: never grants a texel that a rasteriser could leave open or draw deeper.
#include "culling/coverage.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "tests/culling/scalar_coverage.h"

namespace {

using culling::Coverage;
using culling::kSnapTexels;
using culling::PlacedTriangle;

constexpr double kFarOff = std::numeric_limits<double>::infinity();

/// What triangles of one caster prove at texel (0, 0), whose centre is (0.5, 0.5).
double provenAt(std::initializer_list<PlacedTriangle> triangles, double margin) {
    Coverage coverage;
    coverage.reset({1, 1});
    for (const PlacedTriangle& t : triangles) coverage.add(0, t, margin);
    coverage.join();
    return coverage.depth({0, 0});
}

TEST(Coverage, AGrantedTexelStaysInsideWhenCornersSnap) {
    std::mt19937 rng(2);
    std::uniform_real_distribution<double> place(-3, 3), depth(0, 50), nudge(-1.0 / 512, 1.0 / 512);
    int granted = 0;
    for (int step = 0; step < 200000; ++step) {
        PlacedTriangle t;
        for (auto& corner : t) corner = {place(rng), place(rng), depth(rng)};
        const glm::dvec2 p(0.5, 0.5);
        const double bound = provenAt({t}, kSnapTexels);
        if (bound == kFarOff) continue;
        ++granted;
        for (int trial = 0; trial < 4; ++trial) {
            PlacedTriangle snapped = t;
            for (auto& corner : snapped) {
                corner.x += nudge(rng);
                corner.y += nudge(rng);
            }
            for (int e = 0; e < 3; ++e) ASSERT_GT(tests::edgeDistance(snapped, e, p), 0) << "step " << step;
            // The same plane through moved corners: as deep as the bound at most.
            ASSERT_LE(tests::depthBound(snapped, p, 0), bound + 1e-9) << "step " << step;
        }
    }
    EXPECT_GT(granted, 1000);
}

/// Casters of a few triangles each over a square of texels: fans that share edges, some folded, some with
/// corners or edges that run through texel centres, some far larger than the square.
struct Heap {
    std::vector<std::vector<PlacedTriangle>> casters;
    Heap(std::mt19937& rng, int side) {
        std::uniform_real_distribution<double> depth(0, 50);
        const auto count = [&](int most) { return int(rng() % uint32_t(most)); };
        for (int c = 1 + count(6); c > 0; --c) {
            const double size = std::array{1.5, 6.0, 40.0}[rng() % 3];
            std::uniform_real_distribution<double> place(-size, side + size), round(-1, 1);
            const glm::dvec2 hub(std::floor(place(rng)) + 0.5 * count(2), std::floor(place(rng)) + 0.5 * count(2));
            std::vector<glm::dvec3> rim;
            for (int k = 3 + count(4); k > 0; --k) {
                glm::dvec3 corner(hub + size * glm::dvec2(round(rng), round(rng)), depth(rng));
                if (count(2)) corner = {std::floor(corner.x) + 0.5, std::floor(corner.y) + 0.5, corner.z};
                rim.push_back(corner);
            }
            const glm::dvec3 centre(hub, depth(rng));
            auto& triangles = casters.emplace_back();
            for (size_t k = 0; k + 1 < rim.size(); ++k)
                triangles.push_back(count(2) ? PlacedTriangle{centre, rim[k], rim[k + 1]}
                                             : PlacedTriangle{rim[k + 1], rim[k], centre});
        }
    }
};

TEST(Coverage, SpansProveWhatTexelsOneByOneProve) {
    std::mt19937 rng(11);
    constexpr int kSide = 9;
    constexpr double kMargin = 0.05;  // wider than real, so that edges are met more often
    Coverage coverage;
    int proven = 0, joined = 0, undecided = 0;
    for (int step = 0; step < 6000; ++step) {
        const Heap heap(rng, kSide);
        coverage.reset({kSide, kSide});
        for (size_t c = 0; c < heap.casters.size(); ++c)
            for (const PlacedTriangle& t : heap.casters[c]) coverage.add(world::CasterId(c), t, kMargin);
        coverage.join();
        for (int y = 0; y < kSide; ++y)
            for (int x = 0; x < kSide; ++x) {
                // Both compare distances with the margin, each with its own rounding: where a hair of margin
                // decides, either answer is right.
                const glm::dvec2 p(x + 0.5, y + 0.5);
                const auto expected = [&](double margin, bool join) {
                    std::pair<double, world::CasterId> best(kFarOff, 0);
                    for (size_t c = 0; c < heap.casters.size(); ++c)
                        for (const PlacedTriangle& t : heap.casters[c])
                            if (const auto d = tests::coveredDepth(t, p, margin, join ? std::span(heap.casters[c]) : std::span<const PlacedTriangle>());
                                d && *d < best.first)
                                best = {*d, world::CasterId(c)};
                    return best;
                };
                const auto wide = expected(kMargin - 1e-9, true), tight = expected(kMargin + 1e-9, true);
                // Slopes are charged for the margin: steep ones turn 1e-9 texels into more metres than rounding does.
                if (wide.second != tight.second || !(std::abs(wide.first - tight.first) <= 1e-3 || wide.first == tight.first)) {
                    ++undecided;
                    continue;
                }
                const double depth = coverage.depth({x, y});
                if (wide.first == kFarOff) {
                    ASSERT_EQ(depth, kFarOff) << "step " << step << " texel " << x << ' ' << y;
                    continue;
                }
                ++proven;
                joined += expected(kMargin, false).first != expected(kMargin, true).first;
                ASSERT_NEAR(depth, wide.first, std::abs(wide.first - tight.first) + 1e-6 * (1 + std::abs(depth)))
                    << "step " << step << " texel " << x << ' ' << y;
                ASSERT_EQ(coverage.caster({x, y}), wide.second) << "step " << step << " texel " << x << ' ' << y;
            }
    }
    EXPECT_GT(proven, 50000);
    EXPECT_GT(joined, 500) << "edges are met too rarely for the test to mean something";
    EXPECT_LT(undecided, proven / 100);
}

TEST(Coverage, OrderDoesNotMatter) {
    std::mt19937 rng(5);
    constexpr int kSide = 7;
    Coverage forth, back;
    for (int step = 0; step < 300; ++step) {
        const Heap heap(rng, kSide);
        forth.reset({kSide, kSide});
        back.reset({kSide, kSide});
        for (size_t c = 0; c < heap.casters.size(); ++c)
            for (const PlacedTriangle& t : heap.casters[c]) forth.add(world::CasterId(c), t, kSnapTexels);
        for (size_t c = heap.casters.size(); c-- > 0;)
            for (size_t k = heap.casters[c].size(); k-- > 0;) back.add(world::CasterId(c), heap.casters[c][k], kSnapTexels);
        forth.join();
        back.join();
        for (int y = 0; y < kSide; ++y)
            for (int x = 0; x < kSide; ++x) ASSERT_EQ(forth.depth({x, y}), back.depth({x, y})) << "step " << step;
    }
}

TEST(Coverage, ASharedEdgeCoversAndAFoldOrAGapDoesNot) {
    // The texel's centre lies on the edge from (2, -1) to (-1, 2).
    const PlacedTriangle left{glm::dvec3(-1, -1, 5), {2, -1, 5}, {-1, 2, 5}};
    const PlacedTriangle right{glm::dvec3(2, -1, 5), {2, 2, 7}, {-1, 2, 5}};
    const PlacedTriangle apart{glm::dvec3(2, -1, 5 + 1e-9), {2, 2, 7}, {-1, 2, 5}};
    const PlacedTriangle folded{glm::dvec3(2, -1, 5), {-2, -1.5, 7}, {-1, 2, 5}};
    const auto proven = [](std::initializer_list<PlacedTriangle> triangles) {
        return provenAt(triangles, 0.01) < kFarOff;
    };
    EXPECT_GE(provenAt({left, right}, 0.01), 5);
    EXPECT_TRUE(proven({left, right}));
    EXPECT_FALSE(proven({left}));
    EXPECT_FALSE(proven({left, left})) << "twins close no gap";
    EXPECT_FALSE(proven({left, folded}));
    EXPECT_FALSE(proven({left, apart})) << "corners in different places are not shared";
    const PlacedTriangle cornered{glm::dvec3(0.5, 0.5, 1), {3, 0, 1}, {0, 3, 1}};
    EXPECT_FALSE(proven({cornered}));
    EXPECT_FALSE(proven({PlacedTriangle{glm::dvec3(1, 1, 1), {3, 0, 1}, {0, 3, 1}}})) << "outside";
    EXPECT_TRUE(proven({PlacedTriangle{glm::dvec3(-1, -1, 1), {3, 0, 1}, {0, 3, 1}}})) << "inside";

    Coverage coverage;  // an edge of two casters is no shared one: they are drawn on their own
    coverage.reset({1, 1});
    coverage.add(0, left, 0.01);
    coverage.add(1, right, 0.01);
    coverage.join();
    EXPECT_EQ(coverage.depth({0, 0}), kFarOff);
}

TEST(Coverage, ATriangleSeenEdgeOnGrantsNothing) {
    const PlacedTriangle wall{glm::dvec3(0, 0.5, 1), {4, 0.5, 2}, {2, 0.5, 3}};
    EXPECT_EQ(provenAt({wall, wall}, 0.01), kFarOff);
    EXPECT_TRUE(std::isinf(culling::depthSlope(wall)));
}

TEST(Coverage, IsNearerWhereEveryTexelIs) {
    Coverage coverage;
    coverage.reset({8, 8});
    coverage.add(3, {glm::dvec3(-1, -1, 2), {30, -1, 2}, {-1, 30, 2}}, kSnapTexels);
    coverage.add(7, {glm::dvec3(3.1, 3.1, 1), {5.9, 3.1, 1}, {3.1, 5.9, 1}}, kSnapTexels);
    coverage.join();
    EXPECT_TRUE(coverage.nearer({0, 0}, {7, 7}, 2.5));
    EXPECT_FALSE(coverage.nearer({0, 0}, {7, 7}, 2)) << "as near is not nearer";
    EXPECT_TRUE(coverage.nearer({3, 3}, {4, 3}, 2));
    EXPECT_FALSE(coverage.nearer({3, 3}, {5, 3}, 2)) << "near its edge";
    EXPECT_EQ(coverage.caster({3, 3}), 7u);
    EXPECT_EQ(coverage.caster({7, 0}), 3u);
}

TEST(Coverage, FarAwayCornersReachNoInt) {
    // 1e12 texels wide: the rounding of the edges' terms grows with it, to 1e-4 texels here.
    const PlacedTriangle vast{glm::dvec3(-1e12, -1e12, 4), {1e12, -1e12, 4}, {0, 1e12, 4}};
    EXPECT_NEAR(provenAt({vast}, 0.01), 4, 1e-6);
    const PlacedTriangle gone{glm::dvec3(1e12, 1e12, 4), {2e12, 1e12, 4}, {1e12, 2e12, 4}};
    EXPECT_EQ(provenAt({gone}, 0.01), kFarOff);
}

}  // namespace
