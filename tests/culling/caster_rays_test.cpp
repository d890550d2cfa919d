// tests/culling/caster_rays_test.cpp — what a few rays call hidden, and who owns texels: on scenes whose answers are
// known, and against each other where every texel is asked.
#include "culling/caster_rays.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>

#include "tests/culling/hidden_layers.h"

namespace {

using culling::CasterRays;
using culling::CasterTexel;
using culling::HiddenCasters;
using culling::MapTexels;
using tests::HiddenLayers;
using tests::ToyScene;
using world::CasterId;

using Ids = std::vector<CasterId>;

std::unique_ptr<CasterRays> raysOver(const ToyScene& scene, const MapTexels& map, const Ids& ids) {
    auto made = CasterRays::create(scene.table, scene.light, map, ids);
    if (!made) throw std::runtime_error(made.error().what);
    return std::move(made.value());
}

/// Under a sun straight overhead; x and z off the lattice, so that no edge passes through a centre.
struct Overhead {
    CasterId add(world::Mesh mesh, glm::dvec3 at) {
        ids.push_back(scene.addStatic(scene.addMesh(std::move(mesh)), tests::placedAt(at + glm::dvec3(0.013, 0, 0.017))));
        return ids.back();
    }
    Ids hidden(int rays) const { return raysOver(scene, map, ids)->hidden(rays).casters; }
    Ids owners() const { return culling::ownersOf(scene.table, scene.light, map, ids); }

    ToyScene scene = tests::sceneUnder({0, -1, 0});
    MapTexels map = tests::mapAround(scene, glm::dvec3(0));
    Ids ids;
};

TEST(CasterRays, AWallHidesABoxAndNothingHidesTheWall) {
    Overhead o;
    const CasterId box = o.add(tests::boxMesh({1, 1, 1}), {0, 0, 0}), wall = o.add(tests::sheetMesh(3, 4), {0, 5, 0});
    for (const int rays : {1, 4, 16, 64}) EXPECT_EQ(o.hidden(rays), Ids{box}) << rays;
    EXPECT_EQ(o.owners(), Ids{wall});
    // Below it hides nothing.
    Overhead under;
    under.add(tests::boxMesh({1, 1, 1}), {0, 0, 0});
    under.add(tests::sheetMesh(3, 4), {0, -5, 0});
    for (const int rays : {4, 16, 64}) EXPECT_EQ(under.hidden(rays), Ids{}) << rays;
    EXPECT_EQ(under.hidden(1), Ids{1}) << "the box stands before its middle";
    EXPECT_EQ(under.owners(), under.ids);
}

TEST(CasterRays, OneRayMissesTheSlotThroughWhichManySlip) {
    Overhead o;
    const CasterId box = o.add(tests::boxMesh({2, 1, 2}), {0, 0, 0});
    // 0.3 m of the box, at x from 0.5 to 0.8, lie open; its middle does not.
    o.add(tests::sheetMesh(3, 4), {-1, 5, 0});
    o.add(tests::sheetMesh(3, 4), {2.3, 5, 0});
    EXPECT_EQ(o.owners(), o.ids) << "the slot shows the box";
    EXPECT_EQ(o.hidden(1), Ids{box}) << "wrongly: that is what one ray is worth";
    EXPECT_EQ(o.hidden(64), Ids{});
}

TEST(CasterRays, ACasterAloneOrBesideItsTwinIsNeverHidden) {
    // A roof over a sheet, both of one caster: its own triangles hide nothing of it.
    world::MeshLevel both = tests::sheetMesh(2, 4).levels[0];
    const auto first = uint32_t(both.positions.size());
    const world::MeshLevel roof = tests::sheetMesh(3, 4).levels[0];
    for (const glm::vec3& p : roof.positions) both.positions.push_back(p + glm::vec3(0, 2, 0));
    for (const uint32_t index : roof.indices) both.indices.push_back(first + index);
    both.clusters.clear();
    Overhead o;
    o.add(tests::finished(both), {0, 0, 0});
    for (const int rays : {1, 4, 16, 64}) EXPECT_EQ(o.hidden(rays), Ids{}) << rays;
    EXPECT_EQ(o.owners(), o.ids);
    // Neither of two in one place is nearer.
    const world::Caster one = o.scene.table[0];
    o.ids.push_back(o.scene.addStatic(one.mesh, one.placement));
    for (const int rays : {1, 64}) EXPECT_EQ(o.hidden(rays), Ids{}) << rays;
    EXPECT_EQ(o.owners(), Ids{0}) << "of equally near ones the first";
}

TEST(CasterRays, OfSteepSurfacesDoNotMeetThem) {
    // 1 km of depth within 0.3 m, 2 km from the middle of all: single precision is off by up to 6e-5 m across the light,
    // which is 0.2 m along it.
    Overhead o;
    o.add(tests::boxMesh({1, 1, 1}), {4000, 0, 0});
    for (int k = 0; k < 40; ++k) {
        world::MeshLevel steep;
        tests::addQuad(steep, {-0.15f, -500, -0.15f}, {0.15f, 500, -0.15f}, {0.15f, 500, 0.15f}, {-0.15f, -500, 0.15f});
        o.add(tests::finished(std::move(steep)), {-4.5 + 0.517 * (k % 8), 0, -2 + 0.517 * (k / 8)});
    }
    const auto rays = raysOver(o.scene, o.map, o.ids);
    ASSERT_EQ(rays->asked().size(), 40u);
    EXPECT_EQ(rays->hidden(1).casters, Ids{});
}

TEST(CasterRays, AreAskedOfWhatTheMapDrawsAlone) {
    Overhead o;
    const CasterId shown = o.add(tests::boxMesh({1, 1, 1}), {0, 0, 0});
    o.add(tests::boxMesh({1, 1, 1}), {8, 0, 0});               // beside the map, which ends at 4.8 m
    o.add(tests::boxMesh({0.02f, 1, 0.02f}), {1.47, 0, 0.47});  // between centres
    const CasterId half = o.add(tests::boxMesh({1, 1, 1}), {-4.8, 0, 0});
    const auto rays = raysOver(o.scene, o.map, o.ids);
    EXPECT_EQ(Ids(rays->asked().begin(), rays->asked().end()), (Ids{shown, half}));
    EXPECT_EQ(rays->hidden(1).rays, 2u);
    EXPECT_EQ(rays->hidden(64).rays, 2u) << "none after one that met nothing";
    EXPECT_EQ(o.owners(), (Ids{shown, half}));

    const auto none = raysOver(o.scene, o.map, {});
    EXPECT_TRUE(none->asked().empty());
    EXPECT_EQ(none->hidden(64).rays, 0u);
    EXPECT_TRUE(culling::ownersOf(o.scene.table, o.scene.light, o.map, {}).empty());
}

TEST(CasterTexels, AreTheCentresThatACasterCoversAndItsNearestDepths) {
    Overhead o;
    const CasterId box = o.add(tests::boxMesh({1.02f, 2, 0.5f}), {0, 3, 0});
    const std::vector<CasterTexel> texels = culling::texelsOf(o.scene.table, o.scene.light, o.map, box);
    // Along x centres at -0.45 ... 0.45 (the box spans -0.497 to 0.523), along z at -0.15 ... 0.25 (-0.233 to 0.267).
    EXPECT_EQ(texels.size(), 10u * 5u);
    const glm::dmat3& lightFromWorld = o.scene.light.space().lightFromWorld;
    for (const CasterTexel& t : texels) {
        EXPECT_NEAR(t.depth, -4, 1e-9) << "its top, at height 4";  // rounding of doubles
        const glm::dvec2 centre = (glm::dvec2(o.map.low) + glm::dvec2(t.texel) + 0.5) * tests::kLayerTexel;
        const glm::dvec3 p = glm::transpose(lightFromWorld) * glm::dvec3(centre, 0);
        EXPECT_LT(std::abs(p.x - 0.013), 0.51);
        EXPECT_LT(std::abs(p.z - 0.017), 0.25);
    }
}

// Rows of a triangle are spans: against every centre of the map, for triangles within it and far larger, and slivers.
TEST(CasterTexels, AreThoseOfWhichTheTriangleHoldsTheCentre) {
    std::mt19937 rng(3);
    const auto uniform = [&rng](double most) { return most * (2 * double(rng()) / 4294967296.0 - 1); };
    size_t covered = 0;
    for (int k = 0; k < 60; ++k) {
        const double size = std::array{3.0, 60.0, 5.0}[size_t(k % 3)], thick = k % 3 == 2 ? 0.02 : size;
        world::MeshLevel level;
        for (int i = 0; i < 3; ++i) level.positions.emplace_back(uniform(size), uniform(3), uniform(i < 2 ? size : thick));
        if (k % 3 == 2) level.positions[1].z = level.positions[0].z + float(uniform(thick));  // a sliver along a row
        level.indices = {0, 1, 2};
        Overhead o;
        const CasterId id = o.add(tests::finished(level), {0, 0, 0});
        const std::vector<CasterTexel> texels = culling::texelsOf(o.scene.table, o.scene.light, o.map, id);
        std::array<glm::dvec2, 3> corners;
        for (size_t i = 0; i < 3; ++i) {
            const glm::dvec3 p = o.scene.light[id].lightFromMesh * glm::dvec3(level.positions[i]) + o.scene.light[id].origin;
            corners[i] = glm::dvec2(p) / tests::kLayerTexel - glm::dvec2(o.map.low);
        }
        size_t at = 0;
        for (int y = 0; y < o.map.side; ++y)
            for (int x = 0; x < o.map.side; ++x) {
                int left = 0, right = 0;
                for (size_t i = 0; i < 3; ++i) {
                    const glm::dvec2 edge = corners[(i + 1) % 3] - corners[i], p = glm::dvec2(x + 0.5, y + 0.5) - corners[i];
                    const double side = edge.x * p.y - edge.y * p.x;
                    left += side >= 0;
                    right += side <= 0;
                }
                const bool inside = left == 3 || right == 3;
                const bool found = at < texels.size() && texels[at].texel == glm::ivec2(x, y);
                ASSERT_EQ(inside, found) << "triangle " << k << ", texel " << x << " " << y;
                at += found;
            }
        EXPECT_EQ(at, texels.size());
        covered += at;
    }
    EXPECT_GT(covered, 10000u);
}

// Casters of at most 64 texels are asked about all of them: by Embree in single precision, while owners are found by a
// rasteriser in double precision. The two meet.
TEST(CasterRays, OfAllTexelsHideExactlyWhatOwnsNone) {
    for (const glm::dvec3 origin : {glm::dvec3(0), glm::dvec3(1e6, 30, -1e6)}) {
        size_t small = 0, hiddenOnes = 0, partly = 0;
        for (uint32_t seed = 1; seed <= 5; ++seed) {
            const HiddenLayers layers(seed, origin);
            const auto rays = raysOver(layers.scene, layers.map, layers.ids);
            const Ids hidden = rays->hidden(64).casters, once = rays->hidden(1).casters;
            const Ids owners = culling::ownersOf(layers.scene.table, layers.scene.light, layers.map, layers.ids);
            for (const CasterId id : rays->asked()) {
                if (culling::texelsOf(layers.scene.table, layers.scene.light, layers.map, id).size() > 64) continue;
                const bool owns = std::binary_search(owners.begin(), owners.end(), id);
                const bool found = std::find(hidden.begin(), hidden.end(), id) != hidden.end();
                EXPECT_NE(owns, found) << "caster " << id << ", seed " << seed;
                ++small;
                hiddenOnes += found;
                partly += owns && std::find(once.begin(), once.end(), id) != once.end();
            }
        }
        EXPECT_GT(small, 200u);
        EXPECT_GT(hiddenOnes, 50u);
        EXPECT_GT(partly, 5u) << "that one ray is wrong about";
    }
}

TEST(CasterRays, MoreRaysHideLessAndNeitherOrderNorThreadsMatter) {
    const HiddenLayers layers(7);
    Ids reversed(layers.ids.rbegin(), layers.ids.rend());
    std::vector<HiddenCasters> first;
    Ids owners;
    for (const size_t threads : {1, 2, 7}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        for (const Ids& ids : {layers.ids, reversed}) {
            const auto rays = raysOver(layers.scene, layers.map, ids);
            std::vector<HiddenCasters> found;
            for (const int k : {1, 4, 16, 64}) {
                found.push_back(rays->hidden(k));
                std::sort(found.back().casters.begin(), found.back().casters.end());
                if (found.size() < 2) continue;
                const Ids &few = found[found.size() - 2].casters, &many = found.back().casters;
                EXPECT_TRUE(std::includes(few.begin(), few.end(), many.begin(), many.end())) << k;
                EXPECT_LT(many.size(), few.size()) << k << ": every round finds some open";
            }
            if (first.empty()) {
                first = found;
                owners = culling::ownersOf(layers.scene.table, layers.scene.light, layers.map, ids);
            }
            for (size_t k = 0; k < found.size(); ++k) {
                EXPECT_EQ(found[k].casters, first[k].casters) << threads << " threads";
                EXPECT_EQ(found[k].rays, first[k].rays) << threads << " threads";
            }
            EXPECT_EQ(culling::ownersOf(layers.scene.table, layers.scene.light, layers.map, ids), owners) << threads << " threads";
        }
    }
}

TEST(CasterRays, RefuseWhatIsNotFinite) {
    const double nan = std::numeric_limits<double>::quiet_NaN(), infinity = std::numeric_limits<double>::infinity();
    for (const double bad : {nan, infinity, -infinity, 2e9})
        for (const int axis : {0, 1, 2}) {
            Overhead o;
            o.add(tests::boxMesh({1, 1, 1}), {0, 0, 0});
            glm::dvec3 at(0, 5, 0);
            at[axis] = bad;
            o.add(tests::sheetMesh(3, 4), at);
            const auto made = CasterRays::create(o.scene.table, o.scene.light, o.map, o.ids);
            ASSERT_FALSE(made) << bad << " on axis " << axis;
            EXPECT_EQ(made.error().code, world::ErrorCode::kUsage);
            EXPECT_NE(made.error().what.find("caster 1"), std::string::npos) << made.error().what;
        }
    world::Mesh torn = tests::sheetMesh(3, 4);
    torn.levels[0].positions[7].y = std::numeric_limits<float>::quiet_NaN();
    Overhead o;
    o.add(std::move(torn), {0, 0, 0});
    EXPECT_EQ(CasterRays::create(o.scene.table, o.scene.light, o.map, o.ids).error().code, world::ErrorCode::kUsage);
}

}  // namespace
