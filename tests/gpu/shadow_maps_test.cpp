#include "gpu/shadow_maps.h"

#include <cstdlib>
#include <cstring>

#include "gpu/device_impl.h"
#include "scene.h"

namespace gpu::test {
namespace {

/// A rectangle of a map's plane in mesh coordinates that are texels, at a depth of its own.
struct Quad {
    glm::dvec2 min, max;
    double depth;
};

/// The square [0, 1]^2 at z = 1, so that a transform's depth row scales or shifts it.
world::MeshLevel unitQuad() {
    world::MeshLevel level;
    level.positions = {{0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}};
    level.indices = {0, 1, 2, 0, 2, 3};
    return level;
}

ToTexels placed(const Quad& q) {
    return {{q.max.x - q.min.x, 0, 0, q.min.x}, {0, q.max.y - q.min.y, 0, q.min.y}, {0, 0, 0, q.depth}};
}

/// What a caster at depth `d` of the transform's depth row leaves in a map.
float stored(double d) {
    return static_cast<float>(cache::kNearestDepth + (1.0 - cache::kNearestDepth) * std::clamp(d, 0.0, 1.0));
}

/// The dumb rasteriser: a texel is drawn when its centre is inside.
void drawOnCpu(std::vector<float>& depths, int side, const Quad& q) {
    const float depth = stored(q.depth);
    for (int y = 0; y < side; ++y)
        for (int x = 0; x < side; ++x) {
            const glm::dvec2 centre(x + 0.5, y + 0.5);
            if (glm::any(glm::lessThan(centre, q.min)) || glm::any(glm::greaterThan(centre, q.max))) continue;
            float& d = depths[static_cast<size_t>(y * side + x)];
            d = std::min(d, depth);
        }
}

class Maps : public MapsTest {
protected:
    /// What rounding may do to a depth: in the viewport's multiplication and addition, and to a unit of
    /// 16 bits.
    float slack() const {
        const float float32 = 0x1p-24f;
        return config.format == DepthFormat::kD16 ? 0.5f / 65535 + 2 * float32 : float32;
    }
    /// Texels that are off by more than rounding. Unknown and empty texels must be exact.
    size_t wrong(const std::vector<float>& depths, const std::vector<float>& expected) const {
        EXPECT_EQ(depths.size(), expected.size());
        size_t count = 0;
        for (size_t i = 0; i < std::min(depths.size(), expected.size()); ++i) {
            const bool drawn = expected[i] != cache::kUnknownDepth && expected[i] != cache::kEmptyDepth;
            count += drawn ? !(depths[i] >= cache::kNearestDepth && depths[i] < 1 &&
                               std::abs(depths[i] - expected[i]) <= slack())
                           : depths[i] != expected[i];
        }
        return count;
    }
    /// A plan for one cascade with nothing in it; add to `plan.cascades[0]`.
    cache::FramePlan emptyPlan(size_t cascades = 1) {
        cache::FramePlan plan;
        plan.cascades.resize(cascades);
        return plan;
    }
    /// Adds quads as items of one pass; corners have at most four binary places and depths eight, so
    /// that every number on the way to the rasteriser is exact.
    cache::DrawPass addPass(cache::FramePlan& plan, cache::GeometryId quad, int side,
                            const std::vector<Quad>& quads, cache::StoreRect scissor) {
        const cache::DrawPass pass{scissor, static_cast<uint32_t>(plan.items.size()),
                                   static_cast<uint32_t>(quads.size())};
        for (const Quad& q : quads) {
            plan.items.push_back({quad, 0, 6, static_cast<uint32_t>(plan.transforms.size())});
            plan.transforms.push_back(placed(q).toClip(side));
        }
        return pass;
    }
    static std::vector<Quad> randomQuads(std::mt19937& rng, int side, int count) {
        // Sixteenths, but never a half: on a texel's centre the tie rule would decide.
        const auto corner = [&] {
            const int whole = std::uniform_int_distribution<int>(-side / 4, side + side / 4)(rng);
            const int sixteenth = std::uniform_int_distribution<int>(0, 14)(rng);
            return whole + (sixteenth < 8 ? sixteenth : sixteenth + 1) / 16.0;
        };
        std::vector<Quad> quads;
        for (int i = 0; i < count; ++i) {
            const glm::dvec2 a(corner(), corner()), b(corner(), corner());
            const double depth = std::uniform_int_distribution<int>(-64, 320)(rng) / 256.0;
            quads.push_back({glm::min(a, b), glm::max(a, b), depth});
        }
        return quads;
    }
    static cache::StoreRect whole(int side) { return {glm::ivec2(0), glm::ivec2(side)}; }
};

class FormatMaps : public Maps, public testing::WithParamInterface<DepthFormat> {
protected:
    FormatMaps() { config.format = GetParam(); }
};

TEST_P(FormatMaps, NewOnesHoldDepthOneEverywhere) {
    makeMaps(16, 3);
    for (int c = 0; c < 3; ++c)
        for (const MapKind kind :
             {MapKind::kCache, MapKind::kWorking, MapKind::kScratchCache, MapKind::kScratchWorking})
            EXPECT_EQ(read(kind, c), std::vector<float>(16 * 16, 1.0f));
}

TEST_P(FormatMaps, EqualACpuRasterisationOfQuads) {
    const int side = 64;
    makeMaps(side);
    const cache::GeometryId quad = upload(unitQuad());
    std::mt19937 rng(17);
    for (int round = 0; round < 20; ++round) {
        const std::vector<Quad> quads = randomQuads(rng, side, 6);
        cache::FramePlan plan = emptyPlan();
        plan.cascades[0].clears = {whole(side)};
        plan.cascades[0].staticPasses = {addPass(plan, quad, side, quads, whole(side))};
        const GpuTimes times = execute(plan);
        EXPECT_TRUE(times.submitted);
        EXPECT_GT(times.wallMs, 0);
        std::vector<float> expected(side * side, 1.0f);
        for (const Quad& q : quads) drawOnCpu(expected, side, q);
        ASSERT_EQ(wrong(read(MapKind::kCache), expected), 0u) << "round " << round;
    }
}

TEST_P(FormatMaps, FollowARandomSequenceOfPlans) {
    const int side = 64;
    const size_t cascades = 3;
    makeMaps(side, cascades);
    const cache::GeometryId quad = upload(unitQuad());
    std::mt19937 rng(19);
    const auto randomRect = [&] {
        std::uniform_int_distribution<int> at(0, side);
        const glm::ivec2 a(at(rng), at(rng)), b(at(rng), at(rng));
        return cache::StoreRect{glm::min(a, b), glm::max(a, b)};  // may be empty
    };
    // The dumb maps, changed one texel at a time in the order that the plan promises.
    struct CpuMaps {
        std::vector<float> cacheMap = std::vector<float>(side * side, 1.0f), working = cacheMap;
    };
    std::vector<CpuMaps> expected(cascades);
    const auto eachTexel = [](const cache::StoreRect& r, const auto& body) {
        for (int y = r.min.y; y < r.max.y; ++y)
            for (int x = r.min.x; x < r.max.x; ++x) body(static_cast<size_t>(y * side + x));
    };
    const auto drawScissored = [&](std::vector<float>& map, const std::vector<Quad>& quads,
                                   const cache::StoreRect& scissor) {
        std::vector<float> all(side * side, 1.0f);
        for (const Quad& q : quads) drawOnCpu(all, side, q);
        eachTexel(scissor, [&](size_t t) { map[t] = std::min(map[t], all[t]); });
    };
    for (int step = 0; step < 80; ++step) {
        cache::FramePlan plan = emptyPlan(cascades);
        bool idle = true;
        for (size_t c = 0; c < cascades; ++c) {
            cache::CascadePlan& cascade = plan.cascades[c];
            CpuMaps& cpu = expected[c];
            if (rng() % 3 == 0) continue;
            for (uint32_t i = rng() % 3; i > 0; --i) {
                cascade.unknowns.push_back(randomRect());
                eachTexel(cascade.unknowns.back(), [&](size_t t) { cpu.cacheMap[t] = 0; });
            }
            for (uint32_t i = rng() % 3; i > 0; --i) {
                cascade.clears.push_back(randomRect());
                eachTexel(cascade.clears.back(), [&](size_t t) { cpu.cacheMap[t] = 1; });
            }
            for (uint32_t i = rng() % 3; i > 0; --i) {
                const std::vector<Quad> quads = randomQuads(rng, side, static_cast<int>(rng() % 3));
                const cache::StoreRect scissor = randomRect();
                cascade.staticPasses.push_back(addPass(plan, quad, side, quads, scissor));
                drawScissored(cpu.cacheMap, quads, scissor);
            }
            if (rng() % 2) {  // disjoint: two halves of a rectangle
                cache::StoreRect low = randomRect(), high = low;
                low.max.x = high.min.x = (low.min.x + low.max.x) / 2;
                cascade.restores = {low, high};
                for (const cache::StoreRect& r : cascade.restores)
                    eachTexel(r, [&](size_t t) { cpu.working[t] = cpu.cacheMap[t]; });
            }
            for (uint32_t i = rng() % 2; i > 0; --i) {
                const std::vector<Quad> quads = randomQuads(rng, side, 2);
                const cache::StoreRect scissor = randomRect();
                cascade.activePasses.push_back(addPass(plan, quad, side, quads, scissor));
                drawScissored(cpu.working, quads, scissor);
            }
            idle = idle && cascade.idle();
        }
        const GpuTimes times = execute(plan);
        ASSERT_EQ(times.submitted, !idle);
        ASSERT_EQ(times.cascades.size(), cascades);
        for (size_t c = 0; c < cascades; ++c) {
            const int cascade = static_cast<int>(c);
            ASSERT_EQ(wrong(read(MapKind::kCache, cascade), expected[c].cacheMap), 0u) << "step " << step;
            ASSERT_EQ(wrong(read(MapKind::kWorking, cascade), expected[c].working), 0u) << "step " << step;
        }
    }
}

TEST_P(FormatMaps, RestoresCopyTheirRectanglesAndNothingElse) {
    const int side = 128;
    makeMaps(side);
    std::mt19937 rng(23);
    const world::MeshLevel soup = triangleSoup(rng, 200);
    const cache::GeometryId id = upload(soup);
    execute(randomScene(rng, side, 30, 0.3, side, {soup}, {id}).whole());
    const std::vector<float> source = read(MapKind::kCache);
    ASSERT_GT(covered(source), 0.2);

    std::vector<cache::StoreRect> pieces;
    shatter(rng, whole(side), 200, pieces);
    cache::FramePlan plan = emptyPlan();
    std::vector<float> expected(side * side, 1.0f);
    for (size_t i = 0; i < pieces.size(); i += 2) {
        plan.cascades[0].restores.push_back(pieces[i]);
        for (int y = pieces[i].min.y; y < pieces[i].max.y; ++y)
            for (int x = pieces[i].min.x; x < pieces[i].max.x; ++x) {
                const size_t t = static_cast<size_t>(y * side + x);
                expected[t] = source[t];
            }
    }
    execute(plan);
    EXPECT_EQ(differing(read(MapKind::kWorking), expected), 0u);
    EXPECT_EQ(differing(read(MapKind::kCache), source), 0u);
}

TEST_P(FormatMaps, ClampDepthTowardTheSunAndDropWhatLiesBeyond) {
    const int side = 32;
    makeMaps(side);
    const cache::GeometryId quad = upload(unitQuad());
    const auto draw = [&](const ToTexels& m) {
        cache::FramePlan plan = emptyPlan();
        plan.cascades[0].clears = {whole(side)};
        plan.transforms = {m.toClip(side)};
        plan.items = {{quad, 0, 6, 0}};
        plan.cascades[0].staticPasses = {{whole(side), 0, 1}};
        execute(plan);
        return read(MapKind::kCache);
    };
    const Quad everywhere{glm::dvec2(-1), glm::dvec2(side + 1), 0};
    for (const double depth : {-1e-3, -0.5, -7.0, -1e4}) {
        ToTexels m = placed(everywhere);
        m.depth.w = depth;
        EXPECT_EQ(draw(m), std::vector<float>(side * side, cache::kNearestDepth)) << depth;
    }
    for (const double depth : {1.0, 1.001, 3.0, 1e4}) {
        ToTexels m = placed(everywhere);
        m.depth.w = depth;
        EXPECT_EQ(draw(m), std::vector<float>(side * side, 1.0f)) << depth;
    }
    // A slope from -1 to 2 across the map: each column clamped on its own.
    ToTexels slope = placed({glm::dvec2(0), glm::dvec2(side), 0});
    slope.depth = {3, 0, 0, -1};
    const std::vector<float> depths = draw(slope);
    for (int x = 0; x < side; ++x) {
        const float depth = depths[static_cast<size_t>(x)];
        // The rasteriser interpolates in float from a corner: a few units in the last place of 2.
        EXPECT_NEAR(depth, stored(3 * (x + 0.5) / side - 1), 1e-6f + slack()) << "column " << x;
        EXPECT_GE(depth, cache::kNearestDepth) << "column " << x;
    }
}

TEST_P(FormatMaps, UnknownStaysUnknownUntilCleared) {
    const int side = 64;
    makeMaps(side);
    const cache::GeometryId quad = upload(unitQuad());
    const cache::StoreRect hole{{8, 16}, {40, 48}};
    const std::vector<Quad> everywhere{{glm::dvec2(-1), glm::dvec2(side + 1), -3},
                                       {glm::dvec2(-1), glm::dvec2(side + 1), 0.5}};
    const auto expected = [&](float inside, float outside) {
        std::vector<float> map(side * side, outside);
        for (int y = hole.min.y; y < hole.max.y; ++y)
            for (int x = hole.min.x; x < hole.max.x; ++x) map[static_cast<size_t>(y * side + x)] = inside;
        return map;
    };
    cache::FramePlan plan = emptyPlan();
    plan.cascades[0].unknowns = {hole};
    plan.cascades[0].restores = {whole(side)};
    EXPECT_FALSE(plan.idle());
    execute(plan);
    EXPECT_EQ(read(MapKind::kCache), expected(cache::kUnknownDepth, cache::kEmptyDepth));
    EXPECT_EQ(read(MapKind::kWorking), expected(cache::kUnknownDepth, cache::kEmptyDepth));

    for (int round = 0; round < 3; ++round) {
        plan = emptyPlan();
        plan.cascades[0].staticPasses = {addPass(plan, quad, side, everywhere, whole(side))};
        plan.cascades[0].restores = {whole(side)};
        plan.cascades[0].activePasses = {addPass(plan, quad, side, everywhere, whole(side))};
        execute(plan);
        EXPECT_EQ(read(MapKind::kCache), expected(cache::kUnknownDepth, cache::kNearestDepth));
        EXPECT_EQ(read(MapKind::kWorking), expected(cache::kUnknownDepth, cache::kNearestDepth));
    }
    // A clear in the same plan comes after: it makes known.
    plan = emptyPlan();
    plan.cascades[0].unknowns = {whole(side)};
    plan.cascades[0].clears = {hole};
    plan.cascades[0].staticPasses = {addPass(plan, quad, side, everywhere, whole(side))};
    execute(plan);
    EXPECT_EQ(read(MapKind::kCache), expected(cache::kNearestDepth, cache::kUnknownDepth));
}

TEST_F(Maps, AnIdlePlanSubmitsNothing) {
    makeMaps(32, 2);
    for (const size_t cascades : {0, 1, 2}) {
        const uint64_t before = maps->uploadedBytes();
        const GpuTimes times = execute(emptyPlan(cascades));
        EXPECT_FALSE(times.submitted);
        EXPECT_EQ(times.wallMs, 0);
        EXPECT_EQ(times.cascades.size(), 2u);
        EXPECT_EQ(maps->uploadedBytes(), before);
    }
}

TEST_F(Maps, AnIdleCascadeCostsNoTime) {
    makeMaps(32, 2);
    cache::FramePlan plan = emptyPlan(2);
    plan.cascades[1].clears = {whole(32)};
    plan.cascades[1].restores = {whole(32)};
    const GpuTimes times = execute(plan);
    EXPECT_TRUE(times.submitted);
    EXPECT_EQ(times.cascades[0].staticMs, 0);
    EXPECT_EQ(times.cascades[0].activeMs, 0);
    EXPECT_GE(times.cascades[1].staticMs, 0);
    EXPECT_LT(times.cascades[1].staticMs, times.wallMs + 1);
}

TEST_F(Maps, WithoutTimestampsOnlyTheWholeIsTimed) {
    config.timestamps = false;
    makeMaps(32);
    cache::FramePlan plan = emptyPlan();
    plan.cascades[0].clears = {whole(32)};
    plan.cascades[0].restores = {whole(32)};
    const GpuTimes times = execute(plan);
    EXPECT_GT(times.wallMs, 0);
    EXPECT_GT(times.recordMs, 0);
    ASSERT_EQ(times.cascades.size(), 1u);
    EXPECT_EQ(times.cascades[0].staticMs, 0);
    EXPECT_EQ(times.cascades[0].activeMs, 0);
}

TEST_F(Maps, RedrawLeavesTheRealMapsAlone) {
    const int side = 32;
    makeMaps(side);
    const cache::GeometryId quad = upload(unitQuad());
    cache::FramePlan plan = emptyPlan();
    plan.cascades[0].staticPasses = {addPass(plan, quad, side, {{{0, 0}, {8, 8}, 0.5}}, whole(side))};
    redraw(plan);
    EXPECT_EQ(read(MapKind::kCache), std::vector<float>(side * side, 1.0f));
    EXPECT_EQ(covered(read(MapKind::kScratchCache)), 1.0 / 16);
    // Without a clear the scratch map keeps what it held.
    plan = emptyPlan();
    plan.cascades[0].staticPasses = {addPass(plan, quad, side, {{{8, 0}, {16, 8}, 0.5}}, whole(side))};
    redraw(plan);
    EXPECT_EQ(covered(read(MapKind::kScratchCache)), 2.0 / 16);
}

TEST_F(Maps, ManyDrawsAreSplitAsTheDeviceWants) {
    const int side = 64;
    makeMaps(side);
    std::mt19937 rng(29);
    std::vector<world::MeshLevel> levels;
    std::vector<cache::GeometryId> ids;
    for (int i = 0; i < 40; ++i) {
        levels.push_back(triangleSoup(rng, 3));
        ids.push_back(upload(levels.back()));
    }
    const Scene scene = randomScene(rng, side, 300, 0.3, 30, levels, ids);
    execute(scene.whole());
    const uint32_t limit = std::exchange(device->impl().maxIndirectDraws, 7);
    redraw(scene.whole());
    device->impl().maxIndirectDraws = limit;
    EXPECT_GT(covered(read(MapKind::kCache)), 0.5);
    EXPECT_EQ(differing(read(MapKind::kScratchCache), read(MapKind::kCache)), 0u);
}

TEST_F(Maps, BuffersGrowWithThePlanAndServeSmallOnesAfterwards) {
    const int side = 64;
    makeMaps(side);
    const cache::GeometryId quad = upload(unitQuad());
    std::mt19937 rng(31);
    for (const int count : {1, 5000, 20, 40000, 3}) {
        cache::FramePlan plan = emptyPlan();
        plan.cascades[0].clears = {whole(side)};
        const std::vector<Quad> quads = randomQuads(rng, side, count);
        const uint64_t before = maps->uploadedBytes();
        plan.cascades[0].staticPasses = {addPass(plan, quad, side, quads, whole(side))};
        execute(plan);
        // One instanced draw: rows per item, and one command.
        EXPECT_EQ(maps->uploadedBytes() - before, quads.size() * 48 + 20);
        std::vector<float> expected(side * side, 1.0f);
        for (const Quad& q : quads) drawOnCpu(expected, side, q);
        ASSERT_EQ(wrong(read(MapKind::kCache), expected), 0u) << count;
    }
}

TEST_F(Maps, MoreThanTheDeviceTakesIsRefused) {
    const int side = 16;
    makeMaps(side);
    const cache::GeometryId quad = upload(unitQuad());
    cache::FramePlan plan = emptyPlan();
    plan.cascades[0].staticPasses = {
        addPass(plan, quad, side, std::vector<Quad>(3000, {{0, 0}, {4, 4}, 0.5}), whole(side))};
    const uint64_t limit = std::exchange(device->impl().maxAllocationBytes, 200'000);
    const auto refusal = maps->execute(plan);
    ASSERT_FALSE(refusal);
    EXPECT_EQ(refusal.error().code, world::ErrorCode::kLimit);
    EXPECT_NE(refusal.error().what.find("3000 draws"), std::string::npos) << refusal.error().what;
    EXPECT_EQ(covered(read(MapKind::kCache)), 0);
    device->impl().maxAllocationBytes = limit;
    execute(plan);
    EXPECT_GT(covered(read(MapKind::kCache)), 0);
}

TEST_F(Maps, GeometryIsReusedAfterRelease) {
    const int side = 64;
    const uint64_t budget = 64 << 10;
    makeMaps(side, 1, budget);
    std::mt19937 rng(37);
    struct Live {
        cache::GeometryId id;
        world::MeshLevel level;
        uint64_t bytes;
    };
    std::vector<Live> live;
    uint64_t used = 0, refusals = 0;
    for (int step = 0; step < 300; ++step) {
        world::MeshLevel level = triangleSoup(rng, 1 + static_cast<int>(rng() % 120));
        level.positions.resize(level.positions.size() + rng() % 3, glm::vec3(0));
        const uint64_t bytes = level.positions.size() * 12 + level.indices.size() * 4;  // 3 indices: 12 bytes
        const uint64_t uploadedBefore = maps->uploadedBytes();
        const auto id = maps->upload(level);
        if (id) {
            for (const Live& l : live) ASSERT_NE(l.id, id.value()) << "given out twice";
            live.push_back({id.value(), level, bytes});
            used += bytes;
            ASSERT_EQ(maps->uploadedBytes() - uploadedBefore, bytes);
        } else {
            ++refusals;
            ASSERT_EQ(id.error().code, world::ErrorCode::kLimit);
            ASSERT_NE(id.error().what.find("--gpu-budget"), std::string::npos) << id.error().what;
        }
        ASSERT_EQ(maps->geometryBytesUsed(), used);
        ASSERT_LE(used, budget);
        while (!live.empty() && (!id || rng() % 3 == 0)) {
            std::swap(live[rng() % live.size()], live.back());
            maps->release(live.back().id);
            used -= live.back().bytes;
            live.pop_back();
            if (rng() % 2) break;
        }
        if (step % 30 != 0 || live.empty()) continue;
        // What is still there draws as the same meshes do in a fresh arena.
        std::vector<world::MeshLevel> levels;
        std::vector<cache::GeometryId> ids, freshIds;
        for (const Live& l : live) {
            levels.push_back(l.level);
            ids.push_back(l.id);
        }
        Scene scene = randomScene(rng, side, 40, 0.3, side, levels, ids);
        execute(scene.whole());
        auto fresh = ShadowMaps::create(*device, {.cascades = 1, .side = side, .geometryBytes = 2 * budget});
        ASSERT_TRUE(fresh) << fresh.error().what;
        for (const world::MeshLevel& l : levels) {
            auto freshId = fresh.value()->upload(l);
            ASSERT_TRUE(freshId) << freshId.error().what;
            freshIds.push_back(freshId.value());
        }
        for (cache::DrawItem& item : scene.items)
            item.geometry =
                freshIds[static_cast<size_t>(std::find(ids.begin(), ids.end(), item.geometry) - ids.begin())];
        ASSERT_TRUE(fresh.value()->execute(scene.whole()));
        auto depths = fresh.value()->read(0, MapKind::kCache);
        ASSERT_TRUE(depths);
        ASSERT_EQ(differing(read(MapKind::kCache), depths.value()), 0u) << "step " << step;
    }
    EXPECT_GT(refusals, 10u);
}

TEST_F(Maps, OtherMapsOfAKnownFormatNeedNoOtherPipeline) {
    makeMaps(64, 2);
    const std::atomic<uint64_t>& created = device->impl().owner.created;
    const int fresh[] = {-1, -1};
    const auto reshape = [&](int side, DepthFormat format) {
        const uint64_t before = created;
        EXPECT_TRUE(maps->reshape(fresh, side, format));
        return created - before;
    };
    const uint64_t same = reshape(64, DepthFormat::kD32);
    EXPECT_GT(reshape(64, DepthFormat::kD16), same) << "its first pipeline";
    for (int round = 0; round < 3; ++round) {
        EXPECT_EQ(reshape(128, DepthFormat::kD32), same);
        EXPECT_EQ(reshape(96, DepthFormat::kD16), same);
    }
}

TEST_F(Maps, EmptyGeometryTakesNoSpaceAndDrawsNothing) {
    makeMaps(16, 1, 1000);
    const cache::GeometryId id = upload({});
    EXPECT_EQ(maps->geometryBytesUsed(), 0u);
    cache::FramePlan plan = emptyPlan();
    plan.transforms = {glm::mat3x4(0)};
    plan.items = {{id, 0, 0, 0}};
    plan.cascades[0].staticPasses = {{whole(16), 0, 1}};
    execute(plan);
    EXPECT_EQ(covered(read(MapKind::kCache)), 0);
    maps->release(id);
}

TEST_F(Maps, LimitsAreNamedWithTheirRemedy) {
    const auto tooLarge =
        ShadowMaps::create(*device, {.cascades = 1, .side = 1 << 20, .geometryBytes = 1 << 20});
    ASSERT_FALSE(tooLarge);
    EXPECT_EQ(tooLarge.error().code, world::ErrorCode::kLimit);
    EXPECT_NE(tooLarge.error().what.find("lower --resolution"), std::string::npos) << tooLarge.error().what;
    const auto tooMuch =
        ShadowMaps::create(*device, {.cascades = 1, .side = 16, .geometryBytes = 1ull << 42});
    ASSERT_FALSE(tooMuch);
    EXPECT_EQ(tooMuch.error().code, world::ErrorCode::kLimit);
    EXPECT_NE(tooMuch.error().what.find("lower --gpu-budget"), std::string::npos) << tooMuch.error().what;
}

TEST_F(Maps, TheNearestDepthIsOneUnitOf16Bits) {
    const int side = 16;
    config.format = DepthFormat::kD16;
    makeMaps(side);
    const cache::GeometryId quad = upload(unitQuad());
    for (const double units : {-1e6, -1.0, 0.0, 0.25, 0.75, 1.0, 2.0, 255.0, 32767.0, 65533.0, 65534.0}) {
        cache::FramePlan plan = emptyPlan();
        plan.cascades[0].clears = {whole(side)};
        plan.cascades[0].staticPasses = {
            addPass(plan, quad, side, {{glm::dvec2(-1), glm::dvec2(side + 1), units / 65534}}, whole(side))};
        execute(plan);
        // The range [0, 1] is 65534 units long and begins at unit 1; unit 0 is unknown.
        const float expected = static_cast<float>(1 + std::round(std::max(0.0, units))) / 65535.0f;
        EXPECT_EQ(read(MapKind::kCache), std::vector<float>(side * side, expected)) << units;
    }
}

INSTANTIATE_TEST_SUITE_P(Formats, FormatMaps, testing::Values(DepthFormat::kD32, DepthFormat::kD16),
                         [](const auto& test) { return nameOf(test.param); });

TEST_F(Maps, SharedMemoryHoldsWorkingMapsImportedOrNot) {
    constexpr size_t kMap = 64 * 64 * sizeof(float), kPage = 4096;
    makeMaps(64, 2);
    const cache::GeometryId id = upload(unitQuad());
    cache::FramePlan plan = emptyPlan(2);
    plan.cascades[1].staticPasses = {addPass(plan, id, 64, {{{3, 5}, {40, 21}, 0.25}}, whole(64))};
    plan.cascades[1].restores = {whole(64)};
    execute(plan);
    const std::unique_ptr<std::byte, void (*)(void*)> memory(static_cast<std::byte*>(std::aligned_alloc(kPage, 4 * kMap)), std::free);
    const bool imports = device->impl().importAlignment > 0 && kPage % device->impl().importAlignment == 0;
    for (const size_t skip : {size_t(0), size_t(64)}) {  // the second is no driver's to import
        std::fill_n(memory.get(), 4 * kMap, std::byte(0x55));
        const auto shared = maps->share({memory.get() + skip, 3 * kMap});
        ASSERT_TRUE(shared) << shared.error().what;
        EXPECT_EQ(shared.value(), imports && skip == 0);
        ASSERT_TRUE(maps->copyWorking(std::vector<ShadowMaps::MapCopy>{{1, 2 * kMap}, {0, 0}}));
        for (const auto& [cascade, at] : {std::pair(0, size_t(0)), std::pair(1, 2 * kMap)}) {
            const std::vector<float> expected = read(MapKind::kWorking, cascade);
            EXPECT_EQ(std::memcmp(memory.get() + skip + at, expected.data(), kMap), 0) << "cascade " << cascade;
        }
        EXPECT_EQ(memory.get()[skip + kMap], std::byte(0x55)) << "nothing was copied there";
    }
    EXPECT_LT(read(MapKind::kWorking, 1)[10 * 64 + 10], 1.0f) << "something casts";
    maps.reset();  // before the memory
}

using MapsDeathTest = Maps;

TEST_F(MapsDeathTest, StopAtAPlanThatDrawsWhatWasReleased) {
    GTEST_FLAG_SET(death_test_style, "threadsafe");  // the driver has threads
    makeMaps(16);
    const cache::GeometryId id = upload(unitQuad());
    cache::FramePlan plan = emptyPlan();
    plan.cascades[0].staticPasses = {addPass(plan, id, 16, {{{0, 0}, {4, 4}, 0.5}}, whole(16))};
    execute(plan);
    maps->release(id);
    EXPECT_DEATH(static_cast<void>(maps->execute(plan)), "broken invariant.*live");
    EXPECT_DEATH(maps->release(id), "broken invariant.*live");
}

}  // namespace
}  // namespace gpu::test
