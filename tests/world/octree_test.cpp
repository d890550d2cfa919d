#include "world/octree.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <random>

#include "random_boxes.h"

namespace {

using namespace world;
using namespace world_tests;

/// Against the answer without a tree: nothing is missed, and what is found besides is a hair away.
///   centre  of the tree
::testing::AssertionResult isRight(const std::vector<uint32_t>& found, const std::map<uint32_t, Box>& boxes,
                                   const TurnedBox& query, glm::dvec3 centre) {
    size_t at = 0;
    for (const auto& [item, box] : boxes) {
        const bool held = at < found.size() && found[at] == item;
        at += held;
        if (query.mayTouch(box) && !held) return ::testing::AssertionFailure() << "item " << item << " is missed";
        // The tree's cells count from a point of a grid near its centre.
        if (held && !query.mayTouch(roomy(box, centre - 1.0)) && !query.mayTouch(roomy(box, centre + 1.0)))
            return ::testing::AssertionFailure() << "item " << item << " is far off";
    }
    if (at != found.size()) return ::testing::AssertionFailure() << "not ascending, or found twice";
    return ::testing::AssertionSuccess();
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
            tree.remove(item);
            tree.insert(item, box);
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
        ASSERT_TRUE(isRight(found, boxes, query, centre)) << "step " << step;
        // The same by a test of boxes: those that reach beyond a plane.
        const double plane = query.hi.x;
        found.assign(1, 77);
        tree.accepted([plane](const Box& box) { return box.max.x >= plane; }, found);
        std::vector<uint32_t> beyond{77};
        for (const auto& [number, box] : boxes)
            if (box.max.x >= plane) beyond.push_back(number);
        ASSERT_EQ(found, beyond) << "step " << step;
        ASSERT_EQ(tree.any([plane](const Box& box) { return box.max.x >= plane; }), beyond.size() > 1);
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
            ASSERT_TRUE(isRight(found, boxes, query, centre)) << "step " << step;
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
            ASSERT_TRUE(isRight(found, boxes, query, bounds.empty() ? glm::dvec3(0) : glm::dvec3(5))) << "step " << step;
        }
    }
}

// Thousands at one spot and a few around them, which bound the cell: emptied in any order, it stays right.
TEST(Octree, EmptiesACrowdedCell) {
    std::mt19937 rng(10);
    Octree tree({glm::dvec3(-64), glm::dvec3(64)}, 8);
    std::map<uint32_t, Box> boxes;
    for (uint32_t item = 0; item < 3000; ++item) {
        const glm::dvec3 p = item % 100 == 0 ? randomPoint(rng, glm::dvec3(1), 3) : glm::dvec3(1, 2, 3);
        tree.insert(item, boxes[item] = {p, p + 0.5});
    }
    std::vector<uint32_t> order(3000), found;
    for (uint32_t item = 0; item < 3000; ++item) order[item] = item;
    std::shuffle(order.begin(), order.end(), rng);
    for (const uint32_t item : order) {
        tree.remove(item);
        boxes.erase(item);
        if (item % 50 != 0) continue;
        tree.validate();
        const TurnedBox query = randomQuery(rng, glm::dvec3(1), 4);
        found.clear();
        tree.query(query, found);
        ASSERT_TRUE(isRight(found, boxes, query, glm::dvec3(0)));
    }
}

TEST(Octree, ForgetsWhatItEmptied) {
    // A mover that crosses the world leaves no trail of cells: its cells are used again.
    Octree tree({glm::dvec3(-1000), glm::dvec3(1000)}, 1);
    tree.insert(0, {glm::dvec3(0), glm::dvec3(0.5)});
    for (int step = 0; step < 200000; ++step) {
        const glm::dvec3 at(step % 2000 - 1000, step % 1999 - 1000, step % 1987 - 1000);
        tree.remove(0);
        tree.insert(0, {at, at + 0.5});
    }
    tree.validate();
    std::vector<uint32_t> found;
    tree.query({}, found);
    EXPECT_EQ(found, std::vector<uint32_t>{0});
}

}  // namespace
