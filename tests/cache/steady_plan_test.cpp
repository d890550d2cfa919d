// What a frame costs when nothing but the eye and the movers changes: no memory, and no more in a larger world.
#include <gtest/gtest.h>

#include <random>

#include "allocations.h"
#include "cache/shadow_cache.h"
#include "tests/toy_scene.h"

namespace {

constexpr int kMapSide = 256;

/// A field of boxes, 2 m apart, `edge` of them a side, and some that move in its middle.
struct Field {
    Field(int edge, int movers) : scene(glm::dvec3(0.4, -1, 0.3), {{10, 0.1}, {30, 0.3}}) {
        const auto box = scene.addMesh(tests::boxMesh({1, 2, 1}));
        for (int j = 0; j < edge; ++j)
            for (int i = 0; i < edge; ++i)
                scene.addStatic(box, tests::placedAt({2 * i - edge, 0, 2 * j - edge}));
        for (int m = 0; m < movers; ++m) scene.addActive(box, moverAt(m, 0));
    }
    static world::Placement moverAt(int mover, double time) {
        const double angle = mover + time;
        return tests::placedAt({mover % 5 * 3 + std::cos(angle), 0, mover / 5 * 3 + std::sin(angle)});
    }
    /// The frame at `time`, and what it allocated.
    uint64_t frame(double time) {
        dirt.clear();
        for (size_t m = 0; m < scene.active.size(); ++m) {
            const world::CasterId id = scene.active[m];
            dirt.push_back(scene.light[id].bounds);
            scene.table.place(id, moverAt(int(m), time));
            scene.light.addActive(id, scene.table);
            dirt.push_back(scene.light[id].bounds);
        }
        const glm::dvec3 eye(15 * std::sin(time), 0, 15 * std::cos(0.7 * time));
        const uint64_t before = tests::allocations();
        plan.reset(2);
        cache.plan(scene.view(), {{}, {}, dirt}, {.eye = scene.light.space().toLight(eye)}, plan, statistics);
        return tests::allocations() - before;
    }

    tests::ToyScene scene;
    cache::ShadowCache cache{scene.light.cascades(), {.side = kMapSide, .scene = {-100, 200}}};
    cache::FramePlan plan;
    std::vector<cache::CascadeStatistics> statistics;
    std::vector<world::Box> dirt;
};

TEST(SteadyPlan, AllocatesNothing) {
    for (const int movers : {0, 30}) {
        Field field(60, movers);
        uint64_t texels = 0, casters = 0;
        for (int k = 0; k < 400; ++k) field.frame(k / 30.0);  // each list has been as long as it gets
        for (int k = 0; k < 400; ++k) {
            ASSERT_EQ(field.frame(k / 30.0), 0u) << "frame " << k << " with " << movers << " movers";
            for (const auto& s : field.statistics) {
                texels += s.total.texels;
                casters += s.total.casters + s.active.casters;
            }
        }
        EXPECT_GT(texels, 100'000u);
        EXPECT_GT(casters, movers > 0 ? 10'000u : 1'000u);
    }
}

TEST(SteadyPlan, IsTheSameInALargerWorld) {
    Field small(120, 10), large(300, 10);  // both hold all that the windows can reach
    for (int k = 0; k < 200; ++k) {
        small.frame(k / 30.0);
        large.frame(k / 30.0);
        for (size_t c = 0; c < 2; ++c) {
            ASSERT_EQ(small.statistics[c].total, large.statistics[c].total) << "frame " << k;
            ASSERT_EQ(small.statistics[c].active, large.statistics[c].active) << "frame " << k;
        }
    }
}

}  // namespace
