// tests/world/terrain_edit_test.cpp — edits against the formula: same samples in all chunks, no cracks, and
// nothing else of a mesh changes.
#include "world/terrain_edit.h"

#include <gtest/gtest.h>

#include <limits>
#include <map>
#include <random>

#include "tests/world/cracks.h"
#include "tests/world/terrain_fields.h"
#include "world/band.h"
#include "world/casters.h"
#include "world/mesh_changes.h"
#include "world/terrain.h"

namespace world {
namespace {

constexpr double kEditVoxel = 2;

using Formula = std::function<double(glm::dvec3)>;

Header headerOf(int32_t side) {
    Header header;
    header.chunkSize = side * kEditVoxel;
    header.voxel = kEditVoxel;
    return header;
}

LevelSet setOf(const Formula& formula, ChunkKey key, int32_t side) {
    return sampleLevelSet(test::fieldOf(formula, -60, 60), key, side, kEditVoxel).value();
}

/// Signed distance to the shape, told in another way than the edits tell it.
double distanceTo(const TerrainEdit& edit, glm::dvec3 p) {
    if (const auto* s = std::get_if<Sphere>(&edit.shape)) return glm::distance(p, s->centre) - s->radius;
    if (const auto* b = std::get_if<Box>(&edit.shape)) {
        const glm::dvec3 q = glm::abs(p - b->centre()) - b->extent() * 0.5;
        if (q.x <= 0 && q.y <= 0 && q.z <= 0) return std::max({q.x, q.y, q.z});
        return std::hypot(std::max(q.x, 0.0), std::max(q.y, 0.0), std::max(q.z, 0.0));
    }
    const auto& c = std::get<Capsule>(edit.shape);
    double nearest = std::min(glm::distance(p, c.from), glm::distance(p, c.to));
    const glm::dvec3 axis = glm::normalize(c.to - c.from);
    const double along = glm::dot(p - c.from, axis);
    if (along > 0 && along < glm::distance(c.from, c.to))
        nearest = std::sqrt(std::max(0.0, glm::dot(p - c.from, p - c.from) - along * along));
    return nearest - c.radius;
}

Formula after(const Formula& before, const TerrainEdit& edit) {
    return [before, edit](glm::dvec3 p) {
        const double s = distanceTo(edit, p);
        return edit.kind == EditKind::kDig ? std::max(before(p), -s) : std::min(before(p), s);
    };
}

class Edits {
public:
    explicit Edits(uint32_t seed) : rng_(seed) {}
    double uniform(double low, double high) { return std::uniform_real_distribution<double>(low, high)(rng_); }
    /// Near the surface, between `low` and `high` [m of x and z].
    TerrainEdit any(const Formula& ground, glm::dvec2 low, glm::dvec2 high) {
        glm::dvec3 p;
        do p = {uniform(low.x, high.x), uniform(-25, 25), uniform(low.y, high.y)};
        while (std::abs(ground(p)) > 4);
        TerrainEdit edit{rng_() % 2 ? EditKind::kDig : EditKind::kFill, Sphere{p, uniform(1, 9)}};
        const glm::dvec3 reach(uniform(1, 8), uniform(1, 8), uniform(1, 8));
        if (rng_() % 3 == 0) edit.shape = Box{p - reach, p + reach};
        if (rng_() % 3 == 0) edit.shape = Capsule{p - reach, p + reach, uniform(1, 5)};
        return edit;
    }

private:
    std::mt19937 rng_;
};

TEST(TerrainEdit, RefusesWhatIsNoShapeOfTheWorld) {
    const Header header = headerOf(32);
    const double nan = std::numeric_limits<double>::quiet_NaN(), inf = std::numeric_limits<double>::infinity();
    const auto code = [&](const auto& shape) {
        const auto good = requireEdit({EditKind::kDig, shape}, header);
        EXPECT_FALSE(good);
        EXPECT_NE(good.error().what.find("dig: "), std::string::npos) << good.error().what;
        return good.error().code;
    };
    for (const double bad : {nan, inf, -inf}) {
        EXPECT_EQ(code(Sphere{{0, bad, 0}, 1}), ErrorCode::kUsage);
        EXPECT_EQ(code(Sphere{{0, 0, 0}, bad}), ErrorCode::kUsage);
        EXPECT_EQ(code(Box{{0, 0, 0}, {1, 1, bad}}), ErrorCode::kUsage);
        EXPECT_EQ(code(Capsule{{bad, 0, 0}, {1, 1, 1}, 1}), ErrorCode::kUsage);
    }
    EXPECT_EQ(code(Sphere{{0, 0, 0}, 0}), ErrorCode::kUsage);
    EXPECT_EQ(code(Sphere{{0, 0, 0}, -1}), ErrorCode::kUsage);
    EXPECT_EQ(code(Box{{0, 0, 0}, {1, -1, 1}}), ErrorCode::kUsage);
    EXPECT_EQ(code(Box{}), ErrorCode::kUsage);
    EXPECT_EQ(code(Sphere{{0, 0, 0}, 33}), ErrorCode::kLimit) << "66 m in chunks of 64";
    EXPECT_EQ(code(Capsule{{0, 0, 0}, {0, 63, 0}, 1}), ErrorCode::kLimit);
    EXPECT_EQ(code(Sphere{{2e8, 0, 0}, 1}), ErrorCode::kLimit);
    EXPECT_TRUE(requireEdit({EditKind::kFill, Sphere{{0, 0, 0}, 32}}, header));
    const auto none = requireEdit({EditKind::kFill, Sphere{{0, 0, 0}, 1}}, Header());
    ASSERT_FALSE(none);
    EXPECT_EQ(none.error().code, ErrorCode::kUsage);
    EXPECT_NE(none.error().what.find("no terrain"), std::string::npos);
}

TEST(TerrainEdit, GivesTheSamplesOfTheFormula) {
    Edits edits(3);
    for (const int32_t side : {32, 20}) {  // 20 is no multiple of a leaf
        Formula formula = test::hillsWithCave;
        const ChunkKey key{1, 0, -2};
        LevelSet set = setOf(formula, key, side);
        const double edge = side * kEditVoxel;
        for (int n = 0; n < 12; ++n) {
            // Some lie beyond the border, some over it.
            const TerrainEdit edit = edits.any(formula, {edge * 0.9, -edge * 2.1}, {edge * 2.1, -edge * 0.9});
            formula = after(formula, edit);
            set = edited(set, key, edit).value();
        }
        const Band made = unpack(set), expected = unpack(setOf(formula, key, side));
        int compared = 0, inBand = 0;
        for (int x = 0; x < made.count.x; ++x)
            for (int z = 0; z < made.count.z; ++z)
                for (int y = std::max(made.bottom, expected.bottom);
                     y < std::min(made.bottom + made.count.y, expected.bottom + expected.count.y); ++y) {
                    const float a = made.at(x, y - made.bottom, z), b = expected.at(x, y - expected.bottom, z);
                    // A unit, since the formula's value is rounded to single precision first.
                    ASSERT_NEAR(a, b, 1.5f * kBandVoxels / kBandUnits) << x << " " << y << " " << z;
                    ++compared;
                    inBand += std::abs(b) < kBandVoxels;
                }
        EXPECT_GT(compared, 40000);
        EXPECT_GT(inBand, 5000);
    }
}

TEST(TerrainEdit, ChunksKnowTheSameSamplesAndOnlyThoseNamedChange) {
    Edits edits(4);
    for (const int32_t side : {32, 20}) {
        const double edge = side * kEditVoxel;
        std::map<ChunkKey, LevelSet> sets;
        for (int x = -1; x < 2; ++x)
            for (int z = -1; z < 2; ++z) sets[{x, 0, z}] = setOf(test::hillsWithCave, {x, 0, z}, side);
        int several = 0;
        for (int n = 0; n < 30; ++n) {
            const TerrainEdit edit = edits.any(test::hillsWithCave, glm::dvec2(-0.7 * edge), glm::dvec2(1.7 * edge));
            const std::vector<ChunkKey> keys = chunksWithin(edit, headerOf(side));
            EXPECT_TRUE(std::is_sorted(keys.begin(), keys.end()));
            several += keys.size() > 1;
            for (auto& [key, set] : sets) {
                LevelSet now = edited(set, key, edit).value();
                const bool named = std::find(keys.begin(), keys.end(), key) != keys.end();
                ASSERT_TRUE(named || now == set) << toString(key);
                set = std::move(now);
            }
        }
        EXPECT_GT(several, 8);
        std::map<ChunkKey, Band> bands;
        for (const auto& [key, set] : sets) bands[key] = unpack(set);
        size_t shared = 0;
        for (const auto& [k, a] : bands)
            for (const auto& [l, b] : bands) {
                const glm::ivec2 shift((l.x - k.x) * side, (l.z - k.z) * side);
                for (int x = std::max(0, shift.x); x < std::min(a.count.x, b.count.x + shift.x); ++x)
                    for (int z = std::max(0, shift.y); z < std::min(a.count.z, b.count.z + shift.y); ++z)
                        for (int y = std::max(a.bottom, b.bottom);
                             y < std::min(a.bottom + a.count.y, b.bottom + b.count.y); ++y, ++shared)
                            ASSERT_EQ(a.at(x, y - a.bottom, z), b.at(x - shift.x, y - b.bottom, z - shift.y))
                                << toString(k) << " and " << toString(l);
            }
        EXPECT_GT(shared, 100000u);
    }
}

TEST(TerrainEdit, LeavesTheSetAloneWhereNothingChanges) {
    const LevelSet set = setOf(test::hillsWithCave, {0, 0, 0}, 32);
    EXPECT_EQ(edited(set, {0, 0, 0}, {EditKind::kDig, Sphere{{500, 0, 0}, 4}}).value(), set) << "far off";
    EXPECT_EQ(edited(set, {0, 0, 0}, {EditKind::kDig, Sphere{{30, 58, 30}, 4}}).value(), set) << "air in air";
    EXPECT_EQ(edited(set, {0, 0, 0}, {EditKind::kFill, Sphere{{30, -58, 30}, 4}}).value(), set) << "solid in solid";
}

TEST(TerrainEdit, AHoleThatIsFilledAgainLeavesNoTrace) {
    const LevelSet set = setOf(test::hillsWithCave, {0, 0, 0}, 32);
    // Centres on samples, radii of whole voxels: samples lie on the shape's surface.
    for (const Sphere& hole : {Sphere{{31, -39, 31}, 6}, Sphere{{30.3, -41, 29.1}, 7.7}}) {
        const LevelSet dug = edited(set, {0, 0, 0}, {EditKind::kDig, hole}).value();
        const Mesh before = terrainMesh(set), cave = terrainMesh(dug);
        EXPECT_FALSE(changedBox(before.levels[0], cave.levels[0]).empty());
        const Mesh again = terrainMesh(edited(dug, {0, 0, 0}, {EditKind::kFill, hole}).value());
        ASSERT_EQ(before.levels.size(), again.levels.size());
        for (size_t k = 0; k < before.levels.size(); ++k)
            EXPECT_TRUE(changedBox(before.levels[k], again.levels[k]).empty()) << "level " << k;
    }
}

TEST(TerrainEdit, VoidsStayVoid) {
    const Formula half = [](glm::dvec3 p) { return p.x > 30 ? NAN : test::hillsWithCave(p); };
    const LevelSet set = setOf(half, {0, 0, 0}, 32);
    for (const EditKind kind : {EditKind::kDig, EditKind::kFill}) {
        const LevelSet now = edited(set, {0, 0, 0}, {kind, Sphere{{32, -test::hillsWithCave({32, 0, 32}), 32}, 9}}).value();
        ASSERT_NE(now, set);
        const Band a = unpack(set), b = unpack(now);
        for (int x = 0; x < a.count.x; ++x)
            for (int z = 0; z < a.count.z; ++z) ASSERT_EQ(std::isnan(a.at(x, 0, z)), std::isnan(b.at(x, 0, z)));
        const Mesh mesh = terrainMesh(now);
        for (const glm::vec3& p : mesh.levels[0].positions) ASSERT_TRUE(std::isfinite(p.x + p.y + p.z));
    }
}

TEST(TerrainEdit, IsTheSameAThousandKilometresAway) {
    const ChunkKey far{16384, 0, -15625};  // 1049 km east, 1000 km north; exact in double
    const glm::dvec3 shift = glm::dvec3(far.x, 0, far.z) * 64.0;
    const LevelSet set = setOf(test::hillsWithCave, {0, 0, 0}, 32);
    const Capsule here{{10, -10, 12}, {30, 4, 40}, 5}, there{here.from + shift, here.to + shift, 5};
    EXPECT_EQ(edited(set, {0, 0, 0}, {EditKind::kDig, here}).value(), edited(set, far, {EditKind::kDig, there}).value());
}

TEST(TerrainEdit, RefusesATowerThatIsTooTall) {
    const LevelSet set = setOf(test::hillsWithCave, {0, 0, 0}, 32);
    const auto tower = edited(set, {0, 0, 0}, {EditKind::kFill, Sphere{{30, 2e5, 30}, 5}});
    ASSERT_FALSE(tower);
    EXPECT_EQ(tower.error().code, ErrorCode::kLimit);
    EXPECT_NE(tower.error().what.find("fill: chunk (0,0,0)"), std::string::npos) << tower.error().what;
}

TEST(TerrainEdit, ChangesTrianglesNearItAlone) {
    constexpr int32_t kSide = 96;
    const LevelSet set = setOf(test::hillsWithCave, {0, 0, 0}, kSide);
    const Mesh before = terrainMesh(set);
    Edits edits(6);
    int deeper = 0;
    for (int n = 0; n < 10; ++n) {
        TerrainEdit edit = edits.any(test::hillsWithCave, glm::dvec2(20), glm::dvec2(172));
        if (n == 0) edit = {EditKind::kDig, Capsule{{96, 10, 96}, {96, -80, 96}, 5}};  // below all that was there
        if (n == 1) edit = {EditKind::kFill, Capsule{{90, 0, 60}, {96, 80, 66}, 5}};   // above it
        const LevelSet now = edited(set, {0, 0, 0}, edit).value();
        deeper += unpack(now).bottom != unpack(set).bottom;
        const Mesh mesh = terrainMesh(now);
        // The cells around a changed sample and the skirt that hangs from them; a leaf of merged cells on either side,
        // which is twice as large on the coarse lattice.
        const double room[] = {3 * kEditVoxel, (kLeafSide + 3) * kEditVoxel, 2 * (2 * kLeafSide + 3) * kEditVoxel};
        const bool sameLevels = before.levels.size() == mesh.levels.size();
        for (size_t k = 0; k < (sameLevels ? 3 : 2); ++k) {
            const Box box = changedBox(before.levels[k], mesh.levels[k]);
            if (box.empty()) continue;
            const Box reach = grown(boundsOf(edit), kBandVoxels * kEditVoxel + room[k]);
            for (int axis = 0; axis < 3; ++axis) {
                EXPECT_GE(box.min[axis], reach.min[axis]) << "edit " << n << " level " << k << " axis " << axis;
                EXPECT_LE(box.max[axis], reach.max[axis]) << "edit " << n << " level " << k << " axis " << axis;
            }
        }
    }
    EXPECT_GT(deeper, 0) << "a band that reaches farther changes no triangle elsewhere";
}

TEST(TerrainEdit, LetsNoLightThroughBetweenChunks) {
    constexpr int32_t kSide = 32;
    constexpr double kEdge = kSide * kEditVoxel;
    Edits edits(7);
    Formula formula = test::hillsWithCave;
    std::vector<LevelSet> sets;
    for (int i = 0; i < 4; ++i) sets.push_back(setOf(formula, {i % 2, 0, i / 2}, kSide));
    for (int n = 0; n < 24; ++n) {
        TerrainEdit edit = edits.any(formula, glm::dvec2(12), glm::dvec2(2 * kEdge - 12));
        // On the seams, where the cracks would be.
        if (auto* sphere = std::get_if<Sphere>(&edit.shape))
            (n % 2 ? sphere->centre.x : sphere->centre.z) = kEdge + edits.uniform(-3, 3);
        for (size_t i = 0; i < 4; ++i) sets[i] = edited(sets[i], {int32_t(i) % 2, 0, int32_t(i) / 2}, edit).value();
        formula = after(formula, edit);
    }
    const test::Ground ground{formula, kEdge, kEditVoxel};
    float error = 0;
    std::vector<Mesh> chunks;
    for (const LevelSet& set : sets) {
        chunks.push_back(terrainMesh(set));
        error = std::max(error, chunks.back().levels.back().error);
    }
    for (size_t shift = 0; shift < 2; ++shift) {
        // Creases, which edits leave everywhere, are rounded off by up to a voxel.
        const double bound = error + kEditVoxel;
        int rays = 0;
        EXPECT_EQ(leaks(quilt(chunks, ground, shift, test::Cut::kNothing), ground, bound, rays), 0) << "shift " << shift;
        EXPECT_GT(rays, 2000);
        EXPECT_GT(leaks(quilt(chunks, ground, shift, test::Cut::kSkirtsAndOverlap), ground, bound, rays), 20);
    }
}

}  // namespace
}  // namespace world
