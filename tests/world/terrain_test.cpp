// tests/world/terrain_test.cpp — chunk meshes: true to the band, no cracks between any levels.
#include "world/terrain.h"

#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <limits>
#include <map>

#include "tests/world/cracks.h"
#include "tests/world/terrain_fields.h"
#include "world/band.h"
#include "world/contour.h"
#include "world/triangle_grid.h"

namespace world {
namespace {

constexpr int32_t kSide = 32;
constexpr double kVoxel = 2;
constexpr double kEdge = kSide * kVoxel;

TerrainField hills() { return test::fieldOf(test::hillsWithCave, -60, 60); }

TerrainChunk chunkOf(ChunkKey key) {
    Result<std::optional<TerrainChunk>> made = makeTerrain(hills(), key, kSide, kVoxel);
    return *made.value();
}

bool overColumn(glm::vec3 p) { return p.x >= 0 && p.z >= 0 && p.x <= kEdge && p.z <= kEdge; }

TEST(Terrain, DecodedBandGivesTheBakedMeshAgain) {
    const TerrainChunk chunk = chunkOf({0, 0, 0});
    Result<LevelSet> set = decodeLevelSet(chunk.levelSet);
    ASSERT_TRUE(set);
    EXPECT_TRUE(test::sameMesh(meshLevelSet(set.value()), chunk.mesh));
}

TEST(Terrain, LevelsShrinkAndErrorsAscend) {
    for (int x = 0; x < 2; ++x) {
        const TerrainChunk chunk = chunkOf({x, 0, 0});
        ASSERT_GE(chunk.mesh.levels.size(), 3u);
        EXPECT_EQ(chunk.mesh.levels[0].error, 0);
        for (size_t i = 0; i < chunk.mesh.levels.size(); ++i) {
            const MeshLevel& level = chunk.mesh.levels[i];
            for (const uint32_t v : level.indices) ASSERT_LT(v, level.positions.size());
            for (const glm::vec3& p : level.positions) ASSERT_TRUE(std::isfinite(p.x + p.y + p.z));
            ASSERT_LT(level.error, kBandVoxels * kVoxel);
            if (i == 0) continue;
            EXPECT_GT(level.error, chunk.mesh.levels[i - 1].error);
            EXPECT_LT(level.indices.size(), 0.75 * double(chunk.mesh.levels[i - 1].indices.size()))
                << "level " << i << ": 0.6 without the skirts, which shrink less";
        }
    }
}

TEST(Terrain, ErrorIsNoLessThanTheDumbMeasure) {
    const TerrainChunk chunk = chunkOf({0, 0, 0});
    const MeshLevel& finest = chunk.mesh.levels[0];
    const auto distance = [](glm::vec3 p, const MeshLevel& to) {
        float best = std::numeric_limits<float>::infinity();
        for (size_t i = 0; i < to.indices.size(); i += 3) {
            const glm::vec3 q =
                nearestOnTriangle(p, to.positions[to.indices[i]], to.positions[to.indices[i + 1]],
                                  to.positions[to.indices[i + 2]]);
            if (!std::isnan(q.x)) best = std::min(best, glm::distance(p, q));
        }
        return best;
    };
    for (size_t i = 1; i < chunk.mesh.levels.size(); ++i) {
        const MeshLevel& level = chunk.mesh.levels[i];
        float worst = 0;
        // Skirts reach below the surface: only what lies near the band's zero is compared, and those
        // vertices were all there when the error was measured.
        const Band band = unpack(decodeLevelSet(chunk.levelSet).value());
        for (const glm::vec3& p : level.positions) {
            if (overColumn(p) && std::abs(band.probe(p / float(kVoxel))) * kVoxel <= level.error) {
                worst = std::max(worst, distance(p, finest));
            }
        }
        for (const glm::vec3& p : finest.positions) {
            if (overColumn(p) && std::abs(band.probe(p / float(kVoxel))) < 0.5) {
                worst = std::max(worst, distance(p, level));
            }
        }
        EXPECT_LE(worst, level.error * 1.0001f) << "level " << i;
        EXPECT_GE(worst, 0.3f * level.error) << "level " << i << ": an error that is not a wild guess";
    }
}

TEST(Terrain, FinestLevelFollowsTheFormula) {
    const TerrainChunk chunk = chunkOf({1, 0, 0});
    const MeshLevel& level = chunk.mesh.levels[0];
    size_t faces = 0, turned = 0;
    for (size_t i = 0; i < level.indices.size(); i += 3) {
        const glm::dvec3 a = level.positions[level.indices[i]], b = level.positions[level.indices[i + 1]],
                         c = level.positions[level.indices[i + 2]];
        const glm::dvec3 centre = (a + b + c) / 3.0 + glm::dvec3(kEdge, 0, 0);
        const double f = test::hillsWithCave(centre);
        if (std::abs(f) > 1) continue;  // skirts, judged by the rays below
        ++faces;
        const glm::dvec3 normal = glm::normalize(glm::cross(b - a, c - a));
        turned += test::hillsWithCave(centre + normal * 0.3) < f;
    }
    EXPECT_GT(faces, level.indices.size() / 3 / 2);
    EXPECT_LT(turned, faces / 100) << "faces look into the solid (a few at the cave's sharp mouth may)";
    for (const glm::vec3& p : level.positions) {
        if (!overColumn(p)) continue;
        // A vertex is the mean of crossings in one voxel: at the cave's mouth, a sharp crease, it may
        // be most of a voxel off.
        const double f = test::hillsWithCave(glm::dvec3(p) + glm::dvec3(kEdge, 0, 0));
        if (f > -2 * kVoxel) {
            EXPECT_LT(std::abs(f), kVoxel);
        }
    }
}

TEST(Terrain, IsClosedButForTheRim) {
    const TerrainChunk chunk = chunkOf({0, 0, 0});
    for (const MeshLevel& level : chunk.mesh.levels) {
        std::map<std::pair<uint32_t, uint32_t>, int> uses;
        for (size_t i = 0; i < level.indices.size(); i += 3) {
            for (size_t k = 0; k < 3; ++k) {
                const auto [low, high] = std::minmax(level.indices[i + k], level.indices[i + (k + 1) % 3]);
                ++uses[{low, high}];
            }
        }
        for (const auto& [edge, count] : uses) {
            if (count > 1) continue;
            // Skirts start at least half a voxel outside, and turn inwards by at most their depth.
            const glm::vec3 p = level.positions[edge.first];
            const float inside = std::min({p.x, p.z, float(kEdge) - p.x, float(kEdge) - p.z});
            ASSERT_LT(inside, 2 * kBandVoxels * kVoxel);
            // A skirt that meets the far side of thin solid ends within half a voxel of it.
            ASSERT_LT(test::hillsWithCave(p), 0.5 * kVoxel) << "an open edge that is no skirt's bottom";
        }
    }
}

TEST(Terrain, NeighboursKnowTheSameSamples) {
    const Band a = unpack(sampleLevelSet(hills(), {0, 0, 0}, kSide, kVoxel).value());
    const Band b = unpack(sampleLevelSet(hills(), {1, 0, 0}, kSide, kVoxel).value());
    const int dy = b.bottom - a.bottom;
    for (int x = kSide; x < a.count.x; ++x) {
        for (int z = 0; z < a.count.z; ++z) {
            for (int y = 0; y < a.count.y; ++y) {
                if (y - dy < 0 || y - dy >= b.count.y) continue;
                ASSERT_EQ(a.at(x, y, z), b.at(x - kSide, y - dy, z));
            }
        }
    }
}

TEST(Terrain, IsTheSameAThousandKilometresAway) {
    const ChunkKey far{16384, 0, -15625};  // 1049 km east, 1000 km north; exact in double
    const TerrainField moved = test::fieldOf(
        [&](glm::dvec3 p) { return test::hillsWithCave(p - glm::dvec3(far.x, 0, far.z) * kEdge); }, -60, 60);
    const auto here = makeTerrain(hills(), {0, 0, 0}, kSide, kVoxel);
    const auto there = makeTerrain(moved, far, kSide, kVoxel);
    EXPECT_EQ(here.value()->levelSet, there.value()->levelSet);
    EXPECT_TRUE(test::sameMesh(here.value()->mesh, there.value()->mesh));
}

TEST(Terrain, DoesNotDependOnThreads) {
    const Mesh expected = chunkOf({0, 0, 0}).mesh;
    for (const int threads : {1, 2, 7}) {
        tbb::task_arena arena(threads);
        Mesh mesh;
        arena.execute([&] { mesh = chunkOf({0, 0, 0}).mesh; });
        EXPECT_TRUE(test::sameMesh(mesh, expected)) << threads << " threads";
    }
}

TEST(Terrain, EndsBeforeAVoidAndIsNothingInOne) {
    const auto half = [](glm::dvec3 p) { return p.x > 30 ? NAN : test::hillsWithCave(p); };
    const auto made = makeTerrain(test::fieldOf(half, -60, 60), {0, 0, 0}, kSide, kVoxel);
    ASSERT_TRUE(made.value());
    const Band band = unpack(decodeLevelSet(made.value()->levelSet).value());
    float reach = 0;  // of the surface; its skirt may lean outwards
    for (const glm::vec3& p : contour(band, columnsOf(band, kSide), 0, kVoxel).positions) {
        reach = std::max(reach, p.x);
    }
    // Samples lie at odd metres: the last known one is at 29, faces keep off by one and join the
    // cells around the last shown sample, at 28 on average.
    EXPECT_LE(reach, 30);
    EXPECT_GE(reach, 25);
    const auto none =
        makeTerrain(test::fieldOf([](glm::dvec3) { return NAN; }, -60, 60), {0, 0, 0}, kSide, kVoxel);
    ASSERT_TRUE(none);
    EXPECT_FALSE(none.value());
    const auto air = makeTerrain([](const LatticeRect&) { return FieldBlock{}; }, {0, 0, 0}, kSide, kVoxel);
    ASSERT_TRUE(air);
    EXPECT_FALSE(air.value());
}

TEST(Terrain, RefusesASurfaceThatIsTooTall) {
    const TerrainField tall = [](const LatticeRect&) {
        return FieldBlock{.firstY = 0, .countY = 1 << 24, .distance = {}};  // refused before it is read
    };
    const auto made = makeTerrain(tall, {3, 0, 4}, kSide, kVoxel);
    ASSERT_FALSE(made);
    EXPECT_EQ(made.error().code, ErrorCode::kLimit);
    EXPECT_NE(made.error().what.find("chunk (3,0,4)"), std::string::npos);
}

TEST(Terrain, LetsNoLightThroughBetweenLevels) {
    using test::Cut, test::quilt, test::leaks, test::grazingLeaks;
    const test::Ground ground{test::hillsWithCave, kEdge, kVoxel};
    float error = 0;
    std::vector<Mesh> chunks;
    for (int i = 0; i < 4; ++i) {
        chunks.push_back(chunkOf({i % 2, 0, i / 2}).mesh);
        error = std::max(error, chunks.back().levels.back().error);
    }
    int withoutSkirts = 0;
    for (size_t shift = 0; shift < 3; ++shift) {
        // What a coarse level may lie below the finest, and that below the formula (a voxel at creases).
        const double bound = error + kVoxel;
        int rays = 0;
        EXPECT_EQ(leaks(quilt(chunks, ground, shift, Cut::kNothing), ground, bound, rays), 0) << "shift " << shift;
        EXPECT_GT(rays, 4000);
        // The same rays find the cracks without skirts and overlap.
        EXPECT_GT(leaks(quilt(chunks, ground, shift, Cut::kSkirtsAndOverlap), ground, bound, rays), 20) << "shift " << shift;
        // The worst that the errors allow: skirts close what overlap leaves open.
        const double sink = 0.9 * kBandVoxels * kVoxel;
        EXPECT_EQ(grazingLeaks(quilt(chunks, ground, shift, Cut::kNothing, sink), ground, bound + sink, rays), 0)
            << "shift " << shift;
        withoutSkirts += grazingLeaks(quilt(chunks, ground, shift, Cut::kSkirts, sink), ground, bound + sink, rays);
    }
    EXPECT_GT(withoutSkirts, 20);
}

}  // namespace
}  // namespace world
