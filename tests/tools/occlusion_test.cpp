// tests/tools/occlusion_test.cpp — what leaving casters out as hidden comes to on a small world: proof breaks nothing, few
// rays break more than many, and counters do not depend on threads.
#include "tools/lab/occlusion.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include "tests/server/worlds.h"
#include "tests/world/random_world.h"

namespace {

using tools::lab::OcclusionRecord;

/// Streets of boxes under roofs, and in the air a sheet of 3.4 m under four others, which leave a hole of 0.15 m between them
/// that few of 64 rays would find.
world::BakeSource streetsAndAHole() {
    world::BakeSource source = tests::streets({0, 0, 0});
    source.meshes[2] = tests::sheetMesh(18, 32);  // ground in clusters that are smaller than roofs
    source.meshes.push_back(tests::sheetMesh(3.4f, 8));
    source.meshes.push_back(tests::sheetMesh(6.1f, 8));  // they overlap by 0.05 m
    for (world::Mesh& mesh : source.meshes) mesh.levels[0].clusters.clear();
    source.make = [make = source.make](world::ChunkKey key) {
        auto chunk = make(key);
        if (key != world::ChunkKey{0, 0, 1}) return chunk;
        const auto add = [&](uint32_t mesh, glm::dvec3 from) {
            chunk.value().instances.push_back({mesh, tests::placedAt(glm::dvec3(8, 8, 20) + from)});
            chunk.value().names.push_back("");
        };
        add(4, {0, 0, 0});
        const double near = 2.9, far = 3.075 + 0.05;
        add(5, {near, 1, far});
        add(5, {far, 1.05, -near});
        add(5, {-near, 1.1, -far});
        add(5, {-far, 1.15, near});
        return chunk;
    };
    return source;
}

struct Studied {
    std::vector<OcclusionRecord> records;
    tools::lab::MethodResult redrawn;  ///< the same maps, by the engine that methods have
};

/// With so many threads, from nothing.
Studied studiedWith(size_t threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    const world::WorldStore store = tests::baked(streetsAndAHole(), "occlusion.world");
    std::vector<world::Pose> path;
    for (int k = 0; k < 5; ++k)
        path.push_back({k / 10.0, {-6 + 3.0 * k, 4, 20}, glm::angleAxis(-0.3, glm::dvec3(1, 0, 0))});
    // A box that moves hides nothing and is drawn in all maps.
    const std::vector<world::MoverTrack> movers{
        {"box (0,0,0) 1", {{0, {1, 4, 12}, glm::dquat(1, 0, 0, 0), 1}, {1, {9, 4, 12}, glm::dquat(1, 0, 0, 0), 1}}}};
    const auto light = culling::makeLightSpace(store.header().sun).value();
    auto scene = tools::lab::Scene::load(store, path, 120, light, movers);
    if (!scene) throw std::runtime_error(scene.error().what);
    const tools::lab::Setting setting{tests::validatedDevice(), store, scene.value(), movers, light, 120, glm::radians(60.0)};
    tools::lab::RunConfig config;
    config.width = 160;
    config.height = 90;
    const world_tests::TempFolder folder;
    auto kept = tools::TruthStore::open(folder.file("occlusion.truth"));
    EXPECT_TRUE(kept);
    const auto truth = tools::lab::traceTruth(setting, path, tools::lab::judgedFrames(path.size(), 2), config, kept.value(),
                                              [](size_t, size_t) {});
    if (!truth) throw std::runtime_error(truth.error().what);
    culling::ShadowMethod method = culling::methodNamed("gnomon").value();
    method.side = 256;
    method.keep = culling::Keep::kNothing;
    size_t frames = 0;
    auto records = tools::lab::studyOcclusion(setting, path, truth.value(), method, [&](size_t done, size_t total) {
        EXPECT_EQ(done, ++frames);
        EXPECT_EQ(total, 4u);
    });
    EXPECT_EQ(frames, 4u);
    tests::expectSilence();
    auto redrawn = tools::lab::judgeMethod(setting, path, truth.value(), method, [](size_t, size_t) {});
    tests::expectSilence();
    if (!records || !redrawn) throw std::runtime_error(records ? redrawn.error().what : records.error().what);
    return {std::move(records.value()), std::move(redrawn.value())};
}

TEST(OcclusionStudy, ProofBreaksNothingAndFewRaysBreakMoreThanMany) {
    const auto [records, redrawn] = studiedWith(2);
    ASSERT_EQ(records.size(), 7u);
    const OcclusionRecord &drawn = records[0], &one = records[1], &many = records[4], &proof = records[5], &clusters = records[6];
    EXPECT_EQ(drawn.way, "all drawn");
    EXPECT_EQ(one.way, "1 ray");
    EXPECT_EQ(many.way, "64 rays");
    EXPECT_EQ(proof.way, "texel-exact");
    for (const OcclusionRecord& r : records) {
        EXPECT_EQ(r.judged, 4u);
        EXPECT_EQ(r.asked, drawn.asked);
        EXPECT_EQ(r.pixels, drawn.pixels);
        EXPECT_EQ(r.texels, 4u * 4 * 256 * 256) << "four maps in four frames";
        EXPECT_LE(r.wronglyHidden, r.hidden);
        EXPECT_GE(r.falseLit, drawn.falseLit) << r.way << ": who is missing shades nothing";
        EXPECT_LE(r.falseShadow, drawn.falseShadow) << r.way;
        EXPECT_EQ(r.texelsWrong > 0, r.deepest > 0) << r.way;
    }
    EXPECT_EQ(drawn.triangles, redrawn.cost.triangles);
    EXPECT_EQ(drawn.pixels, redrawn.measures.pixels);
    EXPECT_EQ(drawn.falseLit, redrawn.measures.falseLit.all());
    EXPECT_EQ(drawn.falseShadow, redrawn.measures.falseShadow.all());
    EXPECT_EQ(drawn.hidden + drawn.rays + drawn.texelsWrong, 0u);

    EXPECT_GT(proof.hidden, 0u) << "nothing was proven: a judge that is blind";
    EXPECT_LT(proof.triangles, drawn.triangles);
    for (const OcclusionRecord* r : {&proof, &clusters}) {
        EXPECT_EQ(r->wronglyHidden, 0u) << r->way;
        EXPECT_EQ(r->texelsWrong, 0u) << r->way;
        EXPECT_EQ(r->falseLit, drawn.falseLit) << r->way;
        EXPECT_EQ(r->hidden, proof.hidden) << r->way;
    }
    EXPECT_EQ(clusters.way, "by cluster");
    EXPECT_LT(clusters.triangles, proof.triangles) << "ground under roofs is hidden in part";

    for (size_t w = 2; w <= 4; ++w) {
        const OcclusionRecord &few = records[w - 1], &more = records[w];
        EXPECT_LE(more.hidden, few.hidden) << more.way;
        EXPECT_LE(more.wronglyHidden, few.wronglyHidden) << more.way;
        EXPECT_GE(more.triangles, few.triangles) << more.way;
        EXPECT_GT(more.rays, few.rays) << more.way;
    }
    EXPECT_GT(many.wronglyHidden, 0u) << "else proof could not be told from 64 rays";
    EXPECT_GT(many.texelsWrong, 0u);
    EXPECT_GT(one.wronglyHidden, many.wronglyHidden);
    EXPECT_GT(one.texelsWrong, many.texelsWrong);
    EXPECT_GT(one.falseLit, drawn.falseLit);
    EXPECT_LT(one.triangles, proof.triangles);
}

TEST(OcclusionStudy, CountersDoNotDependOnThreads) {
    std::vector<OcclusionRecord> one = studiedWith(1).records, two = studiedWith(2).records;
    for (std::vector<OcclusionRecord>* records : {&one, &two})
        for (OcclusionRecord& r : *records) r.ms = r.prepareMs = 0;
    EXPECT_EQ(one, two);
}

}  // namespace
