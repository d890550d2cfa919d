// The proof of coverage: never grants a texel that a rasteriser could leave open or draw deeper.
#include "culling/coverage.h"

#include <gtest/gtest.h>

#include <random>

namespace {

using culling::PlacedTriangle;

const auto kNoOther = [](int) { return std::optional<PlacedTriangle>(); };

TEST(Coverage, AGrantedTexelStaysInsideWhenCornersSnap) {
    std::mt19937 rng(2);
    std::uniform_real_distribution<double> place(-3, 3), depth(0, 50), nudge(-1.0 / 512, 1.0 / 512);
    int granted = 0;
    for (int step = 0; step < 200000; ++step) {
        PlacedTriangle t;
        for (auto& corner : t) corner = {place(rng), place(rng), depth(rng)};
        const glm::dvec2 p(0.5, 0.5);
        const auto bound = culling::coveredDepth(t, p, culling::kSnapTexels, kNoOther);
        if (!bound) continue;
        ++granted;
        for (int trial = 0; trial < 4; ++trial) {
            PlacedTriangle snapped = t;
            for (auto& corner : snapped) {
                corner.x += nudge(rng);
                corner.y += nudge(rng);
            }
            for (int e = 0; e < 3; ++e) ASSERT_GT(culling::edgeDistance(snapped, e, p), 0) << "step " << step;
            // The same plane through moved corners: as deep as the bound at most.
            ASSERT_LE(culling::depthBound(snapped, p, 0), *bound + 1e-9) << "step " << step;
        }
    }
    EXPECT_GT(granted, 1000);
}

TEST(Coverage, ASharedEdgeCoversAndAFoldOrAGapDoesNot) {
    const PlacedTriangle left{glm::dvec3(0, 0, 5), {4, 0, 5}, {0, 4, 5}};
    const glm::dvec2 onEdge(2, 2);
    const PlacedTriangle right{glm::dvec3(4, 0, 5), {4, 4, 7}, {0, 4, 5}};
    const auto both = culling::coveredDepth(left, onEdge, 0.01, [&](int e) {
        return e == 1 ? std::optional(right) : std::nullopt;
    });
    ASSERT_TRUE(both);
    EXPECT_GE(*both, 5);
    EXPECT_FALSE(culling::coveredDepth(left, onEdge, 0.01, kNoOther));
    const PlacedTriangle folded{glm::dvec3(4, 0, 5), {1, 0, 7}, {0, 4, 5}};
    EXPECT_FALSE(culling::coveredDepth(left, onEdge, 0.01, [&](int) { return std::optional(folded); }));
    EXPECT_FALSE(culling::coveredDepth(left, glm::dvec2(0, 0), 0.01, [&](int) { return std::optional(right); }))
        << "a corner";
    EXPECT_FALSE(culling::coveredDepth(left, glm::dvec2(3, 3), 0.01, kNoOther)) << "outside";
    EXPECT_TRUE(culling::coveredDepth(left, glm::dvec2(1, 1), 0.01, kNoOther)) << "inside";
}

TEST(Coverage, ATriangleSeenEdgeOnGrantsNothing) {
    const PlacedTriangle wall{glm::dvec3(0, 0, 1), {4, 0, 2}, {2, 0, 3}};
    EXPECT_FALSE(culling::coveredDepth(wall, {2, 0}, 0.01, kNoOther));
    EXPECT_TRUE(std::isinf(culling::depthSlope(wall)));
}

TEST(Coverage, NeighboursMeetAtEqualPositions) {
    world::MeshLevel level;  // two triangles of a quad, corners stored twice; a third touches the same edge later
    level.positions = {{0, 0, 0}, {1, 0, 0}, {0, 0, 1}, {1, 0, 0}, {1, 0, 1}, {0, 0, 1}};
    level.indices = {0, 1, 2, 3, 4, 5};
    const auto n = culling::neighbours(level);
    EXPECT_EQ(n, (std::vector<uint32_t>{culling::kNoNeighbour, 1, culling::kNoNeighbour, culling::kNoNeighbour,
                                        culling::kNoNeighbour, 0}));
    level.positions.push_back({0.5, 1, 0.5});
    for (uint32_t i : {1u, 2u, 6u}) level.indices.push_back(i);  // three at one edge: nobody's neighbour
    for (uint32_t other : culling::neighbours(level)) EXPECT_EQ(other, culling::kNoNeighbour);
}

}  // namespace
