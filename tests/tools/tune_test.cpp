// The search for settings, on made-up scenes in which every setting's worth is known.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

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
    const double error = 1000 / side + 0.1 / levels, flips = m.blend >= 0.4 ? 0 : 50 * (0.4 - m.blend);
    return {m, {error / 2, error}, {flips / 2, flips}, side * side / 1000 + 500 * levels + 10 * m.guardBand + 100 * m.blend};
}
world::Result<Trial> judge(const ShadowMethod& m) { return madeUp(m); }

TEST(Tune, FindsTheCheapestThatKeepsTheLimits) {
    for (const double error : {4.0, 1.2, 0.5}) {
        const TuneLimits limits{.error = error, .instability = 10};
        const auto tuned = tools::lab::tune(gnomon(), limits, 1000, judge);
        ASSERT_TRUE(tuned) << tuned.error().what;
        ASSERT_TRUE(tuned.value().met);
        const Trial& best = tuned.value().trials[tuned.value().best];
        EXPECT_LE(best.error.elsewhere, error);
        EXPECT_LE(best.instability.elsewhere, 10);
        EXPECT_DOUBLE_EQ(best.method.blend, 0.2) << "10 flips are allowed";
        EXPECT_EQ(best.method.guardBand, 1);
        for (const Trial& t : tuned.value().trials)
            EXPECT_FALSE(t.error.elsewhere <= error && t.instability.elsewhere <= 10 && t.cost < best.cost);
        // Nothing next to it is cheaper and within the limits: by formula.
        ShadowMethod smaller = best.method;
        for (const int side : {256, 384, 512, 768, 1024, 1536, 2048, 3072})
            if (side < best.method.side) smaller.side = side;
        EXPECT_TRUE(smaller.side == best.method.side || madeUp(smaller).error.elsewhere > error);
    }
}

TEST(Tune, ALimitOnCostAsksForTheLeastError) {
    const auto tuned = tools::lab::tune(gnomon(), {.cost = 600}, 1000, judge);
    ASSERT_TRUE(tuned);
    const Trial& best = tuned.value().trials[tuned.value().best];
    EXPECT_LE(best.cost, 600);
    for (const Trial& t : tuned.value().trials) EXPECT_FALSE(t.cost <= 600 && t.error.here < best.error.here);
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

TEST(Tune, ExpectsAnotherPathToDifferAsItsOwnFramesDo) {
    tools::lab::MethodResult result;
    const auto add = [&](std::initializer_list<uint64_t> wrong) {
        for (const uint64_t count : wrong) {  // a pair each, all in the second frame
            tools::lab::JudgedFrame first, second;
            first.measures.pixels = 400;
            second.measures.pixels = 600;
            second.measures.falseLit.atEdges = count;
            second.measures.points = 1000;
            result.judged.insert(result.judged.end(), {first, second});
        }
    };
    add({5});
    EXPECT_DOUBLE_EQ(tools::lab::trialOf(result).error.elsewhere, 0.5) << "of one pair nobody knows how it varies";
    add({15});
    const Trial trial = tools::lab::trialOf(result);
    EXPECT_DOUBLE_EQ(trial.error.here, 1);
    // Shares of 0.5 and 1.5 % deviate by 1 / sqrt(2) %; so does the difference of two means of two.
    EXPECT_NEAR(trial.error.elsewhere, 1 + 2 / std::sqrt(2.0), 1e-12);
    EXPECT_EQ(trial.instability.here, 0);
    EXPECT_EQ(trial.instability.elsewhere, 0);

    // Of pairs of paths that are alike, nearly all of the second stay below what the first expects.
    std::mt19937 rng(7);
    std::gamma_distribution<double> wrong(0.5, 6);  // a few frames have nearly all: more so than on real paths
    size_t above = 0;
    const size_t paths = 2000;
    for (size_t k = 0; k < paths; ++k) {
        Trial trials[2];
        for (Trial& t : trials) {
            result.judged.clear();
            for (int i = 0; i < 30; ++i) add({uint64_t(wrong(rng))});
            t = tools::lab::trialOf(result);
        }
        if (trials[1].error.here > trials[0].error.elsewhere) ++above;
    }
    // 2.3 % were it normal; but a path with few wrong frames underrates how much they vary, too. One in ten is what is said.
    EXPECT_LT(double(above) / paths, 0.1);
    EXPECT_GT(above, 0u);
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
