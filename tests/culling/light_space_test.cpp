// Light space: a right-handed frame that runs with the sun, for every sun above the horizon.
#include "culling/light_space.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace {

using culling::makeLightSpace;

TEST(LightSpace, IsARotationWhoseZRunsWithTheLight) {
    for (double azimuth = 0; azimuth < 6.3; azimuth += 0.3)
        for (double elevation : {0.02, 0.5, 1.0, 1.5707963267948966}) {
            const glm::dvec3 sun = culling::sunFromAngles(azimuth, elevation);
            const auto space = makeLightSpace(sun);
            ASSERT_TRUE(space) << azimuth << " " << elevation;
            const glm::dmat3 m = space.value().lightFromWorld;
            EXPECT_NEAR(glm::determinant(m), 1, 1e-12);  // doubles: rounding of a few products
            EXPECT_NEAR(glm::length(space.value().toLight(sun) - glm::dvec3(0, 0, 1)), 0, 1e-12);
            const glm::dvec3 p(1e6, -30, 6e6);
            EXPECT_NEAR(glm::length(space.value().toWorld(space.value().toLight(p)) - p), 0, 1e-8);
        }
}

TEST(LightSpace, AnglesNameTheSunAsSeen) {
    // In the east, on the horizon: the light travels west.
    EXPECT_NEAR(glm::length(culling::sunFromAngles(std::acos(-1) / 2, 0) - glm::dvec3(-1, 0, 0)), 0, 1e-12);
    // In the north (-z): the light travels south.
    EXPECT_NEAR(glm::length(culling::sunFromAngles(0, 0) - glm::dvec3(0, 0, 1)), 0, 1e-12);
    EXPECT_NEAR(glm::length(culling::sunFromAngles(1, std::acos(-1) / 2) - glm::dvec3(0, -1, 0)), 0, 1e-12);
}

TEST(LightSpace, RefusesSunsThatCannotBeServed) {
    const double nan = std::numeric_limits<double>::quiet_NaN();
    for (glm::dvec3 sun : {glm::dvec3(0), glm::dvec3(nan, -1, 0), glm::dvec3(1, 0, 0), glm::dvec3(0, 1, 0),
                           glm::dvec3(0.3, 0.1, 0), culling::sunFromAngles(1, 0.01)}) {
        const auto space = makeLightSpace(sun);
        ASSERT_FALSE(space);
        EXPECT_EQ(space.error().code, world::ErrorCode::kUsage);
        EXPECT_NE(space.error().what.find("--sun"), std::string::npos);
    }
}

}  // namespace
