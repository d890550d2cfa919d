// tests/world/terrain_test.cpp — chunk meshes: true to the band, no cracks between any levels.
#include "world/terrain.h"

#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <limits>
#include <map>
#include <optional>
#include <random>

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

bool sameMesh(const Mesh& a, const Mesh& b) {
    if (a.levels.size() != b.levels.size()) return false;
    for (size_t i = 0; i < a.levels.size(); ++i) {
        if (a.levels[i].error != b.levels[i].error || a.levels[i].positions != b.levels[i].positions ||
            a.levels[i].indices != b.levels[i].indices) {
            return false;
        }
    }
    return true;
}

bool overColumn(glm::vec3 p) { return p.x >= 0 && p.z >= 0 && p.x <= kEdge && p.z <= kEdge; }

TEST(Terrain, DecodedBandGivesTheBakedMeshAgain) {
    const TerrainChunk chunk = chunkOf({0, 0, 0});
    Result<LevelSet> set = decodeLevelSet(chunk.levelSet);
    ASSERT_TRUE(set);
    EXPECT_TRUE(sameMesh(meshLevelSet(set.value()), chunk.mesh));
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
            ASSERT_LT(inside, chunk.mesh.levels.back().error + kBandVoxels * kVoxel);
            // A skirt that meets the far side of thin solid ends within half a voxel of it.
            ASSERT_LT(test::hillsWithCave(p), 0.5 * kVoxel) << "an open edge that is no skirt's bottom";
        }
    }
}

TEST(Terrain, NeighboursKnowTheSameSamples) {
    const Band a = unpack(sampleLevelSet(hills(), {0, 0, 0}, kSide, kVoxel).value());
    const Band b = unpack(sampleLevelSet(hills(), {1, 0, 0}, kSide, kVoxel).value());
    const int dy = static_cast<int>(b.low.y - a.low.y);
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
    EXPECT_TRUE(sameMesh(here.value()->mesh, there.value()->mesh));
}

TEST(Terrain, DoesNotDependOnThreads) {
    const Mesh expected = chunkOf({0, 0, 0}).mesh;
    for (const int threads : {1, 2, 7}) {
        tbb::task_arena arena(threads);
        Mesh mesh;
        arena.execute([&] { mesh = chunkOf({0, 0, 0}).mesh; });
        EXPECT_TRUE(sameMesh(mesh, expected)) << threads << " threads";
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

// ---- cracks ----

struct Triangle {
    glm::dvec3 a, b, c;
};

enum class Cut { kNothing, kSkirts, kSkirtsAndOverlap };

/// Chunk i of (0..1, 0, 0..1) at level i + shift of those it has, less what is cut. Every other one is
/// lowered by `sink` [m]: as if its error were that large there.
std::vector<Triangle> quilt(const std::vector<TerrainChunk>& chunks, size_t shift, Cut cut, double sink = 0) {
    std::vector<Triangle> out;
    for (size_t n = 0; n < chunks.size(); ++n) {
        const Mesh& mesh = chunks[n].mesh;
        const MeshLevel& level = mesh.levels[(n + shift) % mesh.levels.size()];
        const glm::dvec3 origin(double(n % 2) * kEdge, 0, double(n / 2) * kEdge);
        const glm::dvec3 shown = origin - glm::dvec3(0, n % 2 == n / 2 ? 0 : sink, 0);
        const double skirt = level.error + kVoxel;  // what lies deeper hangs from a skirt
        for (size_t i = 0; i < level.indices.size(); i += 3) {
            const glm::vec3 a = level.positions[level.indices[i]], b = level.positions[level.indices[i + 1]],
                            c = level.positions[level.indices[i + 2]];
            const auto deep = [&](glm::vec3 p) {
                return test::hillsWithCave(origin + glm::dvec3(p)) < -skirt;
            };
            if (cut != Cut::kNothing && (deep(a) || deep(b) || deep(c))) continue;
            // Skirts and overlap both begin outside the column.
            if (cut == Cut::kSkirtsAndOverlap && !(overColumn(a) && overColumn(b) && overColumn(c))) continue;
            out.push_back({glm::dvec3(a) + shown, glm::dvec3(b) + shown, glm::dvec3(c) + shown});
        }
    }
    return out;
}

/// Distance along the ray, infinite for a miss; both sides count.
double hitAt(const Triangle& triangle, glm::dvec3 from, glm::dvec3 dir) {
    constexpr double kMiss = std::numeric_limits<double>::infinity();
    const glm::dvec3 ab = triangle.b - triangle.a, ac = triangle.c - triangle.a, p = glm::cross(dir, ac);
    const double det = glm::dot(ab, p);
    if (det == 0) return kMiss;
    const glm::dvec3 o = from - triangle.a, q = glm::cross(o, ab);
    const double along = glm::dot(o, p) / det, across = glm::dot(dir, q) / det;
    if (along < 0 || across < 0 || along + across > 1) return kMiss;
    const double t = glm::dot(ac, q) / det;
    return t > 0 ? t : kMiss;
}

/// Triangles seen along one direction: each with its bounds across it, which most rays miss.
struct Beam {
    glm::dvec3 dir, u, v;
    struct Seen {
        Triangle t;
        glm::dvec2 low, high;
    };
    std::vector<Seen> seen;

    Beam(const std::vector<Triangle>& triangles, glm::dvec3 along) : dir(along) {
        u = glm::normalize(glm::cross(dir, glm::dvec3(0.31, 0.2, 0.93)));
        v = glm::cross(dir, u);
        for (const Triangle& t : triangles) {
            const glm::dvec2 a = flat(t.a), b = flat(t.b), c = flat(t.c);
            seen.push_back({t, glm::min(a, glm::min(b, c)), glm::max(a, glm::max(b, c))});
        }
    }
    glm::dvec2 flat(glm::dvec3 p) const { return {glm::dot(p, u), glm::dot(p, v)}; }

    double firstHit(glm::dvec3 from) const {
        const glm::dvec2 at = flat(from);
        double first = std::numeric_limits<double>::infinity();
        for (const Seen& s : seen) {
            if (at.x < s.low.x || at.x > s.high.x || at.y < s.low.y || at.y > s.high.y) continue;
            first = std::min(first, hitAt(s.t, from, dir));
        }
        return first;
    }
};

struct Ray {
    glm::dvec3 from;
    double deep;  ///< where it is `bound` below the formula's surface
};

/// The ray through `target` from as far back towards the sun as the quilt goes, if it starts in the
/// air and gets deep inside the quilt.
std::optional<Ray> rayThrough(glm::dvec3 target, glm::dvec3 dir, double bound) {
    const auto over = [](glm::dvec3 p) {
        return p.x > 4 && p.z > 4 && p.x < 2 * kEdge - 4 && p.z < 2 * kEdge - 4 && std::abs(p.y) < 50;
    };
    double back = 0;
    while (over(target - dir * (back + 0.5))) back += 0.5;
    const glm::dvec3 from = target - dir * back;
    if (test::hillsWithCave(from) < bound) return {};
    for (double t = 0; over(from + dir * t); t += 0.1) {
        if (test::hillsWithCave(from + dir * t) < -bound) return Ray{from, t};
    }
    return {};
}

/// Near the quilt's seams and its surface, where the gaps between the sheets are.
glm::dvec3 randomTarget(std::mt19937& rng, double bound) {
    std::uniform_real_distribution<double> along(8, 2 * kEdge - 8), across(-6, 6), height(-25, 25);
    for (;;) {
        glm::dvec3 p(kEdge + across(rng), height(rng), along(rng));
        if (rng() % 2) std::swap(p.x, p.z);
        if (std::abs(test::hillsWithCave(p)) < bound) return p;
    }
}

/// Rays that get deeper than `bound` [m] into the formula's solid before they meet a triangle.
int leaks(const std::vector<Triangle>& triangles, double bound, int& rays) {
    std::mt19937 rng(11);
    int found = 0;
    rays = 0;
    for (const double elevation : {90.0, 45.0, 5.0}) {
        for (const double azimuth : {20.0, 110.0, 245.0}) {
            const double e = glm::radians(elevation), a = glm::radians(azimuth);
            const glm::dvec3 dir(std::cos(e) * std::cos(a), -std::sin(e), std::cos(e) * std::sin(a));
            const Beam beam(triangles, dir);
            for (int n = 0; n < 1000; ++n) {
                const auto ray = rayThrough(randomTarget(rng, bound), dir, bound);
                if (!ray) continue;
                ++rays;
                found += beam.firstHit(ray->from) > ray->deep;
            }
        }
    }
    return found;
}

/// The same with rays that graze the surface by 1 to 12 degrees across a seam: the only ones that fit
/// between two sheets that overlap.
int grazingLeaks(const std::vector<Triangle>& triangles, double bound, int& rays) {
    std::mt19937 rng(12);
    std::uniform_real_distribution<double> grazing(1, 12), around(0, 6.28);
    int found = 0;
    for (rays = 0; rays < 1500;) {
        const glm::dvec3 target = randomTarget(rng, bound);
        const auto f = [&](glm::dvec3 d) {
            return test::hillsWithCave(target + d) - test::hillsWithCave(target - d);
        };
        const glm::dvec3 normal = glm::normalize(glm::dvec3(f({0.1, 0, 0}), f({0, 0.1, 0}), f({0, 0, 0.1})));
        const double turn = around(rng), dip = glm::radians(grazing(rng));
        const glm::dvec3 level = glm::cross(normal, glm::dvec3(std::cos(turn), 0, std::sin(turn)));
        if (glm::length(level) < 0.3) continue;
        const glm::dvec3 dir = glm::normalize(level) * std::cos(dip) - normal * std::sin(dip);
        const auto ray = rayThrough(target, dir, bound);
        if (!ray) continue;
        ++rays;
        double first = std::numeric_limits<double>::infinity();
        for (const Triangle& t : triangles) first = std::min(first, hitAt(t, ray->from, dir));
        found += first > ray->deep;
    }
    return found;
}

TEST(Terrain, LetsNoLightThroughBetweenLevels) {
    float error = 0;
    std::vector<TerrainChunk> chunks;
    for (int i = 0; i < 4; ++i) {
        chunks.push_back(chunkOf({i % 2, 0, i / 2}));
        error = std::max(error, chunks.back().mesh.levels.back().error);
    }
    int withoutSkirts = 0;
    for (size_t shift = 0; shift < 3; ++shift) {
        // What a coarse level may lie below the finest, and that below the formula (a voxel at creases).
        const double bound = error + kVoxel;
        int rays = 0;
        EXPECT_EQ(leaks(quilt(chunks, shift, Cut::kNothing), bound, rays), 0) << "shift " << shift;
        EXPECT_GT(rays, 4000);
        // The same rays find the cracks without skirts and overlap.
        EXPECT_GT(leaks(quilt(chunks, shift, Cut::kSkirtsAndOverlap), bound, rays), 20) << "shift " << shift;
        // The worst that the errors allow: skirts close what overlap leaves open.
        const double sink = 0.9 * kBandVoxels * kVoxel;
        EXPECT_EQ(grazingLeaks(quilt(chunks, shift, Cut::kNothing, sink), bound + sink, rays), 0)
            << "shift " << shift;
        withoutSkirts += grazingLeaks(quilt(chunks, shift, Cut::kSkirts, sink), bound + sink, rays);
    }
    EXPECT_GT(withoutSkirts, 20);
}

}  // namespace
}  // namespace world
