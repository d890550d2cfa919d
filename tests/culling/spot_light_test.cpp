// What touches a light's map, against points sampled in it; levels of detail; numbers that cannot work.
#include "culling/spot_light.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "tests/toy_scene.h"

namespace {

using culling::makeSpotSpace;
using culling::SpotLight;
using culling::SpotSpace;

class Dice {
public:
    explicit Dice(uint32_t seed) : rng_(seed) {}
    double uniform(double a, double b) { return a + (b - a) * double(rng_()) / 4294967295.0; }
    glm::dvec3 within(double reach) { return {uniform(-reach, reach), uniform(-reach, reach), uniform(-reach, reach)}; }
    SpotLight light(glm::dvec3 around) {
        const double range = uniform(2, 50);
        return {around + within(20), within(1), uniform(0.01, 1.45), range * uniform(0.001, 0.5), range, 64};
    }

private:
    std::mt19937 rng_;
};

TEST(SpotLight, AFrameTurnsTheAxisIntoZ) {
    Dice dice(1);
    for (int step = 0; step < 200; ++step) {
        SpotLight light = dice.light(glm::dvec3(0));
        if (step == 0) light.direction = {1, 0, 0};
        if (step == 1) light.direction = {0, -3, 0};
        const SpotSpace space = makeSpotSpace(light).value();
        const glm::dvec3 axis = space.toLight(light.position + glm::normalize(light.direction) * 7.0);
        EXPECT_LT(glm::length(axis - glm::dvec3(0, 0, 7)), 1e-9);
        EXPECT_NEAR(glm::determinant(space.lightFromWorld), 1, 1e-9);
        // The cone's edge meets the middle of the map's edge.
        const double z = 3;
        EXPECT_NEAR(space.onMap({z * std::tan(light.halfAngle), 0, z}).x, light.side, 1e-6);
        EXPECT_NEAR(space.onMap({0, 0, z}).y, light.side / 2.0, 1e-9);
        EXPECT_NEAR(space.texelAt(z) * light.side, 2 * z * std::tan(light.halfAngle), 1e-6);
    }
}

TEST(SpotLight, NoBoxWithAPointOnTheMapIsMissed) {
    Dice dice(2);
    int inside = 0, apart = 0;
    for (int step = 0; step < 20000; ++step) {
        const SpotSpace space = makeSpotSpace(dice.light(glm::dvec3(step % 2 ? 1e6 : 0))).value();
        const glm::dvec3 corner = space.light.position + dice.within(40);
        const world::Box box{corner, corner + glm::abs(dice.within(step % 3 ? 4 : 30))};
        bool point = false;
        for (int k = 0; k < 20 && !point; ++k) {
            glm::dvec3 p;
            for (int axis = 0; axis < 3; ++axis) p[axis] = dice.uniform(box.min[axis], box.max[axis]);
            const glm::dvec3 q = space.toLight(p);
            point = q.z >= space.light.near && q.z <= space.light.range &&
                    std::max(std::abs(q.x), std::abs(q.y)) <= q.z * space.slope;
        }
        const bool touches = space.touches(space.toLight(box));
        inside += point;
        apart += !touches;
        ASSERT_TRUE(touches || !point) << "step " << step;
    }
    EXPECT_GT(inside, 1000);
    EXPECT_GT(apart, 5000) << "it says yes to everything";
}

TEST(SpotLight, BoxesOffTheMapDoNotTouchIt) {
    const SpotSpace space = makeSpotSpace({{0, 10, 0}, {0, -1, 0}, glm::radians(45.0), 0.5, 20, 64}).value();
    const auto touches = [&](glm::dvec3 min, glm::dvec3 max) { return space.touches(space.toLight({min, max})); };
    EXPECT_TRUE(touches({-1, 0, -1}, {1, 1, 1}));
    EXPECT_TRUE(touches({9.9, -0.1, -1}, {12, 0.1, 1}));
    EXPECT_FALSE(touches({10.2, 0, -1}, {12, 1, 1}));
    EXPECT_FALSE(touches({-1, 11, -1}, {1, 12, 1})) << "behind";
    EXPECT_FALSE(touches({-0.1, 9.6, -0.1}, {0.1, 9.9, 0.1})) << "nearer than near";
    EXPECT_FALSE(touches({-1, -12, -1}, {1, -10.5, 1})) << "beyond its range";
    EXPECT_TRUE(touches({-1, 5, -1}, {1, 15, 1})) << "around the light";
    EXPECT_FALSE(space.touches({})) << "empty";
}

TEST(SpotLight, CastersInItAreThoseThatTouch) {
    Dice dice(3);
    tests::ToyScene scene(glm::dvec3(0, -1, 0), {{10, 0.1}});
    const auto box = scene.addMesh(tests::boxMesh({1, 2, 1}));
    std::vector<world::CasterId> all;
    for (int i = 0; i < 500; ++i) all.push_back(scene.addStatic(box, tests::placedAt(dice.within(40), dice.uniform(0.2, 8))));
    size_t found = 0;
    std::vector<world::CasterId> casters{77};
    for (int step = 0; step < 200; ++step) {
        const SpotSpace space = makeSpotSpace(dice.light(glm::dvec3(0))).value();
        std::vector<world::CasterId> expected;
        for (const auto id : all)
            if (space.touches(space.toLight(scene.table[id].bounds))) expected.push_back(id);
        culling::castersIn(space, scene.statics, scene.table, casters);
        ASSERT_EQ(casters, expected) << "step " << step;
        found += casters.size();
    }
    EXPECT_GT(found, 1000u);
}

TEST(SpotLight, ErrorsOfLevelsStayBelowHalfATexelWhereTheyAreNearest) {
    tests::ToyScene scene(glm::dvec3(0, -1, 0), {{10, 0.1}});
    world::Mesh mesh = tests::boxMesh({1, 1, 1});
    for (const float error : {0.01f, 0.04f, 0.3f}) {
        mesh.levels.push_back(mesh.levels[0]);
        mesh.levels.back().error = error;
    }
    const auto slot = scene.addMesh(std::move(mesh));
    // 64 texels over 2 z: a half texel is z / 64.
    const SpotSpace space = makeSpotSpace({{0, 0, 0}, {0, 0, 1}, glm::radians(45.0), 0.1, 100, 64}).value();
    for (const auto& [z, scale, level] : {std::tuple(0.5, 1.0, 0u), std::tuple(1.2, 1.0, 1u), std::tuple(3.2, 1.0, 2u),
                                          std::tuple(21.0, 1.0, 3u), std::tuple(22.0, 4.0, 2u)}) {
        const auto id = scene.addStatic(slot, tests::placedAt({0, 0, z}, scale));
        EXPECT_EQ(culling::spotLevel(space, scene.table, id), level) << "at " << z;
        const double nearest = std::max(z - scale / 2, space.light.near);
        EXPECT_LT(scene.table.meshOf(id).levels[level].error * scale, culling::kSpotLevelError * space.texelAt(nearest));
    }
}

TEST(SpotLight, NumbersThatCannotWorkAreNamed) {
    const SpotLight good{{1, 2, 3}, {0, -1, 0}, 0.5, 0.1, 30, 512};
    ASSERT_TRUE(makeSpotSpace(good));
    const double nan = std::nan(""), inf = INFINITY;
    const auto refused = [&](auto change, const std::string& word) {
        SpotLight light = good;
        change(light);
        const auto made = makeSpotSpace(light);
        ASSERT_FALSE(made) << word;
        EXPECT_EQ(made.error().code, world::ErrorCode::kUsage);
        EXPECT_NE(made.error().what.find(word), std::string::npos) << made.error().what;
        EXPECT_NE(made.error().what.find("give"), std::string::npos) << made.error().what;
    };
    refused([&](SpotLight& l) { l.position.y = nan; }, "position");
    refused([&](SpotLight& l) { l.position.z = -inf; }, "position");
    refused([&](SpotLight& l) { l.direction = {0, 0, 0}; }, "direction");
    refused([&](SpotLight& l) { l.direction.x = nan; }, "direction");
    refused([&](SpotLight& l) { l.direction = {1e200, 0, 0}; }, "direction");
    for (const double angle : {nan, -0.5, 0.0, 1e-9, 1.5708, 2.0, inf})
        refused([&](SpotLight& l) { l.halfAngle = angle; }, "half-angle");
    for (const double range : {nan, -1.0, 0.0, inf}) refused([&](SpotLight& l) { l.range = range; }, "range");
    refused([&](SpotLight& l) { l.range = 1001; }, "range");
    for (const double near : {nan, -1.0, 0.0, 30.0}) refused([&](SpotLight& l) { l.near = near; }, "near");
    for (const int side : {0, 63, 4097}) refused([&](SpotLight& l) { l.side = side; }, "resolution");
}

}  // namespace
