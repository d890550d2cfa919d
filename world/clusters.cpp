// world/clusters.cpp — median splits over triangle centroids until a run fits one cluster.
// Source: the object-median build of bounding volume hierarchies, as in Pharr, Jakob and Humphreys,
// "Physically Based Rendering", 3rd ed., 2016, section 4.3.

#include "world/clusters.h"

#include <algorithm>
#include <limits>
#include <span>

#include "world/check.h"

namespace world {
namespace {

/// A triangle as the splits see it.
struct Item {
    glm::vec3 centroid;  ///< three times the centroid: only the order matters
    uint32_t triangle;   ///< of the level as it came in
};

int longestAxis(std::span<const Item> items) {
    glm::vec3 min(std::numeric_limits<float>::infinity()), max(-min);
    for (const Item& item : items) {
        min = glm::min(min, item.centroid);
        max = glm::max(max, item.centroid);
    }
    const glm::vec3 extent = max - min;
    if (extent.x >= extent.y && extent.x >= extent.z) return 0;
    return extent.y >= extent.z ? 1 : 2;
}

/// Cuts `items` into runs of at most kClusterTriangles and appends the length of each. The left part
/// takes whole clusters, so all but the last of a level are full. Ties fall to the lower triangle: which
/// items go left is then a matter of the data alone, not of how the library partitions.
void split(std::span<Item> items, std::vector<uint32_t>& runs) {
    if (items.size() <= kClusterTriangles) {
        runs.push_back(static_cast<uint32_t>(items.size()));
        return;
    }
    const int axis = longestAxis(items);
    const size_t clusters = (items.size() + kClusterTriangles - 1) / kClusterTriangles;
    const size_t left = clusters / 2 * kClusterTriangles;
    std::nth_element(items.begin(), items.begin() + static_cast<std::ptrdiff_t>(left), items.end(),
                     [axis](const Item& a, const Item& b) {
                         if (a.centroid[axis] != b.centroid[axis]) return a.centroid[axis] < b.centroid[axis];
                         return a.triangle < b.triangle;
                     });
    split(items.first(left), runs);
    split(items.subspan(left), runs);
}

}  // namespace

bool hasArea(const glm::vec3& a, const glm::vec3& b, const glm::vec3& c) {
    // In doubles: the products of float edges underflow, or round to equal, and would drop thin
    // triangles that do cast.
    return glm::cross(glm::dvec3(b) - glm::dvec3(a), glm::dvec3(c) - glm::dvec3(a)) != glm::dvec3(0);
}

void buildClusters(MeshLevel& level) {
    CHECK(level.indices.size() % 3 == 0);
    CHECK(level.indices.size() <= std::numeric_limits<uint32_t>::max());
    const auto corner = [&level](uint32_t triangle, uint32_t k) { return level.indices[triangle * 3 + k]; };

    std::vector<Item> items;
    items.reserve(level.indices.size() / 3);
    for (uint32_t t = 0; t < level.indices.size() / 3; ++t) {
        const uint32_t i = corner(t, 0), j = corner(t, 1), k = corner(t, 2);
        CHECK(std::max({i, j, k}) < level.positions.size());
        const glm::vec3 &a = level.positions[i], &b = level.positions[j], &c = level.positions[k];
        if (hasArea(a, b, c)) items.push_back({a + b + c, t});
    }

    std::vector<uint32_t> runs;
    if (!items.empty()) split(items, runs);

    constexpr uint32_t kUnused = std::numeric_limits<uint32_t>::max();
    std::vector<uint32_t> moved(level.positions.size(), kUnused);
    std::vector<glm::vec3> positions;
    std::vector<uint32_t> indices;
    indices.reserve(items.size() * 3);
    level.clusters.clear();
    level.clusters.reserve(runs.size());
    std::span<Item> rest(items);
    for (const uint32_t run : runs) {
        // Within a cluster the triangles keep the order of the source.
        std::sort(rest.begin(), rest.begin() + run,
                  [](const Item& a, const Item& b) { return a.triangle < b.triangle; });
        Cluster cluster;
        cluster.firstIndex = static_cast<uint32_t>(indices.size());
        cluster.indexCount = run * 3;
        cluster.min = cluster.max = level.positions[corner(rest[0].triangle, 0)];
        for (const Item& item : rest.first(run)) {
            for (uint32_t k = 0; k < 3; ++k) {
                const uint32_t old = corner(item.triangle, k);
                if (moved[old] == kUnused) {
                    moved[old] = static_cast<uint32_t>(positions.size());
                    positions.push_back(level.positions[old]);
                }
                indices.push_back(moved[old]);
                cluster.min = glm::min(cluster.min, level.positions[old]);
                cluster.max = glm::max(cluster.max, level.positions[old]);
            }
        }
        level.clusters.push_back(cluster);
        rest = rest.subspan(run);
    }
    level.positions = std::move(positions);
    level.indices = std::move(indices);
}

}  // namespace world
