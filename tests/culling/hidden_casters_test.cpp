// tests/culling/hidden_casters_test.cpp — casters that are proven hidden own no texel, and nothing beside the map counts.
#include "culling/hidden_casters.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>

#include "tests/culling/hidden_layers.h"

namespace {

using culling::HiddenCasters;
using culling::MapTexels;
using tests::HiddenLayers;
using tests::ToyScene;
using world::CasterId;

using Ids = std::vector<CasterId>;

culling::ProvenHidden provenIn(const ToyScene& scene, const MapTexels& map, const Ids& ids, uint32_t rays = 4096) {
    return culling::provenHidden(scene.table, scene.light, map, ids, scene.statics, {rays, 100, map.side});
}
HiddenCasters proven(const ToyScene& scene, const MapTexels& map, const Ids& ids, uint32_t rays = 4096) {
    return provenIn(scene, map, ids, rays).whole;
}

TEST(ProvenHidden, OwnNoTexelWhateverTheOrderAndTheThreads) {
    size_t found = 0;
    for (uint32_t seed = 1; seed <= 10; ++seed) {
        const HiddenLayers layers(seed);
        const HiddenCasters hidden = proven(layers.scene, layers.map, layers.ids);
        const Ids owners = culling::ownersOf(layers.scene.table, layers.scene.light, layers.map, layers.ids);
        for (const CasterId id : hidden.casters)
            EXPECT_FALSE(std::binary_search(owners.begin(), owners.end(), id)) << "caster " << id << ", seed " << seed;
        found += hidden.casters.size();

        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, seed % 3 + 1);
        HiddenCasters again = proven(layers.scene, layers.map, Ids(layers.ids.rbegin(), layers.ids.rend()));
        std::reverse(again.casters.begin(), again.casters.end());
        EXPECT_EQ(again.casters, hidden.casters) << "seed " << seed;
        EXPECT_EQ(again.rays, hidden.rays);
    }
    EXPECT_GT(found, 100u);
}

TEST(ProvenHidden, AreHiddenByEveryClusterThatMeetsTheMap) {
    ToyScene scene = tests::sceneUnder({0, -1, 0});
    const MapTexels map = tests::mapAround(scene, glm::dvec3(0));  // from -4.8 to 4.8 m
    const auto roof = scene.addMesh(tests::sheetMesh(3, 4)), box = scene.addMesh(tests::boxMesh({1, 1, 1}));
    // 16 m of ground in clusters of 128 triangles; a box under a roof, two boxes in the open.
    const CasterId ground = scene.addStatic(scene.addMesh(tests::sheetMesh(16, 32)), tests::placedAt({0, -2, 0}));
    // A box turned a little, or every face along the light has an unbounded slope, and is drawn.
    world::Placement turned = tests::placedAt({0, 0, 0});
    turned.linear = glm::mat3(glm::mat3_cast(glm::angleAxis(0.3, glm::normalize(glm::dvec3(1, 0, 0.5)))));
    const CasterId under = scene.addStatic(box, turned);
    turned.translation = {3, 0, 3};
    const CasterId open = scene.addStatic(box, turned);
    turned.translation = {9, 0, 0};  // beside the map, and in the open
    const CasterId beside = scene.addStatic(box, turned);
    const CasterId cover = scene.addStatic(roof, tests::placedAt({0, 5, 0}));
    const Ids all{ground, under, open, beside, cover};
    EXPECT_EQ(proven(scene, map, all).casters, (Ids{under, beside})) << "what the map does not show need not be drawn";
    const auto clusters = provenIn(scene, map, all).clusters;
    EXPECT_TRUE(std::is_sorted(clusters.begin(), clusters.end()));
    EXPECT_EQ(clusters, (std::vector<std::pair<CasterId, uint32_t>>{{under, 0}})) << "the only one that meets the map";
    EXPECT_EQ(proven(scene, map, all, 16).casters, Ids{beside}) << "a footprint of more texels than are allowed is drawn";
    EXPECT_TRUE(proven(scene, map, {}).casters.empty());
    // On the map's border, under a roof of two parts, one of which lies beside the map: all of a cluster must be hidden.
    turned.translation = {4.7, 0, -3};
    const CasterId border = scene.addStatic(box, turned);
    scene.addStatic(roof, tests::placedAt({3.513, 5, -3.017}));
    EXPECT_EQ(proven(scene, map, {border}).casters, Ids{});
    scene.addStatic(roof, tests::placedAt({6.413, 5, -3.017}));
    EXPECT_EQ(proven(scene, map, {border}).casters, Ids{border});
    // A larger roof: of the ground's clusters those that meet the map are hidden, the others are not asked about.
    scene.addStatic(scene.addMesh(tests::sheetMesh(30, 4)), tests::placedAt({0, 6, 0}));
    EXPECT_EQ(proven(scene, map, all).casters, (Ids{ground, under, open, beside, cover}));
}

}  // namespace
