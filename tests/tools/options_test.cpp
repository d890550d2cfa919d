// tests/tools/options_test.cpp — words of the command line: what is taken, what is refused and how.
#include "tools/options.h"

#include <gtest/gtest.h>

#include <cmath>

namespace {

template <class T>
void expectUsage(const world::Result<T>& result, const std::string& text) {
    ASSERT_FALSE(result) << text;
    EXPECT_EQ(result.error().code, world::ErrorCode::kUsage) << text;
    EXPECT_EQ(result.error().what.find('\n'), std::string::npos) << text;
    EXPECT_NE(result.error().what.find("give"), std::string::npos) << result.error().what;
}

TEST(FrameRange, IsHalfOpenAndNotEmpty) {
    EXPECT_EQ(tools::parseFrameRange("3:5").value(), (tools::FrameRange{3, 5}));
    EXPECT_EQ(tools::parseFrameRange("0:1").value(), (tools::FrameRange{0, 1}));
    for (const char* text : {"", ":", "3", "3:", ":5", "5:5", "6:5", "-1:5", "1:2:3", "a:b", "1:2x", " 1:2",
                             "1.5:2", "99999999999999999999:1"})
        expectUsage(tools::parseFrameRange(text), text);
}

TEST(Sun, ComesFromWhereTheAnglesSay) {
    const double tolerance = 1e-12;  // rounding of sine and cosine
    const glm::dvec3 overhead = tools::parseSun("0,90").value();
    EXPECT_NEAR(glm::length(overhead - glm::dvec3(0, -1, 0)), 0, tolerance);
    const glm::dvec3 east = tools::parseSun("90,45").value();  // seen in the east: light travels west
    EXPECT_NEAR(glm::length(east - glm::dvec3(-std::sqrt(0.5), -std::sqrt(0.5), 0)), 0, tolerance);
    const glm::dvec3 north = tools::parseSun("0,45").value();  // north is -z
    EXPECT_NEAR(glm::length(north - glm::dvec3(0, -std::sqrt(0.5), std::sqrt(0.5))), 0, tolerance);
}

TEST(Sun, BelowTheHorizonOrNoDirectionIsUsage) {
    for (const char* text : {"", "90", "90,", ",90", "90,45,1", "90,-10", "90,0", "90,0.5", "90,91", "nan,45",
                             "90,nan", "inf,45", "a,b", "90;45", "90,100"})
        expectUsage(tools::parseSun(text), text);
    EXPECT_TRUE(tools::parseSun("725,1.01"));
}

TEST(Spot, IsEightNumbersThatMakeALight) {
    const culling::SpotLight light = tools::parseSpot("-1,8.5,2,0,-1,0.5,35,30").value();
    EXPECT_EQ(light.position, glm::dvec3(-1, 8.5, 2));
    EXPECT_EQ(light.direction, glm::dvec3(0, -1, 0.5));
    EXPECT_DOUBLE_EQ(light.halfAngle, 35 * 3.14159265358979323846 / 180);
    EXPECT_EQ(light.range, 30);
    for (const char* text : {"", "1,2,3", "-1,8,2,0,-1,0,35", "-1,8,2,0,-1,0,35,30,1", "-1,8,2,0,0,0,35,30",
                             "-1,8,2,0,-1,0,90,30", "-1,8,2,0,-1,0,0,30", "-1,8,2,0,-1,0,35,-30", "-1,8,2,0,-1,0,35,1001",
                             "nan,8,2,0,-1,0,35,30", "-1,8,2,0,-1,0,35,inf", "lamp"})
        expectUsage(tools::parseSpot(text), text);
}

TEST(Bounds, AreFourNumbersInOrder) {
    EXPECT_EQ(tools::parseBounds("-1,2.5,3,1e3").value(), (std::array<double, 4>{-1, 2.5, 3, 1000}));
    for (const char* text :
         {"", "1,2,3", "1,2,3,4,5", "3,2,1,4", "1,4,3,2", "1,2,1,4", "1,2,nan,4", "1,2,3,inf"})
        expectUsage(tools::parseBounds(text), text);
}

TEST(Count, IsAWholeNumberFromOne) {
    EXPECT_EQ(tools::parseCount("--verify", "25").value(), 25u);
    for (const char* text : {"", "0", "-1", "1.5", "x", "25 "})
        expectUsage(tools::parseCount("--verify", text), text);
}

TEST(ExitStatus, SeparatesUsageFromTheRest) {
    EXPECT_EQ(tools::exitStatus(world::ErrorCode::kUsage), 2);
    for (const auto code : {world::ErrorCode::kNotFound, world::ErrorCode::kBadData, world::ErrorCode::kIo,
                            world::ErrorCode::kDevice, world::ErrorCode::kLimit})
        EXPECT_EQ(tools::exitStatus(code), 3);
}

}  // namespace
