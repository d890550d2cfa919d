// tests/world/clusters_test.cpp — clusters hold the level's triangles, each once, within their bounds.

#include "world/clusters.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <random>

namespace world {
namespace {

using Triangle = std::array<float, 9>;  // corners in their order

Triangle triangleAt(const MeshLevel& level, size_t first) {
    Triangle triangle{};
    for (size_t k = 0; k < 3; ++k)
        for (int axis = 0; axis < 3; ++axis)
            triangle[k * 3 + static_cast<size_t>(axis)] = level.positions[level.indices[first + k]][axis];
    return triangle;
}

std::vector<Triangle> sortedTriangles(const MeshLevel& level) {
    std::vector<Triangle> triangles;
    for (size_t i = 0; i < level.indices.size(); i += 3) triangles.push_back(triangleAt(level, i));
    std::sort(triangles.begin(), triangles.end());
    return triangles;
}

/// Every promise of world/mesh.h on a clustered level.
void expectSound(const MeshLevel& level) {
    uint32_t next = 0;
    for (size_t c = 0; c < level.clusters.size(); ++c) {
        const Cluster& cluster = level.clusters[c];
        ASSERT_EQ(cluster.firstIndex, next) << "cluster " << c;
        ASSERT_EQ(cluster.indexCount % 3, 0u) << "cluster " << c;
        ASSERT_GE(cluster.indexCount, 3u) << "cluster " << c;
        ASSERT_LE(cluster.indexCount, 3 * kClusterTriangles) << "cluster " << c;
        next += cluster.indexCount;
        glm::vec3 min(std::numeric_limits<float>::infinity()), max(-min);
        for (uint32_t i = cluster.firstIndex; i < next; ++i) {
            ASSERT_LT(level.indices[i], level.positions.size()) << "index " << i;
            min = glm::min(min, level.positions[level.indices[i]]);
            max = glm::max(max, level.positions[level.indices[i]]);
        }
        ASSERT_EQ(cluster.min, min) << "cluster " << c;
        ASSERT_EQ(cluster.max, max) << "cluster " << c;
    }
    ASSERT_EQ(next, level.indices.size());
    uint32_t seen = 0;  // vertices are numbered by first use, and each is used
    for (const uint32_t index : level.indices) {
        ASSERT_LE(index, seen);
        seen += index == seen;
    }
    ASSERT_EQ(seen, level.positions.size());
}

MeshLevel randomLevel(std::mt19937& rng, size_t triangles, double reach, glm::vec3 centre) {
    std::uniform_real_distribution<double> place(-reach, reach), size(-1, 1);
    MeshLevel level;
    level.positions.push_back(centre + glm::vec3(0.5f));  // used by nothing
    for (size_t t = 0; t < triangles; ++t) {
        const glm::vec3 at = centre + glm::vec3(place(rng), place(rng), place(rng));
        for (int k = 0; k < 3; ++k) {
            level.indices.push_back(static_cast<uint32_t>(level.positions.size()));
            level.positions.push_back(at + glm::vec3(size(rng), size(rng), size(rng)));
        }
    }
    return level;
}

/// A square of side x side cells [m], two triangles each.
MeshLevel gridLevel(uint32_t side) {
    MeshLevel level;
    for (uint32_t z = 0; z <= side; ++z)
        for (uint32_t x = 0; x <= side; ++x) level.positions.emplace_back(x, 0, z);
    for (uint32_t z = 0; z < side; ++z) {
        for (uint32_t x = 0; x < side; ++x) {
            const uint32_t a = z * (side + 1) + x, b = a + side + 1;
            level.indices.insert(level.indices.end(), {a, b, a + 1, a + 1, b, b + 1});
        }
    }
    return level;
}

TEST(Clusters, KeepEveryTriangleOnce) {
    std::mt19937 rng(11);
    for (const size_t count : {1u, 2u, 127u, 128u, 129u, 255u, 256u, 257u, 1000u, 5000u}) {
        for (const float far : {0.0f, 1e6f}) {  // 1000 km: centroids there are 1/8 m apart at best
            SCOPED_TRACE(testing::Message() << count << " triangles at " << far);
            MeshLevel level = randomLevel(rng, count, 100, glm::vec3(far, 0, -far));
            // Far out a random triangle may round to no area; the dumb filter says which.
            std::vector<Triangle> expected;
            for (size_t i = 0; i < level.indices.size(); i += 3) {
                const glm::dvec3 a(level.positions[level.indices[i]]),
                    b(level.positions[level.indices[i + 1]]), c(level.positions[level.indices[i + 2]]);
                if (glm::cross(b - a, c - a) != glm::dvec3(0)) expected.push_back(triangleAt(level, i));
            }
            std::sort(expected.begin(), expected.end());
            buildClusters(level);
            expectSound(level);
            EXPECT_EQ(sortedTriangles(level), expected);
            EXPECT_EQ(level.clusters.size(), (expected.size() + kClusterTriangles - 1) / kClusterTriangles);
        }
    }
}

TEST(Clusters, DropWhatHasNoArea) {
    MeshLevel level;
    level.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {2, 0, 0}, {0, 0, 0}, {1e-30f, 0, 0}, {0, 1e-30f, 0}};
    level.indices = {
        0, 0, 1,  // repeats an index
        0, 1, 1,  //
        1, 2, 1,  //
        0, 1, 3,  // on one line
        0, 4, 2,  // two corners at one place
        0, 5, 6,  // tiny, and kept: its area underflows in float only
        0, 1, 2,
    };
    buildClusters(level);
    expectSound(level);
    ASSERT_EQ(level.indices.size(), 6u);
    EXPECT_EQ(level.positions[level.indices[1]], glm::vec3(1e-30f, 0, 0));
    EXPECT_EQ(level.positions.size(), 5u);
}

TEST(Clusters, TakeNothingAndNothingLeft) {
    MeshLevel empty;
    buildClusters(empty);
    EXPECT_TRUE(empty.clusters.empty());

    MeshLevel unused;
    unused.positions = {{0, 0, 0}, {1, 0, 0}};
    unused.indices = {0, 1, 0};
    unused.clusters.resize(3);  // left over from elsewhere
    buildClusters(unused);
    EXPECT_TRUE(unused.clusters.empty());
    EXPECT_TRUE(unused.indices.empty());
    EXPECT_TRUE(unused.positions.empty());
}

TEST(Clusters, AreCompact) {
    MeshLevel level = gridLevel(256);
    buildClusters(level);
    expectSound(level);
    ASSERT_EQ(level.clusters.size(), 1024u);
    double area = 0;
    for (const Cluster& cluster : level.clusters)
        area += double(cluster.max.x - cluster.min.x) * double(cluster.max.z - cluster.min.z);
    // Equal halves of a square all the way down are 8 x 8 cells each, the area of the square in all. A cut
    // that cannot follow the cells adds a border; twice the area would mean clusters that interleave.
    EXPECT_LT(area, 2.0 * 256 * 256);
}

TEST(Clusters, AreTheSameTwiceAndOnceMore) {
    std::mt19937 rng(3);
    MeshLevel once = randomLevel(rng, 3000, 4, glm::vec3(0));
    // Equal centroids everywhere: only the tie-break orders them.
    for (glm::vec3& p : once.positions) p = glm::round(p);
    MeshLevel twice = once;
    buildClusters(once);
    buildClusters(twice);
    expectSound(once);
    EXPECT_EQ(once.indices, twice.indices);
    EXPECT_EQ(once.positions, twice.positions);
    const std::vector<Triangle> triangles = sortedTriangles(once);
    buildClusters(twice);
    EXPECT_EQ(sortedTriangles(twice), triangles);
}

TEST(Clusters, SurviveTheLargestFloats) {
    constexpr float kMax = std::numeric_limits<float>::max();
    std::mt19937 rng(5);
    std::uniform_real_distribution<float> unit(-1, 1);
    MeshLevel level;
    for (uint32_t i = 0; i < 3000; ++i) {
        level.positions.emplace_back(unit(rng) * kMax, unit(rng) * kMax, unit(rng) * kMax);
        level.indices.push_back(i);
    }
    const std::vector<Triangle> triangles = sortedTriangles(level);
    buildClusters(level);
    expectSound(level);
    EXPECT_EQ(sortedTriangles(level), triangles);
}

TEST(Clusters, TakeMillionsOfTriangles) {
    MeshLevel level = gridLevel(1600);  // 5,120,000 triangles
    buildClusters(level);
    expectSound(level);
    EXPECT_EQ(level.indices.size(), 3u * 2 * 1600 * 1600);
}

}  // namespace
}  // namespace world
