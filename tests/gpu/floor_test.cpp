#include "gpu/floor.h"

#include "scene.h"

namespace gpu::test {
namespace {

class FloorTest : public MapsTest, public testing::WithParamInterface<DepthFormat> {
protected:
    FloorTest() { config.format = GetParam(); }
    void makeFloor() {
        auto made = Floor::create(*device, config);
        ASSERT_TRUE(made) << made.error().what;
        floor = std::move(made.value());
    }
    void TearDown() override {
        floor.reset();
        MapsTest::TearDown();
    }
    double run(size_t prepared) {
        auto ms = floor->run(prepared);
        EXPECT_TRUE(ms) << ms.error().what;
        return ms ? ms.value() : 0;
    }

    std::unique_ptr<Floor> floor;
};

TEST_P(FloorTest, LeavesTheMapsOfTheRealThing) {
    const int side = 200, cascades = 2;
    makeMaps(side, cascades);
    makeFloor();
    std::mt19937 rng(59);
    std::vector<world::MeshLevel> levels{box(), triangleSoup(rng, 1), triangleSoup(rng, 30),
                                         triangleSoup(rng, 400)};
    std::vector<cache::GeometryId> ids;
    for (const world::MeshLevel& level : levels) ids.push_back(upload(level));
    const auto meshOf = [&](cache::GeometryId id) -> const world::MeshLevel& {
        return levels[static_cast<size_t>(std::find(ids.begin(), ids.end(), id) - ids.begin())];
    };
    std::vector<cache::FramePlan> plans;
    for (int step = 0; step < 12; ++step) {
        cache::FramePlan plan;
        plan.cascades.resize(cascades);
        for (cache::CascadePlan& cascade : plan.cascades) {
            if (rng() % 4 == 0) continue;
            std::vector<cache::StoreRect> pieces;
            shatter(rng, {glm::ivec2(0), glm::ivec2(side)}, 6, pieces);
            Scene scene = randomScene(rng, side, static_cast<int>(rng() % 80), 0.3, side, levels, ids);
            for (cache::DrawItem& item : scene.items)
                item.transform += static_cast<uint32_t>(plan.transforms.size());
            const auto first = static_cast<uint32_t>(plan.items.size());
            const auto count = static_cast<uint32_t>(scene.items.size());
            plan.items.insert(plan.items.end(), scene.items.begin(), scene.items.end());
            plan.transforms.insert(plan.transforms.end(), scene.transforms.begin(), scene.transforms.end());
            if (rng() % 3 == 0) cascade.unknowns = {pieces[1], pieces[2]};
            if (rng() % 3) cascade.clears = {pieces[0], pieces[1]};
            cascade.staticPasses = {
                {pieces[0], first, count / 2}, {pieces[1], first, count}, {pieces[2], 0, 0}};
            if (rng() % 2) cascade.restores = pieces;
            if (rng() % 2) cascade.activePasses = {{pieces[3], first, count}};
        }
        plans.push_back(plan);
        const auto prepared = floor->prepare(plan, meshOf);
        ASSERT_TRUE(prepared) << prepared.error().what;
        ASSERT_EQ(prepared.value(), static_cast<size_t>(step));
    }
    for (int step = 0; step < 30; ++step) {
        const size_t chosen = rng() % plans.size();
        execute(plans[chosen]);
        EXPECT_EQ(run(chosen) > 0, !plans[chosen].idle());
        for (int c = 0; c < cascades; ++c)
            for (const MapKind kind : {MapKind::kCache, MapKind::kWorking}) {
                auto depths = floor->read(c, kind);
                ASSERT_TRUE(depths) << depths.error().what;
                ASSERT_EQ(differing(depths.value(), read(kind, c)), 0u) << "step " << step;
            }
    }
    EXPECT_GT(covered(read(MapKind::kWorking)), 0.1);
    floor->discard();
    const auto again = floor->prepare(plans[0], meshOf);
    ASSERT_TRUE(again) << again.error().what;
    EXPECT_EQ(again.value(), 0u);
}

TEST_P(FloorTest, AnIdlePlanCostsNothing) {
    config.side = 16;
    makeFloor();
    const auto prepared =
        floor->prepare({}, [](cache::GeometryId) -> const world::MeshLevel& { std::abort(); });
    ASSERT_TRUE(prepared) << prepared.error().what;
    EXPECT_EQ(run(prepared.value()), 0);
}

INSTANTIATE_TEST_SUITE_P(Formats, FloorTest, testing::Values(DepthFormat::kD32, DepthFormat::kD16),
                         [](const auto& test) { return nameOf(test.param); });

}  // namespace
}  // namespace gpu::test
