// The search for settings, on made-up scenes in which every setting's worth is known.
#include <gtest/gtest.h>

#include <cmath>

#include "culling/shadow_views.h"
#include "tools/lab/tune.h"

namespace {

using culling::ShadowMethod;
using tools::lab::Trial;
using tools::lab::Tuned;
using tools::lab::TuneLimits;

ShadowMethod gnomon() { return culling::methodNamed("gnomon").value(); }

/// Error falls with resolution and with finer levels, flips with the blend, and all of that costs.
Trial madeUp(const ShadowMethod& m) {
    const double side = m.side, levels = std::log2(8 / m.levelError);
    return {m, 1000 / side + 0.1 / levels, m.blend >= 0.4 ? 0 : 50 * (0.4 - m.blend), side * side / 1000 + 500 * levels + 10 * m.guardBand + 100 * m.blend};
}
world::Result<Trial> judge(const ShadowMethod& m) { return madeUp(m); }

TEST(Tune, FindsTheCheapestThatKeepsTheLimits) {
    for (const double error : {4.0, 1.2, 0.5}) {
        const TuneLimits limits{.error = error, .instability = 10};
        const auto tuned = tools::lab::tune(gnomon(), limits, 1000, judge);
        ASSERT_TRUE(tuned) << tuned.error().what;
        ASSERT_TRUE(tuned.value().met);
        const Trial& best = tuned.value().trials[tuned.value().best];
        EXPECT_LE(best.error, error);
        EXPECT_LE(best.instability, 10);
        EXPECT_DOUBLE_EQ(best.method.blend, 0.2) << "10 flips are allowed";
        EXPECT_EQ(best.method.guardBand, 1);
        for (const Trial& t : tuned.value().trials)
            EXPECT_FALSE(t.error <= error && t.instability <= 10 && t.cost < best.cost);
        // Nothing next to it is cheaper and within the limits: by formula.
        ShadowMethod smaller = best.method;
        for (const int side : {256, 384, 512, 768, 1024, 1536, 2048, 3072})
            if (side < best.method.side) smaller.side = side;
        EXPECT_TRUE(smaller.side == best.method.side || madeUp(smaller).error > error);
    }
}

TEST(Tune, ALimitOnCostAsksForTheLeastError) {
    const auto tuned = tools::lab::tune(gnomon(), {.cost = 600}, 1000, judge);
    ASSERT_TRUE(tuned);
    const Trial& best = tuned.value().trials[tuned.value().best];
    EXPECT_LE(best.cost, 600);
    for (const Trial& t : tuned.value().trials) EXPECT_FALSE(t.cost <= 600 && t.error < best.error);
}

TEST(Tune, SaysWhichLimitIsNotMetAndByHowMuch) {
    const TuneLimits limits{.error = 0.01, .instability = 100};
    const auto tuned = tools::lab::tune(gnomon(), limits, 1000, judge);
    ASSERT_TRUE(tuned);
    EXPECT_FALSE(tuned.value().met);
    const std::string text = tools::lab::tuneText(tuned.value(), limits);
    EXPECT_NE(text.find("not met    error"), std::string::npos) << text;
    EXPECT_EQ(text.find("not met    flips"), std::string::npos) << text;
    EXPECT_EQ(tuned.value().trials[tuned.value().best].method.side, 4096) << "as near as it gets";
}

TEST(Tune, TellsWhatALimitCosts) {
    const TuneLimits limits{.error = 1.2, .instability = 0};
    const auto tuned = tools::lab::tune(gnomon(), limits, 1000, judge);
    ASSERT_TRUE(tuned);
    ASSERT_TRUE(tuned.value().met);
    const std::string text = tools::lab::tuneText(tuned.value(), limits);
    EXPECT_NE(text.find("error      the limit of 1.2 costs "), std::string::npos) << text;
    EXPECT_NE(text.find("flips      the limit of 0 costs "), std::string::npos) << text;
}

TEST(Tune, StopsWhereItMayTryNoMoreAndPassesErrorsOn) {
    const auto few = tools::lab::tune(gnomon(), {.error = 1}, 3, judge);
    ASSERT_TRUE(few);
    EXPECT_EQ(few.value().trials.size(), 3u);
    size_t calls = 0;
    const auto failing = tools::lab::tune(gnomon(), {.error = 1}, 9, [&](const ShadowMethod& m) -> world::Result<Trial> {
        if (++calls == 2) return world::Error{world::ErrorCode::kDevice, "lost"};
        return madeUp(m);
    });
    ASSERT_FALSE(failing);
    EXPECT_EQ(failing.error().what, "lost");
}

}  // namespace
