// Quantised suns: near the true one, the same whatever came before, few of them, never too low.
#include "culling/sun_steps.h"

#include <gtest/gtest.h>

#include <random>
#include <set>

#include "culling/light_space.h"

namespace {

TEST(SunSteps, StaysNearTheSunAndOnAGrid) {
    std::mt19937 rng(2);
    std::uniform_real_distribution<double> azimuth(-7, 7), height(culling::kLowestSun, 1.5707963);
    for (const double step : {0.001, 0.00872664625997165, 0.05, 0.2}) {
        for (int i = 0; i < 20000; ++i) {
            const glm::dvec3 sun = culling::sunFromAngles(azimuth(rng), height(rng));
            const glm::dvec3 q = culling::quantisedSun(sun, step);
            EXPECT_NEAR(glm::length(q), 1, 1e-12);
            ASSERT_TRUE(culling::makeLightSpace(q));
            // The lowest suns go up to the lowest elevation of the grid.
            const double low = std::asin(-sun.y) < culling::kLowestSun + step ? step : 0;
            ASSERT_LT(culling::angleBetween(sun, q), 0.75 * step + low) << step;
            // Rounding twice lands on the same direction.
            ASSERT_LT(culling::angleBetween(q, culling::quantisedSun(q, step)), 1e-9);
        }
    }
}

TEST(SunSteps, ASlowDayTakesTheStepsOfItsArcAndNoMore) {
    std::set<std::tuple<double, double, double>> seen;
    const double step = glm::radians(0.5);
    for (int i = 0; i <= 100000; ++i) {
        const glm::dvec3 q = culling::quantisedSun(culling::sunFromAngles(glm::radians(90 + i * 0.0018), 0.7), step);
        seen.insert({q.x, q.y, q.z});
    }
    EXPECT_NEAR(double(seen.size()), 180 * std::cos(0.7) / 0.5, 3);
}

TEST(SunSteps, SmallAnglesAreExact) {
    const glm::dvec3 sun = culling::sunFromAngles(1, 1);
    const glm::dvec3 axis = glm::normalize(glm::cross(sun, glm::dvec3(0, 0, 1)));
    for (const double angle : {1e-9, 1e-6, 0.1, 3.0})
        EXPECT_NEAR(culling::angleBetween(sun, sun * std::cos(angle) + axis * std::sin(angle)), angle, angle * 1e-6);
}

}  // namespace
