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

/// Whether ranges of depths follow the eye, and are filled before they move or when they must.
enum class Depths { kFixed, kSpareMaps, kForced };

/// A scene in which casters come, go, move and stop while the eye walks and jumps.
class Life {
public:
    /// `guard`: windows move in steps of so many texels.
    Life(uint32_t seed, glm::dvec3 origin, cache::Sabotage sabotage, int guard = 1, Depths depths = Depths::kFixed)
        : rng_(seed),
          origin_(origin),
          climbs_(depths != Depths::kFixed),
          cascades_{{3.0, 0.15}, {10.0, 0.5}},
          scene_(glm::dvec3(0.4, -1, 0.3), cascades_),
          cache_(cascades_, {.side = kSide,
                             .guardBand = guard,
                             .scene = {depth(origin) - 200, 400},
                             .depthSteps = climbs_ ? 1.0 : 1 << 24,  // ranges of 24 and 80 m
                             .spareMap = depths == Depths::kSpareMaps,
                             .sabotage = sabotage}),
          held_(scene_, kMaps, kSide),
          eye_(origin) {
        for (glm::vec3 size : {glm::vec3(1, 1, 1), glm::vec3(0.2f, 4, 0.2f), glm::vec3(6, 0.5f, 1)})
            boxes_.push_back(scene_.addMesh(tests::boxMesh(size)));
        boxes_.push_back(scene_.addMesh(tests::sheetMesh(25, 20)));
    }

    /// One frame; false if a valid texel differs from the map drawn from scratch, or an unknown one is
    /// not marked as such.
    /// `climb`: of the eye [m], where ranges of depths follow it.
    bool step(int frame, const cache::Limits& limits = {}, uint32_t asleep = 0, double climb = 0.5) {
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
        const bool jumps = !climbs_ && frame % 23 == 22;
        const double stride = jumps ? 60 : climbs_ ? 0.2 : 0.8;  // now and then beyond every window
        eye_ += glm::dvec3(uniform(-stride, stride), 0, uniform(-stride, stride));
        if (jumps) eye_ = origin_ + glm::dvec3(uniform(-8, 8), 0, uniform(-8, 8));
        if (climbs_) eye_.y += climb;

        cache::FramePlan plan;
        plan.reset(kMaps);
        const glm::dvec3 eye = scene_.light.space().toLight(eye_);
        cache_.plan(scene_.view(), {departures, arrivals, dirt}, {eye, Cause::kStart, asleep, limits}, plan, statistics_);
        held_.execute(plan);
        for (const auto id : dead_) scene_.table.remove(id);
        dead_.clear();
        return matches();
    }
    /// A frame in which nothing happens.
    cache::FramePlan rest(const cache::Limits& limits = {}) {
        cache::FramePlan plan;
        plan.reset(kMaps);
        const glm::dvec3 eye = scene_.light.space().toLight(eye_);
        cache_.plan(scene_.view(), {}, {eye, Cause::kStart, 0, limits}, plan, statistics_);
        held_.execute(plan);
        return plan;
    }
    bool matches() const {
        SoftMaps truth(scene_, kMaps, kSide);
        cache::FramePlan plan;
        plan.reset(kMaps);
        std::vector<cache::CascadeStatistics> redrawn;
        cache_.planRedraw(scene_.view(), plan, redrawn);
        truth.execute(plan);
        for (size_t c = 0; c < 2; ++c) {
            const size_t map = cache_.map(int(c));
            const SoftMaps::Maps &held = held_.maps()[map], &drawn = truth.maps()[map];
            if (!cache_.drawn(int(c))) continue;
            const cache::TexelRect window = cache_.window(int(c));
            for (int64_t y = window.min.y; y < window.max.y; ++y) {
                for (int64_t x = window.min.x; x < window.max.x; ++x) {
                    const cache::Texel slot = cache_.lattice(int(c)).slot({x, y});
                    const auto i = size_t(slot.y * kSide + slot.x);
                    const cache::TexelRect texel{{x, y}, {x + 1, y + 1}};
                    bool owed = false, slept = false;
                    for (const cache::OwedRegion& r : cache_.owed(int(c))) {
                        if (!r.rect.overlaps(texel)) continue;
                        owed = true;
                        const bool marked = held.cache[i] == cache::kUnknownDepth && held.working[i] == cache::kUnknownDepth;
                        if ((r.owes == cache::Owes::kUnknown) != marked) return false;
                    }
                    for (const cache::TexelRect& r : cache_.slept(int(c))) slept |= r.overlaps(texel);
                    if (owed) continue;
                    if (held.cache[i] != drawn.cache[i] || (!slept && held.working[i] != drawn.working[i])) return false;
                }
            }
        }
        return true;
    }
    const std::vector<cache::CascadeStatistics>& statistics() const { return statistics_; }
    cache::ShadowCache& cache() { return cache_; }
private:
    static constexpr world::CasterId kNone = 0xffffffffu;
    static constexpr size_t kMaps = 3;  ///< two cascades', and one pair to spare
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
    bool climbs_;
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

TEST(ShadowCache, GuardBandMovesInStepsAndStaysExact) {
    for (const int guard : {2, 5, 16}) {
        Life life(8, glm::dvec3(0), cache::Sabotage::kNone, guard);
        int moves = 0;
        for (int frame = 0; frame < 60; ++frame) {
            ASSERT_TRUE(life.step(frame)) << "frame " << frame << ", guard " << guard;
            for (const cache::CascadeStatistics& s : life.statistics()) {
                ASSERT_EQ(s.window.x % guard, 0);
                ASSERT_EQ(s.window.y % guard, 0);
                moves += s.move != cache::Texel(0);
            }
        }
        EXPECT_GT(moves, 5);
        EXPECT_LT(moves, 120);
    }
}

uint64_t drawnIn(const std::vector<cache::CascadeStatistics>& statistics, uint64_t cache::Cost::* part) {
    uint64_t sum = 0;
    for (const cache::CascadeStatistics& s : statistics) sum += s.total.*part;
    return sum;
}

cache::Cost sumOverCauses(const cache::CascadeStatistics& s) {
    cache::Cost sum;
    for (const cache::Cost& cost : s.byCause) sum += cost;
    return sum;
}

TEST(ShadowCache, LimitsHoldAndWhatIsLeftIsOwedAndPaid) {
    for (const cache::Limits limits : {cache::Limits{700, cache::Limits::kNone}, cache::Limits{50, cache::Limits::kNone},
                                       cache::Limits{cache::Limits::kNone, 6000}, cache::Limits{900, 5000}}) {
        Life life(9, glm::dvec3(0), cache::Sabotage::kNone);
        uint64_t unknown = 0, stale = 0;
        for (int frame = 0; frame < 150; ++frame) {
            ASSERT_TRUE(life.step(frame, limits)) << "frame " << frame << ", " << limits.texels << " texels, "
                                                  << limits.triangles << " triangles";
            ASSERT_LE(drawnIn(life.statistics(), &cache::Cost::texels), limits.texels);
            ASSERT_LE(drawnIn(life.statistics(), &cache::Cost::triangles), limits.triangles);
            for (const cache::CascadeStatistics& s : life.statistics()) {
                ASSERT_EQ(sumOverCauses(s), s.total);
                unknown += s.unknownTexels;
                stale += s.staleTexels;
                if (limits.triangles == cache::Limits::kNone) {
                    ASSERT_LE(s.oldestDebt, life.cache().ageBound(limits.texels));
                }
            }
        }
        EXPECT_GT(unknown, 0u);
        EXPECT_GT(stale, 0u);
        // At rest everything is paid, and then nothing is left to do.
        int frames = 0;
        while (!life.rest(limits).idle()) ASSERT_LT(++frames, 500);
        EXPECT_TRUE(life.matches());
        for (const cache::CascadeStatistics& s : life.statistics()) EXPECT_EQ(s.unknownTexels + s.staleTexels, 0u);
    }
}

TEST(ShadowCache, LimitsThatSufficeChangeNothing) {
    for (const uint32_t seed : {13, 14, 15}) {
        const glm::dvec3 away(64, 0, 64);  // where blocks end that do not end at a wrap
        Life unlimited(seed, away, cache::Sabotage::kNone), limited(seed, away, cache::Sabotage::kNone);
        for (int frame = 0; frame < 60; ++frame) {
            ASSERT_TRUE(unlimited.step(frame));
            ASSERT_TRUE(limited.step(frame, {1'000'000, 1'000'000}));
            for (size_t c = 0; c < 2; ++c)
                ASSERT_EQ(limited.statistics()[c].byCause, unlimited.statistics()[c].byCause) << "frame " << frame;
        }
    }
}

TEST(ShadowCache, NearestUnknownTexelsComeFirst) {
    Life life(10, glm::dvec3(0), cache::Sabotage::kNone);
    life.step(0, {400, cache::Limits::kNone});
    // Nothing of the far cascade yet, and of the near one what surrounds the eye.
    EXPECT_EQ(life.statistics()[0].total.texels, 400u);
    EXPECT_EQ(life.statistics()[1].total.texels, 0u);
    const cache::TexelRect window = life.cache().window(0);
    for (const cache::OwedRegion& r : life.cache().owed(0))
        EXPECT_GT(cache::distance(r.rect, (window.min + window.max) / int64_t(2)), 2);
}

TEST(ShadowCache, SleepersCostNothingAndCatchUp) {
    Life life(11, glm::dvec3(0), cache::Sabotage::kNone);
    bool owed = false, slept = false;
    for (int frame = 0; frame < 200; ++frame) {
        const uint32_t asleep = frame / 7 % 2 ? 1 + uint32_t(frame) / 14 % 2 : 0;  // one or the other, now and then
        ASSERT_TRUE(life.step(frame, {}, asleep)) << "frame " << frame;
        for (int c = 0; c < 2; ++c) {
            const cache::CascadeStatistics& s = life.statistics()[size_t(c)];
            EXPECT_EQ(s.asleep, bool(asleep >> c & 1));
            if (!s.asleep) {
                EXPECT_TRUE(life.cache().owed(c).empty());
                EXPECT_TRUE(life.cache().slept(c).empty());
                continue;
            }
            EXPECT_EQ(s.total, cache::Cost{});
            EXPECT_EQ(s.active, cache::Cost{});
            owed |= !life.cache().owed(c).empty();
            slept |= !life.cache().slept(c).empty();
        }
    }
    EXPECT_TRUE(owed);
    EXPECT_TRUE(slept);
}

TEST(ShadowCache, DepthsFollowTheEyeAShareInEachFrame) {
    for (const cache::Limits limits : {cache::Limits{}, cache::Limits{900, 20000}}) {
        Life life(12, glm::dvec3(1e5, 0, 0), cache::Sabotage::kNone, 1, Depths::kSpareMaps);
        int moved = 0, swapped = 0;
        for (int frame = 0; frame < (limits.limited() ? 150 : 400); ++frame) {
            // Slow enough for the spare maps to be whole in time: an eighth of 24 m in 60 frames.
            const double climb = frame < 200 ? 0.045 : -0.045;
            const cache::DepthRange before = life.cache().depth(0);
            const size_t map = life.cache().map(0);
            ASSERT_TRUE(life.step(frame, limits, 0, climb)) << "frame " << frame << ", " << limits.texels << " texels";
            moved += frame > 0 && life.cache().depth(0) != before;
            swapped += life.cache().map(0) != map;
            ASSERT_LE(drawnIn(life.statistics(), &cache::Cost::texels), limits.texels);
            ASSERT_LE(drawnIn(life.statistics(), &cache::Cost::triangles), limits.triangles);
            for (const cache::CascadeStatistics& s : life.statistics()) {
                ASSERT_EQ(sumOverCauses(s), s.total);
                const uint64_t rebase = s.byCause[size_t(Cause::kRebase)].texels;
                ASSERT_LE(rebase, s.total.texels - rebase + kSide * kSide / 50) << "not spread over frames";
            }
        }
        if (limits.limited()) continue;  // what is left of a limit may not do in time
        EXPECT_GT(moved, 0);
        EXPECT_EQ(swapped, moved);
    }
}

TEST(ShadowCache, ARangeThatIsLeftIsRedrawnAtOnce) {
    Life life(13, glm::dvec3(0), cache::Sabotage::kNone, 1, Depths::kForced);
    uint64_t most = 0;
    for (int frame = 0; frame < 200; ++frame) {
        ASSERT_TRUE(life.step(frame)) << "frame " << frame;
        most = std::max(most, life.statistics()[0].byCause[size_t(Cause::kRebase)].texels);
    }
    EXPECT_EQ(most, uint64_t(kSide * kSide));
}

TEST(ShadowCache, DefectsAreSeen) {
    for (cache::Sabotage sabotage : {cache::Sabotage::kLiteralScroll, cache::Sabotage::kDeafDeparture,
                                     cache::Sabotage::kForgottenDebt, cache::Sabotage::kUnknownAsEmpty,
                                     cache::Sabotage::kSleptMotion, cache::Sabotage::kKeptDepths}) {
        const Depths depths = sabotage == cache::Sabotage::kKeptDepths ? Depths::kForced : Depths::kFixed;
        Life life(5, glm::dvec3(0), sabotage, 1, depths);
        const bool limited = sabotage == cache::Sabotage::kForgottenDebt || sabotage == cache::Sabotage::kUnknownAsEmpty;
        bool caught = false;
        for (int frame = 0; frame < 250 && !caught; ++frame)
            caught = !life.step(frame, {limited ? 500 : cache::Limits::kNone, cache::Limits::kNone},
                                sabotage == cache::Sabotage::kSleptMotion ? uint32_t(frame / 5 % 2) : 0);
        EXPECT_TRUE(caught) << "sabotage " << int(sabotage);
    }
}

TEST(ShadowCache, AnEmptySceneIsDrawnOnceAsEmpty) {
    const std::vector<culling::Cascade> cascades{{3.0, 0.15}};
    ToyScene scene(glm::dvec3(0, -1, 0), cascades);
    cache::ShadowCache cache(cascades, {.side = kSide});
    cache::FramePlan plan;
    plan.reset(1);
    std::vector<cache::CascadeStatistics> statistics;
    cache.plan(scene.view(), {}, {}, plan, statistics);
    EXPECT_EQ(statistics[0].total.texels, uint64_t(kSide * kSide));
    EXPECT_EQ(statistics[0].total.triangles, 0u);
    plan.reset(1);
    cache.plan(scene.view(), {}, {}, plan, statistics);
    EXPECT_TRUE(plan.idle());
}

}  // namespace
