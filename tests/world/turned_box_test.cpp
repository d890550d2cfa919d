// Which boxes a turned box may touch, against its own inequalities, and eight at a time against one by one.
#include "world/turned_box.h"

#include <gtest/gtest.h>

#include <random>

#include "random_boxes.h"

namespace {

using namespace world;
using namespace world_tests;

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

/// Eight at a time against one by one: nothing is missed, and what is found besides is a hair away.
void lanesAgree(glm::dvec3 origin, uint32_t seed) {
    std::mt19937 rng(seed);
    uint32_t touched = 0, apart = 0, within = 0;
    for (int step = 0; step < 40000; ++step) {
        const double reach = std::exp2(static_cast<double>(rng() % 14));
        std::array<Box, BoxLanes::kLanes> boxes;
        BoxLanes lanes, copied;
        for (uint32_t k = 0; k < BoxLanes::kLanes; ++k) {
            boxes[k] = randomBox(rng, origin, reach);
            lanes.set(k, boxes[k], origin);
            copied.copy(k, lanes, k);
        }
        TurnedBox query = randomQuery(rng, origin, reach);
        if (rng() % 2) {  // ends where the test of one box turns
            const size_t k = rng() % 3;
            const Box& box = boxes[rng() % BoxLanes::kLanes];
            const double at = glm::dot(query.axis[k], box.centre()),
                         half = glm::dot(glm::abs(query.axis[k]), box.extent() * 0.5);
            (rng() % 2 ? query.lo[static_cast<int>(k)] : query.hi[static_cast<int>(k)]) = rng() % 2 ? at - half : at + half;
        }
        const LaneQuery many(query, origin);
        const uint32_t touches = many.touched(lanes), inside = many.within(lanes);
        ASSERT_EQ(many.touched(copied), touches);
        for (uint32_t k = 0; k < BoxLanes::kLanes; ++k) {
            const bool hit = touches >> k & 1;
            ASSERT_TRUE(hit || !query.mayTouch(boxes[k])) << "step " << step;
            ASSERT_TRUE(!hit || query.mayTouch(roomy(boxes[k], origin))) << "step " << step;
            ++(hit ? touched : apart);
            if ((inside >> k & 1) == 0) continue;
            ++within;
            for (int point = 0; point < 4; ++point) {  // of all boxes in it, corners are the hardest to touch
                const auto end = [&](int axis) { return rng() % 2 ? boxes[k].min[axis] : boxes[k].max[axis]; };
                const double x = end(0), y = end(1), z = end(2);
                ASSERT_TRUE(query.mayTouch({{x, y, z}, {x, y, z}})) << "step " << step;
            }
        }
    }
    EXPECT_GT(touched, 10000u);
    EXPECT_GT(apart, 10000u);
    EXPECT_GT(within, 1000u);
}

TEST(BoxLanes, AgreeWithOneBoxAtATime) { lanesAgree(glm::dvec3(0), 21); }
TEST(BoxLanes, AgreeFarFromTheOrigin) { lanesAgree({1e6, -3e5, 6.1e6}, 22); }

TEST(BoxLanes, TakeBoxesWithoutEnd) {
    BoxLanes lanes;
    lanes.set(0, {glm::dvec3(-kInf), glm::dvec3(kInf)}, glm::dvec3(0));
    lanes.set(1, {glm::dvec3(-1e300), glm::dvec3(1e300)}, glm::dvec3(0));
    lanes.set(2, {{0, 0, 0}, {kInf, 1, 1}}, glm::dvec3(0));
    std::mt19937 rng(23);
    for (int step = 0; step < 100; ++step) {
        const TurnedBox query = randomQuery(rng, glm::dvec3(0.5), 1);
        EXPECT_EQ(LaneQuery(query, glm::dvec3(0)).touched(lanes) & 3, 3u);
    }
    EXPECT_EQ(LaneQuery(TurnedBox(), glm::dvec3(0)).touched(lanes) & 7, 7u);
}

}  // namespace
