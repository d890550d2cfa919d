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

TEST(Coverage, NeighboursMeetAtEqualPositionsAcrossClusters) {
    world::MeshLevel level;  // a quad of two triangles, corners stored twice, a cluster each
    level.positions = {{0, 0, 0}, {1, 0, 0}, {0, 0, 1}, {1, 0, 0}, {1, 0, 1}, {0, 0, 1}};
    level.indices = {0, 1, 2, 3, 4, 5};
    level.clusters = {{0, 3, {0, 0, 0}, {1, 0, 1}}, {3, 3, {0, 0, 0}, {1, 0, 1}}};
    const auto found = [&](uint32_t triangle, int edge) {
        std::vector<uint32_t> others;
        culling::acrossEdge(level, triangle, edge, [&](uint32_t other) {
            others.push_back(other);
            return false;
        });
        return others;
    };
    EXPECT_EQ(found(0, 1), std::vector<uint32_t>{1});
    EXPECT_EQ(found(1, 2), std::vector<uint32_t>{0});
    for (const auto& [triangle, edge] : {std::pair(0u, 0), {0u, 2}, {1u, 0}, {1u, 1}})
        EXPECT_TRUE(found(triangle, edge).empty());
}

}  // namespace
