// The cache against drawing from scratch: random life, every texel, every step; and defects that
// must not survive it.
#include "cache/shadow_cache.h"

#include <gtest/gtest.h>

#include <random>

#include "tests/toy_scene.h"

namespace {

using cache::Cause;
using tests::SoftMaps;
using tests::ToyScene;

constexpr int kSide = 40;

/// A scene in which casters come, go, move and stop while the eye walks and jumps.
class Life {
public:
    Life(uint32_t seed, glm::dvec3 origin, cache::Sabotage sabotage)
        : rng_(seed),
          origin_(origin),
          cascades_{{3.0, 0.15}, {10.0, 0.5}},
          scene_(glm::dvec3(0.4, -1, 0.3), cascades_),
          cache_(cascades_, {kSide, depth(origin) - 200, 400, sabotage}),
          held_(scene_, 2, kSide),
          eye_(origin) {
        for (glm::vec3 size : {glm::vec3(1, 1, 1), glm::vec3(0.2f, 4, 0.2f), glm::vec3(6, 0.5f, 1)})
            boxes_.push_back(scene_.addMesh(tests::boxMesh(size)));
        boxes_.push_back(scene_.addMesh(tests::sheetMesh(25, 20)));
    }

    /// One frame; false if a texel differs from the map drawn from scratch.
    bool step(int frame) {
        std::vector<cache::Departure> departures;
        std::vector<cache::Arrival> arrivals;
        std::vector<world::Box> dirt;
        for (int k = 0; k < 3; ++k) {
            const uint32_t what = rng_() % 8;
            if (what < 3 || statics_.size() < 20) {
                const auto id = scene_.addStatic(boxes_[rng_() % boxes_.size()], somewhere());
                statics_.push_back(id);
                arrivals.push_back({id, Cause::kArrival});
            } else if (what < 5) {
                const auto id = takeStatic(arrivals);
                if (id == kNone) continue;
                departures.push_back({scene_.light[id].bounds, Cause::kDeparture});
                scene_.statics.remove(id);
                dead_.push_back(id);
            } else if (what == 5 && movers_.size() < 6) {
                const auto id = takeStatic(arrivals);
                if (id == kNone) continue;
                departures.push_back({scene_.light[id].bounds, Cause::kDemotion});
                scene_.statics.remove(id);
                scene_.table.setState(id, world::CasterState::kActive);
                scene_.active.insert(std::lower_bound(scene_.active.begin(), scene_.active.end(), id), id);
                movers_.push_back(id);
                move(id, dirt);
            } else if (what == 6 && !movers_.empty()) {
                const auto id = movers_.back();
                movers_.pop_back();
                dirt.push_back(scene_.light[id].bounds);
                std::erase(scene_.active, id);
                scene_.table.setState(id, world::CasterState::kStatic);
                scene_.light.addStatic(id, scene_.table);
                scene_.statics.insert(id, scene_.table[id].bounds);
                statics_.push_back(id);
                arrivals.push_back({id, Cause::kPromotion});
            } else {
                for (const auto id : movers_) move(id, dirt);
            }
        }
        std::sort(arrivals.begin(), arrivals.end(), [](auto& a, auto& b) { return a.caster < b.caster; });
        const double stride = frame % 23 == 22 ? 60 : 0.8;  // now and then beyond every window
        eye_ += glm::dvec3(uniform(-stride, stride), 0, uniform(-stride, stride));
        if (frame % 23 == 22) eye_ = origin_ + glm::dvec3(uniform(-8, 8), 0, uniform(-8, 8));

        cache::FramePlan plan;
        const glm::dvec2 eye(scene_.light.space().toLight(eye_));
        cache_.plan(scene_.view(), {departures, arrivals, dirt}, eye, plan, statistics_);
        held_.execute(plan);
        for (const auto id : dead_) scene_.table.remove(id);
        dead_.clear();

        SoftMaps truth(scene_, 2, kSide);
        std::vector<cache::CascadeStatistics> redrawn;
        cache_.planRedraw(scene_.view(), plan, redrawn);
        truth.execute(plan);
        return held_.maps() == truth.maps();
    }
    const std::vector<cache::CascadeStatistics>& statistics() const { return statistics_; }
    cache::ShadowCache& cache() { return cache_; }
    /// A frame in which nothing happens.
    cache::FramePlan rest() {
        cache::FramePlan plan;
        cache_.plan(scene_.view(), {}, glm::dvec2(scene_.light.space().toLight(eye_)), plan, statistics_);
        return plan;
    }

private:
    static constexpr world::CasterId kNone = 0xffffffffu;
    static double depth(glm::dvec3 origin) {
        return culling::makeLightSpace({0.4, -1, 0.3}).value().toLight(origin).z;
    }
    double uniform(double low, double high) { return std::uniform_real_distribution<double>(low, high)(rng_); }
    world::Placement somewhere() {
        return tests::placedAt(origin_ + glm::dvec3(uniform(-15, 15), uniform(-3, 3), uniform(-15, 15)),
                               uniform(0.3, 1.5));
    }
    world::CasterId takeStatic(const std::vector<cache::Arrival>& fresh) {
        const size_t at = rng_() % statics_.size();
        const auto id = statics_[at];
        // One event a frame for one caster: what arrives now stays for now.
        for (const cache::Arrival& a : fresh)
            if (a.caster == id) return kNone;
        statics_.erase(statics_.begin() + std::ptrdiff_t(at));
        return id;
    }
    void move(world::CasterId id, std::vector<world::Box>& dirt) {
        dirt.push_back(scene_.light[id].bounds);
        scene_.table.place(id, somewhere());
        scene_.light.addActive(id, scene_.table);
        dirt.push_back(scene_.light[id].bounds);
    }

    std::mt19937 rng_;
    glm::dvec3 origin_;
    std::vector<culling::Cascade> cascades_;
    ToyScene scene_;
    cache::ShadowCache cache_;
    SoftMaps held_;
    glm::dvec3 eye_;
    std::vector<world::MeshSlot> boxes_;
    std::vector<world::CasterId> statics_, movers_, dead_;
    std::vector<cache::CascadeStatistics> statistics_;
};

TEST(ShadowCache, HoldsWhatDrawingFromScratchGives) {
    for (glm::dvec3 origin : {glm::dvec3(0), glm::dvec3(1e6, 50, -6.1e6)}) {
        Life life(5, origin, cache::Sabotage::kNone);
        for (int frame = 0; frame < 120; ++frame) ASSERT_TRUE(life.step(frame)) << "frame " << frame;
    }
}

TEST(ShadowCache, CausesAddUpToTheTotals) {
    Life life(6, glm::dvec3(0), cache::Sabotage::kNone);
    bool seen[cache::kCauses] = {};
    for (int frame = 0; frame < 200; ++frame) {
        life.step(frame);
        for (const cache::CascadeStatistics& s : life.statistics()) {
            cache::Cost sum;
            for (int cause = 0; cause < cache::kCauses; ++cause) {
                sum += s.byCause[size_t(cause)];
                seen[cause] |= s.byCause[size_t(cause)].texels > 0;
            }
            ASSERT_EQ(sum, s.total) << "frame " << frame;
        }
    }
    for (Cause cause : {Cause::kStart, Cause::kJump, Cause::kScroll, Cause::kDeparture, Cause::kDemotion,
                        Cause::kArrival, Cause::kPromotion})
        EXPECT_TRUE(seen[int(cause)]) << toString(cause) << " never happened: the test is too tame";
}

TEST(ShadowCache, NothingMovingPlansNothing) {
    Life life(7, glm::dvec3(0), cache::Sabotage::kNone);
    for (int frame = 0; frame < 5; ++frame) life.step(frame);
    EXPECT_TRUE(life.rest().idle());
    EXPECT_EQ(life.statistics()[0].total, cache::Cost{});
}

TEST(ShadowCache, DefectsAreSeen) {
    for (cache::Sabotage sabotage : {cache::Sabotage::kLiteralScroll, cache::Sabotage::kDeafDeparture}) {
        Life life(5, glm::dvec3(0), sabotage);
        bool caught = false;
        for (int frame = 0; frame < 250 && !caught; ++frame) caught = !life.step(frame);
        EXPECT_TRUE(caught) << "sabotage " << int(sabotage);
    }
}

TEST(ShadowCache, AnEmptySceneIsDrawnOnceAsEmpty) {
    const std::vector<culling::Cascade> cascades{{3.0, 0.15}};
    ToyScene scene(glm::dvec3(0, -1, 0), cascades);
    cache::ShadowCache cache(cascades, {kSide, 0, 1, cache::Sabotage::kNone});
    cache::FramePlan plan;
    std::vector<cache::CascadeStatistics> statistics;
    cache.plan(scene.view(), {}, glm::dvec2(0), plan, statistics);
    EXPECT_EQ(statistics[0].total.texels, uint64_t(kSide * kSide));
    EXPECT_EQ(statistics[0].total.triangles, 0u);
    cache.plan(scene.view(), {}, glm::dvec2(0), plan, statistics);
    EXPECT_TRUE(plan.idle());
}

}  // namespace
