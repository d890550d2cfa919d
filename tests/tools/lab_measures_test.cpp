// tests/tools/lab_measures_test.cpp — what counts as wrong, as seen and as flickering, on frames made up pixel by pixel.
#include "tools/lab/measures.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tools/lab/picture.h"

namespace {

using culling::Sunlight;
using server::ReceiverLight;
using tools::lab::Asked;
using tools::lab::Measures;

constexpr double kRightAngle = 1.5707963267948966;

/// One row of pixels, all 10 m straight ahead on surfaces that face the eye, with a sun 60 degrees from their normals;
/// no edges nearby.
culling::TruthFrame row(std::vector<Sunlight> states) {
    culling::TruthFrame truth;
    truth.width = int(states.size());
    truth.height = 1;
    truth.eye = {1e6, 0, 0};
    truth.sun = {std::sqrt(0.75), 0, -0.5};
    for (const Sunlight state : states) {
        const bool sky = state == Sunlight::kSky;
        truth.points.emplace_back(0, 0, sky ? 0 : -10);
        truth.normals.emplace_back(0, 0, sky ? 0 : 1);
        truth.casters.push_back(sky ? culling::kNoCaster : 0);
        truth.edges.push_back(culling::kEdgeSteps);
    }
    truth.states = std::move(states);
    return truth;
}

ReceiverLight answer(float light, float texel = 0.5f) { return {.light = light, .texel = texel, .view = 0}; }
ReceiverLight none() { return {.light = 1, .texel = 0, .view = -1}; }

Measures judged(const culling::TruthFrame& truth, std::vector<ReceiverLight> answers) {
    // One pixel high, seen under a right angle: at 10 m a pixel is 20 m.
    return tools::lab::judge(truth, tools::lab::sunwardPixels(truth), answers, kRightAngle, 1000);
}

TEST(SunwardPixels, AreThoseThatTheSunCouldLight) {
    const auto truth = row({Sunlight::kSky, Sunlight::kLit, Sunlight::kAway, Sunlight::kShadowed});
    const Asked asked = tools::lab::sunwardPixels(truth);
    EXPECT_EQ(asked.pixels, (std::vector<uint32_t>{1, 3}));
    ASSERT_EQ(asked.receivers.size(), 2u);
    EXPECT_EQ(asked.receivers[1].point, glm::dvec3(1e6, 0, -10));
    EXPECT_EQ(asked.receivers[1].normal, glm::vec3(0, 0, 1));
    EXPECT_EQ(asked.receivers[1].pixel, 3u);
    EXPECT_TRUE(tools::lab::sunwardPixels(row({})).pixels.empty());
}

TEST(Judge, CountsEachKindOfErrorOnItsOwn) {
    const Measures m = judged(row({Sunlight::kLit, Sunlight::kLit, Sunlight::kShadowed, Sunlight::kShadowed, Sunlight::kShadowed}),
                              {answer(1), answer(0.25f), answer(0), answer(0.75f), answer(1)});
    EXPECT_EQ(m.frames, 1u);
    EXPECT_EQ(m.pixels, 5u);
    EXPECT_EQ(m.falseShadow.all(), 1u);
    EXPECT_EQ(m.falseLit.all(), 2u);
    EXPECT_EQ(m.wrong(), 3u);
    EXPECT_EQ(m.difference, 0.75 + 0.75 + 1);  // quarters are exact
    EXPECT_EQ(m.share(m.wrong()), 0.6);
    EXPECT_EQ(m.points, 0u);
}

TEST(Judge, HoldsSoftLightAgainstTheShareOfTheDisk) {
    const auto truth = row({Sunlight::kLit, Sunlight::kShadowed, Sunlight::kLit});
    Asked asked = tools::lab::sunwardPixels(truth);
    const std::vector<ReceiverLight> answers{answer(0.75f), answer(0.75f), answer(1)};
    EXPECT_EQ(tools::lab::judge(truth, asked, answers, kRightAngle, 1000).softDifference, 0);
    asked.shares = {0.75f, 0.25f, 0.5f};
    const Measures m = tools::lab::judge(truth, asked, answers, kRightAngle, 1000);
    EXPECT_EQ(m.softDifference, 0.5 + 0.5);
    EXPECT_EQ(m.difference, 0.25 + 0.75);
}

TEST(Judge, HalfTheLightIsShadow) {
    const Measures m = judged(row({Sunlight::kLit, Sunlight::kShadowed}), {answer(0.5f), answer(0.5f)});
    EXPECT_EQ(m.falseShadow.all(), 1u);
    EXPECT_EQ(m.falseLit.all(), 0u);
}

TEST(Judge, AnEdgeWithinATexelExcusesTheTexelAndNothingElse) {
    auto truth = row({Sunlight::kLit, Sunlight::kLit, Sunlight::kLit});
    truth.edges = {7, 9, culling::kEdgeSteps};  // 1 m, 4 m, none
    // An edge found at 1 m may be 1 / 2.17 m away: a texel of half a metre reaches it, one of 1.8 m reaches 3.9 m.
    const Measures fine = judged(truth, {answer(0, 0.5f), answer(0, 0.5f), answer(0, 0.5f)});
    EXPECT_EQ(fine.falseShadow.atEdges, 1u);
    EXPECT_EQ(fine.falseShadow.elsewhere, 2u);
    const Measures coarse = judged(truth, {answer(0, 0.45f), answer(0, 1.85f), answer(0, 1000)});
    EXPECT_EQ(coarse.falseShadow.atEdges, 1u);
    EXPECT_EQ(coarse.falseShadow.elsewhere, 2u);
}

TEST(Judge, WhatNoMapAnswersIsCountedAndHasNoTexel) {
    const Measures m = judged(row({Sunlight::kShadowed, Sunlight::kLit}), {none(), answer(1, 40)});
    EXPECT_EQ(m.unanswered, 1u);
    EXPECT_EQ(m.falseLit.all(), 1u);  // it counts as lit
    ASSERT_EQ(m.texelsPerPixel.size(), 1u);
    EXPECT_FLOAT_EQ(m.texelsPerPixel[0], 2);  // 40 m over the pixel's 20 m
    EXPECT_EQ(m.texelRatio(0.5), m.texelRatio(0.99));
    // A pixel of 20 x 20 m, tilted by 60 degrees as the sun sees it, over texels of 40 x 40 m, of 1000.
    EXPECT_NEAR(m.usedShare, 20 * 20 * 0.5 / (40 * 40) / 1000, 1e-9);  // the ratio above is in single precision
}

TEST(Judge, AFrameWithoutSunlitSurfacesHasNoErrors) {
    const Measures m = judged(row({Sunlight::kSky, Sunlight::kAway}), {});
    EXPECT_EQ(m.pixels, 0u);
    EXPECT_EQ(m.share(m.wrong()), 0);
    EXPECT_EQ(m.texelRatio(0.5), 0);
    EXPECT_EQ(m.flipsPerMillion(), 0);
}

TEST(JudgeFlips, CountsOnlyPointsWhoseTruthStays) {
    const auto truth = row({Sunlight::kLit, Sunlight::kLit, Sunlight::kShadowed, Sunlight::kShadowed});
    const Asked asked = tools::lab::sunwardPixels(truth);
    const std::vector<Sunlight> again{Sunlight::kLit, Sunlight::kShadowed, Sunlight::kShadowed, Sunlight::kSky};
    const std::vector<ReceiverLight> first{answer(1), answer(1), answer(0.2f), answer(0)};
    const std::vector<ReceiverLight> second{answer(0), answer(0), answer(0.6f), answer(1)};
    const Measures m = tools::lab::judgeFlips(truth, asked, first, second, again);
    EXPECT_EQ(m.points, 2u);  // the others went into shadow and out of sight
    EXPECT_EQ(m.flips, 1u);   // less than half a light is no flip
    EXPECT_EQ(m.flipsPerMillion(), 5e5);
    EXPECT_EQ(m.frames, 0u);
    EXPECT_EQ(m.pixels, 0u);
    EXPECT_EQ(tools::lab::judgeFlips(truth, asked, first, first, again).flips, 0u);
}

TEST(Measures, AddUpOverFrames) {
    const auto truth = row({Sunlight::kLit, Sunlight::kShadowed});
    Measures sum = judged(truth, {answer(0, 20), answer(0, 40)});
    sum += judged(truth, {answer(1, 60), answer(1, 80)});
    EXPECT_EQ(sum.frames, 2u);
    EXPECT_EQ(sum.pixels, 4u);
    EXPECT_EQ(sum.falseShadow.all(), 1u);
    EXPECT_EQ(sum.falseLit.all(), 1u);
    EXPECT_FLOAT_EQ(float(sum.texelRatio(0)), 1);
    EXPECT_FLOAT_EQ(float(sum.texelRatio(0.5)), 3);
    EXPECT_FLOAT_EQ(float(sum.texelRatio(1)), 4);
}

tools::lab::Rgb pixel(const tools::RgbImage& image, size_t at) {
    return {image.pixels[3 * at], image.pixels[3 * at + 1], image.pixels[3 * at + 2]};
}

TEST(WrongPicture, TintsWhatIsWrongAndNothingElse) {
    const auto truth = row({Sunlight::kSky, Sunlight::kAway, Sunlight::kLit, Sunlight::kLit, Sunlight::kShadowed, Sunlight::kShadowed});
    const auto image = tools::lab::wrongPicture(truth, tools::lab::sunwardPixels(truth), std::vector{answer(1), answer(0), answer(0), answer(1)});
    ASSERT_EQ(image.width, 6);
    ASSERT_EQ(image.height, 1);
    EXPECT_EQ(pixel(image, 0), tools::lab::kSkyColor);
    EXPECT_EQ(pixel(image, 3), tools::lab::kFalseShadow);
    EXPECT_EQ(pixel(image, 5), tools::lab::kFalseLit);
    for (const size_t at : {1u, 2u, 4u}) {
        EXPECT_EQ(pixel(image, at)[0], pixel(image, at)[1]) << at;
        EXPECT_EQ(pixel(image, at)[0], pixel(image, at)[2]) << at;
    }
    EXPECT_EQ(pixel(image, 1), pixel(image, 4));
    EXPECT_GT(pixel(image, 2)[0], pixel(image, 4)[0] + 40);  // light and shadow are told apart at a glance
    EXPECT_LT(pixel(image, 2)[0], tools::lab::kSkyColor[0] - 30);
}

}  // namespace
