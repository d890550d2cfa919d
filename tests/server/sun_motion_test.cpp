// When the sun steps: the cases from a still sun to one that cannot be followed.
#include "server/sun_motion.h"

#include <gtest/gtest.h>

#include "culling/light_space.h"
#include "culling/sun_steps.h"

namespace {

using server::SunMotion;

glm::dvec3 at(double degrees) { return culling::sunFromAngles(glm::radians(90 + degrees), 0.9); }

/// Lives with a sun of constant speed; next maps are complete once their shares sum to one.
struct Course {
    int opened = 0, shown = 0, redrawn = 0, frames = 0;
    double mostLag = 0, mostShare = 0;

    Course(double degreesPerSecond, double seconds, const server::SunMotionConfig& config = {}) {
        SunMotion motion(config, at(0), true);
        double filled = 0;
        bool open = false;
        for (; frames < seconds * 30; ++frames) {
            const double time = frames / 30.0;
            if (open && motion.showNext(time, filled >= 1)) {
                ++shown;
                open = false;
            }
            const SunMotion::Decision d = motion.decide(time, at(degreesPerSecond * time));
            EXPECT_EQ(d.dropNext, d.action == SunMotion::Action::kRedraw && open);
            if (d.action == SunMotion::Action::kRedraw) {
                ++redrawn;
                open = false;
                EXPECT_TRUE(motion.report().redrawn);
            }
            if (d.action == SunMotion::Action::kOpen) {
                EXPECT_FALSE(open);
                ++opened;
                open = true;
                filled = 0;
            }
            if (open) filled += d.share;
            if (frames > 10) mostLag = std::max(mostLag, motion.report().lag);
            mostShare = std::max(mostShare, d.share);
            EXPECT_EQ(open, motion.report().next != glm::dvec3(0));
        }
    }
};

TEST(SunMotion, AStillSunOpensNothing) {
    const Course run(0, 20);
    EXPECT_EQ(run.opened + run.redrawn, 0);
    EXPECT_EQ(run.mostLag, 0);
}

TEST(SunMotion, ADayFromAMinuteToADayIsFollowed) {
    const double step = server::SunMotionConfig{}.step;
    for (const double day : {60.0, 3600.0, 86400.0}) {
        const double speed = 180 / day;
        const Course run(speed, day == 60 ? 60 : 400);
        EXPECT_EQ(run.redrawn, 0) << day;
        EXPECT_NEAR(run.shown, run.opened, 1);
        // Steps as long as they are on the sky: azimuths shrink with the sun's height.
        const double steps = run.frames / 30.0 * glm::radians(speed) * std::cos(0.9) / step;
        EXPECT_NEAR(run.shown, steps, day == 60 ? steps * 0.6 : 2) << day;
        EXPECT_LT(run.mostLag, (day == 60 ? 3.5 : 1.8) * step) << day;
        EXPECT_LE(run.mostShare, day == 60 ? 0.6 : 1 / SunMotion::kMostFrames + 1e-9);
    }
}

TEST(SunMotion, ASunThatOutrunsTheCacheRedrawsAndSaysSo) {
    const Course run(30, 5);
    EXPECT_GT(run.redrawn, 100);
    EXPECT_LT(run.mostLag, server::SunMotionConfig{}.step);
}

TEST(SunMotion, AJumpIsRedrawnAndABlendTakesItsTime) {
    SunMotion motion({}, at(0), true);
    motion.decide(0, at(0));
    EXPECT_EQ(motion.decide(1, at(40)).action, SunMotion::Action::kRedraw);
    EXPECT_EQ(motion.decide(2, at(40)).action, SunMotion::Action::kNone);
    SunMotion::Action action = SunMotion::Action::kNone;
    for (int i = 1; action == SunMotion::Action::kNone && i < 10; ++i) action = motion.decide(2 + i * 0.2, at(40 + i * 0.3)).action;
    EXPECT_EQ(action, SunMotion::Action::kOpen);
    EXPECT_FALSE(motion.showNext(4, false));
    EXPECT_EQ(motion.report().weight, 0);
    EXPECT_FALSE(motion.showNext(5, true));
    EXPECT_FALSE(motion.showNext(5.1, true));
    EXPECT_NEAR(motion.report().weight, 0.4, 1e-9);
    EXPECT_FALSE(motion.showNext(5.15, false)) << "owed again: the blend starts over";
    EXPECT_EQ(motion.report().weight, 0);
    EXPECT_FALSE(motion.showNext(5.2, true));
    EXPECT_TRUE(motion.showNext(5.46, true));
    EXPECT_EQ(motion.report().next, glm::dvec3(0));
}

TEST(SunMotion, WithoutACacheEveryStepRedraws) {
    SunMotion motion({}, at(0), false);
    motion.decide(0, at(0));
    EXPECT_EQ(motion.decide(1, at(0.9)).action, SunMotion::Action::kRedraw);
}

}  // namespace
