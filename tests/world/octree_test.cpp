#include "world/octree.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <random>

namespace {

using namespace world;

constexpr double kInf = std::numeric_limits<double>::infinity();

/// The answer without a tree.
std::vector<uint32_t> bruteForce(const std::map<uint32_t, Box>& boxes, const TurnedBox& query) {
    std::vector<uint32_t> found;
    for (const auto& [item, box] : boxes)
        if (query.mayTouch(box)) found.push_back(item);
    return found;
}

glm::dvec3 randomPoint(std::mt19937& rng, glm::dvec3 centre, double reach) {
    std::uniform_real_distribution<double> d(-reach, reach);
    const double x = d(rng), y = d(rng), z = d(rng);
    return centre + glm::dvec3(x, y, z);
}

/// Sizes from points to many times the tree.
Box randomBox(std::mt19937& rng, glm::dvec3 centre, double reach) {
    const glm::dvec3 p = randomPoint(rng, centre, reach);
    const double scale = std::exp2(static_cast<double>(rng() % 16) - 8) * (rng() % 50 == 0 ? 100 : 1);
    const glm::dvec3 half =
        rng() % 10 == 0 ? glm::dvec3(0) : glm::abs(randomPoint(rng, glm::dvec3(0), scale));
    return {p - half, p + half};
}

TurnedBox randomQuery(std::mt19937& rng, glm::dvec3 centre, double reach) {
    TurnedBox q;
    const glm::dvec3 a = glm::normalize(randomPoint(rng, glm::dvec3(0), 1));
    const glm::dvec3 b = glm::normalize(glm::cross(a, glm::dvec3(0.3, 0.5, -0.8)));
    if (rng() % 4 != 0) q.axis = {a, b, glm::cross(a, b)};
    const glm::dvec3 p = randomPoint(rng, centre, reach);
    for (int k = 0; k < 3; ++k) {
        const double at = glm::dot(q.axis[static_cast<size_t>(k)], p);
        const double half = std::abs(randomPoint(rng, glm::dvec3(0), reach).x);
        q.lo[k] = rng() % 8 == 0 ? -kInf : at - half;
        q.hi[k] = rng() % 8 == 0 ? kInf : at + half;
    }
    return q;
}

void movesLikeBruteForce(glm::dvec3 centre, uint32_t seed) {
    std::mt19937 rng(seed);
    Octree tree({centre - 100.0, centre + 100.0}, 2);
    std::map<uint32_t, Box> boxes;
    std::vector<uint32_t> found;
    for (int step = 0; step < 6000; ++step) {
        const uint32_t item = rng() % 400;
        const double reach = rng() % 20 == 0 ? 1000 : 110;  // some far outside
        const auto at = boxes.find(item);
        if (at == boxes.end()) {
            const Box box = randomBox(rng, centre, reach);
            tree.insert(item, box);
            boxes[item] = box;
        } else if (rng() % 3 == 0) {
            tree.remove(item);
            boxes.erase(at);
        } else {
            const glm::dvec3 nudge = randomPoint(rng, glm::dvec3(0), 1);
            const Box box = rng() % 2 ? randomBox(rng, centre, reach)
                                      : Box{at->second.min + nudge, at->second.max + nudge};
            if (box.empty()) continue;
            tree.move(item, box);
            at->second = box;
        }
        ASSERT_EQ(tree.size(), boxes.size());
        if (step % 10 != 0) continue;
        if (step % 100 == 0) tree.validate();
        const TurnedBox query = randomQuery(rng, centre, 150);
        found.assign(1, 77);  // what is there already stays
        tree.query(query, found);
        ASSERT_EQ(found[0], 77u);
        found.erase(found.begin());
        ASSERT_EQ(found, bruteForce(boxes, query)) << "step " << step;
    }
    while (!boxes.empty()) {
        tree.remove(boxes.begin()->first);
        boxes.erase(boxes.begin());
    }
    tree.validate();
    found.clear();
    tree.query({}, found);
    EXPECT_TRUE(found.empty());
}

TEST(Octree, MovesLikeBruteForce) { movesLikeBruteForce(glm::dvec3(0), 3); }
TEST(Octree, MovesLikeBruteForceFarFromTheOrigin) { movesLikeBruteForce({1e6, -3e5, 6.1e6}, 4); }
TEST(Octree, MovesLikeBruteForceAtOddCoordinates) { movesLikeBruteForce({1e6 + 0.1, 1.0 / 3, -1e5 / 7}, 5); }

// Boxes that fill the loose bounds of their cells, under queries that just touch a corner: there the test
// of a cell and that of its item differ by rounding alone, and the cell's must never be the stricter one.
TEST(Octree, AgreesAtTheEdgesOfItsCells) {
    for (const glm::dvec3 centre : {glm::dvec3(0), glm::dvec3(1e6, -3e5, 6.1e6)}) {
        std::mt19937 rng(9);
        std::map<uint32_t, Box> boxes;
        Octree tree({centre - 100.0, centre + 100.0}, 2);
        for (uint32_t item = 0; item < 600; ++item) {
            const double half = std::exp2(rng() % 5);
            const auto odd = [&] { return (2.0 * (rng() % 16) - 15) * half; };
            const double x = odd(), y = odd(), z = odd();
            const glm::dvec3 p = glm::round(centre / 0.125) * 0.125 + glm::dvec3(x, y, z);
            tree.insert(item, boxes[item] = {p - 2 * half, p + 2 * half});
        }
        tree.validate();
        for (int step = 0; step < 20000; ++step) {
            const Box& box = boxes[rng() % 600];
            TurnedBox query = randomQuery(rng, centre, 150);
            const size_t k = rng() % 3;
            // Just where the box's own test turns: along the axis, the far or the near corner.
            const double at = glm::dot(query.axis[k], box.centre()),
                         reach = glm::dot(glm::abs(query.axis[k]), box.extent() * 0.5);
            if (rng() % 2) {
                query.lo[static_cast<int>(k)] = at + reach;
                query.hi[static_cast<int>(k)] = kInf;
            } else {
                query.lo[static_cast<int>(k)] = -kInf;
                query.hi[static_cast<int>(k)] = at - reach;
            }
            for (size_t j = 0; j < 3; ++j) {
                if (j == k) continue;
                query.lo[static_cast<int>(j)] = -kInf;
                query.hi[static_cast<int>(j)] = kInf;
            }
            std::vector<uint32_t> found;
            tree.query(query, found);
            ASSERT_EQ(found, bruteForce(boxes, query)) << "step " << step;
        }
    }
}

TEST(Octree, EmptyAndOne) {
    Octree tree({glm::dvec3(0), glm::dvec3(10)}, 1);
    std::vector<uint32_t> found;
    tree.query({}, found);
    EXPECT_TRUE(found.empty());
    EXPECT_EQ(tree.size(), 0u);
    tree.validate();
    tree.insert(1000000, {glm::dvec3(3), glm::dvec3(3)});  // a point
    TurnedBox touching;
    touching.lo = touching.hi = glm::dvec3(3);
    tree.query(touching, found);
    EXPECT_EQ(found, std::vector<uint32_t>{1000000});
    tree.validate();
}

TEST(Octree, TakesDegenerateBounds) {
    for (const Box& bounds :
         {Box{}, Box{glm::dvec3(5), glm::dvec3(5)}, Box{glm::dvec3(-kInf), glm::dvec3(kInf)}}) {
        Octree tree(bounds, 0.1);
        std::map<uint32_t, Box> boxes;
        std::mt19937 rng(6);
        for (uint32_t item = 0; item < 50; ++item)
            tree.insert(item, boxes[item] = randomBox(rng, glm::dvec3(5), 20));
        const Box everything{glm::dvec3(-kInf), glm::dvec3(kInf)};
        tree.insert(50, boxes[50] = everything);
        tree.validate();
        for (int step = 0; step < 50; ++step) {
            const TurnedBox query = randomQuery(rng, glm::dvec3(5), 20);
            std::vector<uint32_t> found;
            tree.query(query, found);
            ASSERT_EQ(found, bruteForce(boxes, query)) << "step " << step;
        }
    }
}

// A point of the box that satisfies the query's inequalities, as plain arithmetic sees them, proves that
// the answer must be yes, at any distance from the origin.
TEST(TurnedBox, NeverMissesAPointInside) {
    std::mt19937 rng(8);
    int inside = 0;
    for (int step = 0; step < 200000; ++step) {
        const glm::dvec3 centre = step % 2 ? glm::dvec3(0) : glm::dvec3(1e6, 1e3, -6.1e6);
        const Box box = randomBox(rng, centre, 10);
        TurnedBox query = randomQuery(rng, centre, 10);
        const glm::dvec3 corner(rng() % 2 ? box.min.x : box.max.x, rng() % 2 ? box.min.y : box.max.y,
                                rng() % 2 ? box.min.z : box.max.z);
        if (rng() % 2) {  // the query just touches a corner
            for (size_t k = 0; k < 3; ++k)
                (rng() % 2 ? query.lo : query.hi)[static_cast<int>(k)] = glm::dot(query.axis[k], corner);
        }
        bool holds = true;
        for (size_t k = 0; k < 3; ++k) {
            const double at = glm::dot(query.axis[k], corner);
            holds = holds && at >= query.lo[static_cast<int>(k)] && at <= query.hi[static_cast<int>(k)];
        }
        if (!holds) continue;
        ++inside;
        ASSERT_TRUE(query.mayTouch(box)) << "step " << step;
    }
    EXPECT_GT(inside, 1000);
}

TEST(TurnedBox, RefusesWhatIsApart) {
    TurnedBox query;
    query.lo = glm::dvec3(0);
    query.hi = glm::dvec3(1);
    EXPECT_FALSE(query.mayTouch({glm::dvec3(1.001, 0, 0), glm::dvec3(2, 1, 1)}));
    EXPECT_FALSE(query.mayTouch(Box{}));
    EXPECT_TRUE(query.mayTouch({glm::dvec3(1, 1, 1), glm::dvec3(2, 2, 2)}));
}

TEST(Octree, ForgetsWhatItEmptied) {
    // A mover that crosses the world leaves no trail of cells: its cells are used again.
    Octree tree({glm::dvec3(-1000), glm::dvec3(1000)}, 1);
    tree.insert(0, {glm::dvec3(0), glm::dvec3(0.5)});
    for (int step = 0; step < 200000; ++step) {
        const glm::dvec3 at(step % 2000 - 1000, step % 1999 - 1000, step % 1987 - 1000);
        tree.move(0, {at, at + 0.5});
    }
    tree.validate();
    std::vector<uint32_t> found;
    tree.query({}, found);
    EXPECT_EQ(found, std::vector<uint32_t>{0});
}

}  // namespace
