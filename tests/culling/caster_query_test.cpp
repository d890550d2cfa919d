// Caster queries and light-space bounds against brute force.
#include "culling/caster_query.h"

#include <gtest/gtest.h>

#include <random>

#include "tests/toy_scene.h"

namespace {

TEST(CasterQuery, FindsExactlyTheCastersOverTheRectangle) {
    std::mt19937 rng(4);
    std::uniform_real_distribution<double> place(-80, 80), edge(0, 30);
    for (glm::dvec3 origin : {glm::dvec3(0), glm::dvec3(1e6, 0, -1e6)}) {
        tests::ToyScene scene(glm::dvec3(0.5, -0.4, 0.2), {{20, 0.1}}, 100);
        const auto slot = scene.addMesh(tests::boxMesh({3, 1, 2}));
        for (int i = 0; i < 300; ++i)
            scene.addStatic(slot, tests::placedAt(origin + glm::dvec3(place(rng), place(rng), place(rng))));
        std::vector<world::CasterId> found;
        for (int step = 0; step < 200; ++step) {
            const glm::dvec2 centre(scene.light.space().toLight(origin));
            const glm::dvec2 min = centre + glm::dvec2(place(rng), place(rng)), max = min + edge(rng);
            culling::castersOver(scene.statics, scene.light, min, max, found);
            std::vector<world::CasterId> truth;
            for (world::CasterId id = 0; id < scene.table.slots(); ++id) {
                const world::Box& b = scene.light[id].bounds;
                if (b.min.x <= max.x && b.max.x >= min.x && b.min.y <= max.y && b.max.y >= min.y) truth.push_back(id);
            }
            ASSERT_EQ(found, truth) << "step " << step;
        }
    }
}

TEST(LightCasters, DropsWhatIsSmallerThanAskedAndNothingElse) {
    const std::vector<culling::Cascade> cascades{{10, 0.1}, {100, 1}};
    culling::LightCasters light(culling::makeLightSpace({0, -1, 0}).value(), cascades, {.smallestTexels = 2});
    world::CasterTable table;
    const world::Mesh box = tests::boxMesh({1, 1, 1});
    const world::MeshSlot slot = table.addMesh(box);
    for (const auto& [scale, near, far] : {std::tuple(0.19, false, false), {0.21, true, false}, {1.9, true, false}, {2.1, true, true}}) {
        const world::CasterId id = table.add(slot, tests::placedAt({5, 5, 5}, scale), world::CasterState::kStatic, {});
        for (const bool active : {false, true}) {
            active ? light.addActive(id, table) : light.addStatic(id, table);
            EXPECT_EQ(light.drawn(id, 0), near) << scale;
            EXPECT_EQ(light.drawn(id, 1), far) << scale;
            EXPECT_EQ(light.rects(id, 1).empty(), !far);
        }
    }
}

TEST(LightCasters, RectanglesHoldEveryVertex) {
    std::mt19937 rng(9);
    std::uniform_real_distribution<double> any(-2, 2);
    tests::ToyScene scene(glm::dvec3(0.1, -1, 0.7), {{20, 0.1}});
    const auto slot = scene.addMesh(tests::sheetMesh(40, 30));
    for (int step = 0; step < 20; ++step) {
        world::Placement placement = tests::placedAt(glm::dvec3(any(rng), any(rng), any(rng)) * 1e5);
        for (int c = 0; c < 3; ++c)
            for (int r = 0; r < 3; ++r) placement.linear[c][r] = float(any(rng));  // sheared, mirrored
        for (const auto id : {scene.addStatic(slot, placement), scene.addActive(slot, placement)}) {
            const culling::LightCaster& caster = scene.light[id];
            const world::MeshLevel& level = scene.meshes.back().levels[0];
            for (size_t k = 0; k < level.clusters.size(); ++k)
                for (uint32_t i = 0; i < level.clusters[k].indexCount; ++i) {
                    const glm::dvec3 p(level.positions[level.indices[level.clusters[k].firstIndex + i]]);
                    const glm::dvec3 q = caster.lightFromMesh * p;
                    const culling::ClusterRect& r = scene.light.rects(id, 0)[k];
                    // Turned boxes are rounded in doubles: a nanometre of room.
                    ASSERT_GE(q.x, r.min.x - 1e-9);
                    ASSERT_LE(q.x, r.max.x + 1e-9);
                    ASSERT_GE(q.y, r.min.y - 1e-9);
                    ASSERT_LE(q.y, r.max.y + 1e-9);
                }
        }
    }
}

TEST(LightCasters, EachCascadeDrawsTheCoarsestLevelThatItsTexelForgives) {
    tests::ToyScene scene(glm::dvec3(0, -1, 0), {{3, 0.1}, {9, 0.4}, {27, 10}});
    world::Mesh mesh = tests::boxMesh({1, 1, 1});
    for (float error : {0.15f, 3.0f}) {
        mesh.levels.push_back(mesh.levels[0]);
        mesh.levels.back().error = error;
    }
    const auto slot = scene.addMesh(std::move(mesh));
    const auto levels = [&](double scale) {
        const auto id = scene.addStatic(slot, tests::placedAt(glm::dvec3(0), scale));
        return std::vector<int>{scene.light.level(id, 0), scene.light.level(id, 1), scene.light.level(id, 2)};
    };
    EXPECT_EQ(levels(1), (std::vector<int>{0, 1, 2}));
    EXPECT_EQ(levels(2), (std::vector<int>{0, 0, 1}));  // twice the size, twice the error
}

}  // namespace
