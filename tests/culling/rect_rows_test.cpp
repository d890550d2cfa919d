// Rectangles in rows against rectangles one by one, and casters in rows against their bounds.
#include "culling/rect_rows.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "culling/caster_query.h"
#include "tests/toy_scene.h"

namespace {

struct Rows {
    std::vector<float> minX, minY, maxX, maxY;
    void add(glm::vec2 min, glm::vec2 max) {
        minX.push_back(min.x);
        minY.push_back(min.y);
        maxX.push_back(max.x);
        maxY.push_back(max.y);
    }
    culling::RectRows rows() const { return {minX.data(), minY.data(), maxX.data(), maxY.data(), minX.size()}; }
};

TEST(RectRows, RoundLikeNextafter) {
    constexpr float inf = std::numeric_limits<float>::infinity();
    std::mt19937_64 rng(30);
    for (int step = 0; step < 200000; ++step) {
        double v = std::bit_cast<double>(rng());  // any bits: infinite, tiny, no number
        if (step % 3 == 0) v = double(std::bit_cast<float>(uint32_t(rng())));
        if (step % 1000 == 0) v = step % 2000 ? -0.0 : 0.0;
        if (std::isfinite(v) && std::abs(v) > 3e38) continue;  // narrowing that has no result
        const float up = culling::roundedUp(v), down = culling::roundedDown(v);
        ASSERT_TRUE(std::isnan(v) ? std::isnan(up) && std::isnan(down)
                                  : up == std::nextafter(float(v), inf) && down == std::nextafter(float(v), -inf))
            << v;
    }
}

TEST(RectRows, MeetLikeRectanglesOneByOne) {
    std::mt19937 rng(31);
    for (const float far : {0.0f, 1e6f}) {
        std::uniform_int_distribution<int> at(-20, 20), edge(0, 9);  // whole metres: many just touch
        for (int step = 0; step < 3000; ++step) {
            Rows many;
            const size_t count = step % 5 == 0 ? rng() % 3 : rng() % 200;  // none, one, several blocks
            for (size_t k = 0; k < count; ++k) {
                const glm::vec2 min(far + float(at(rng)), float(at(rng)) - far);
                many.add(min, min + glm::vec2(float(edge(rng)), float(edge(rng))));
            }
            glm::vec2 low(far + float(at(rng)), float(at(rng)) - far);
            glm::vec2 high = low + glm::vec2(float(edge(rng)), float(edge(rng)));
            if (step % 7 == 0) low -= 100.0f, high += 100.0f;  // all of them
            std::vector<size_t> found, truth;
            culling::eachMeeting(many.rows(), low, high, [&](size_t k) { found.push_back(k); });
            for (size_t k = 0; k < count; ++k)
                if (many.minX[k] <= high.x && many.maxX[k] >= low.x && many.minY[k] <= high.y && many.maxY[k] >= low.y)
                    truth.push_back(k);
            ASSERT_EQ(found, truth) << "step " << step;
        }
    }
}

TEST(CasterRows, FindThoseOverARectangle) {
    std::mt19937 rng(32);
    std::uniform_real_distribution<double> place(-80, 80), edge(0, 30);
    for (const glm::dvec3 origin : {glm::dvec3(0), glm::dvec3(1e6, 0, -1e6)}) {
        tests::ToyScene scene(glm::dvec3(0.5, -0.4, 0.2), {{20, 0.1}}, 100);
        const auto slot = scene.addMesh(tests::boxMesh({3, 1, 2}));
        culling::CasterRows rows;
        std::vector<world::CasterId> found{7};
        rows.fill(scene.light, scene.active);
        rows.over(glm::dvec2(-1e9), glm::dvec2(1e9), found);
        EXPECT_TRUE(found.empty());
        for (int i = 0; i < 300; ++i)
            scene.addActive(slot, tests::placedAt(origin + glm::dvec3(place(rng), place(rng), place(rng))));
        rows.fill(scene.light, scene.active);
        rows.over(glm::dvec2(-1e9), glm::dvec2(1e9), found);
        EXPECT_EQ(found, scene.active);
        for (int step = 0; step < 500; ++step) {
            const glm::dvec2 centre(scene.light.space().toLight(origin));
            const glm::dvec2 min = centre + glm::dvec2(place(rng), place(rng)), max = min + edge(rng);
            rows.over(min, max, found);
            ASSERT_TRUE(std::is_sorted(found.begin(), found.end()));
            for (const world::CasterId id : scene.active) {
                const world::Box& b = scene.light[id].bounds;
                const auto meets = [&](double room) {
                    return b.min.x <= max.x + room && b.max.x >= min.x - room && b.min.y <= max.y + room &&
                           b.max.y >= min.y - room;
                };
                const bool held = std::binary_search(found.begin(), found.end(), id);
                ASSERT_TRUE(held || !meets(0)) << "step " << step;
                ASSERT_TRUE(!held || meets(1e-4)) << "step " << step;  // four floats rounded at some 300 m
            }
        }
    }
}

}  // namespace
