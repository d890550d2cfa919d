// tests/world/cracks.h — rays that find cracks between the meshes of four chunks, where a formula says solid.
#pragma once

#include <cmath>
#include <functional>
#include <limits>
#include <optional>
#include <random>
#include <vector>

#include "world/mesh.h"

namespace world::test {

/// What four chunks, of (0..1, 0, 0..1), show.
struct Ground {
    std::function<double(glm::dvec3)> distance;  ///< about the distance to the surface [m], positive in air
    double edge = 0;   ///< of a chunk [m]
    double voxel = 0;  ///< [m]
};

struct Triangle {
    glm::dvec3 a, b, c;
};

enum class Cut { kNothing, kSkirts, kSkirtsAndOverlap };

/// Chunk i of (0..1, 0, 0..1) at level i + shift of those it has, less what is cut. Every other one is
/// lowered by `sink` [m]: as if its error were that large there.
inline std::vector<Triangle> quilt(const std::vector<Mesh>& chunks, const Ground& ground, size_t shift, Cut cut,
                                   double sink = 0) {
    const double edge = ground.edge;
    const auto overColumn = [edge](glm::vec3 p) { return p.x >= 0 && p.z >= 0 && p.x <= edge && p.z <= edge; };
    std::vector<Triangle> out;
    for (size_t n = 0; n < chunks.size(); ++n) {
        const Mesh& mesh = chunks[n];
        const MeshLevel& level = mesh.levels[(n + shift) % mesh.levels.size()];
        const glm::dvec3 origin(double(n % 2) * edge, 0, double(n / 2) * edge);
        const glm::dvec3 shown = origin - glm::dvec3(0, n % 2 == n / 2 ? 0 : sink, 0);
        const double skirt = level.error + ground.voxel;  // what lies deeper hangs from a skirt
        for (size_t i = 0; i < level.indices.size(); i += 3) {
            const glm::vec3 a = level.positions[level.indices[i]], b = level.positions[level.indices[i + 1]],
                            c = level.positions[level.indices[i + 2]];
            const auto deep = [&](glm::vec3 p) {
                return ground.distance(origin + glm::dvec3(p)) < -skirt;
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
inline double hitAt(const Triangle& triangle, glm::dvec3 from, glm::dvec3 dir) {
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
inline std::optional<Ray> rayThrough(const Ground& ground, glm::dvec3 target, glm::dvec3 dir, double bound) {
    const double end = 2 * ground.edge - 4;
    const auto over = [end](glm::dvec3 p) {
        return p.x > 4 && p.z > 4 && p.x < end && p.z < end && std::abs(p.y) < 50;
    };
    double back = 0;
    while (over(target - dir * (back + 0.5))) back += 0.5;
    const glm::dvec3 from = target - dir * back;
    if (ground.distance(from) < bound) return {};
    for (double t = 0; over(from + dir * t); t += 0.1) {
        if (ground.distance(from + dir * t) < -bound) return Ray{from, t};
    }
    return {};
}

/// Near the quilt's seams and its surface, where the gaps between the sheets are.
inline glm::dvec3 randomTarget(const Ground& ground, std::mt19937& rng, double bound) {
    std::uniform_real_distribution<double> along(8, 2 * ground.edge - 8), across(-6, 6), height(-25, 25);
    for (;;) {
        glm::dvec3 p(ground.edge + across(rng), height(rng), along(rng));
        if (rng() % 2) std::swap(p.x, p.z);
        if (std::abs(ground.distance(p)) < bound) return p;
    }
}

/// Rays that get deeper than `bound` [m] into the formula's solid before they meet a triangle.
inline int leaks(const std::vector<Triangle>& triangles, const Ground& ground, double bound, int& rays) {
    std::mt19937 rng(11);
    int found = 0;
    rays = 0;
    for (const double elevation : {90.0, 45.0, 5.0}) {
        for (const double azimuth : {20.0, 110.0, 245.0}) {
            const double e = glm::radians(elevation), a = glm::radians(azimuth);
            const glm::dvec3 dir(std::cos(e) * std::cos(a), -std::sin(e), std::cos(e) * std::sin(a));
            const Beam beam(triangles, dir);
            for (int n = 0; n < 1000; ++n) {
                const auto ray = rayThrough(ground, randomTarget(ground, rng, bound), dir, bound);
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
inline int grazingLeaks(const std::vector<Triangle>& triangles, const Ground& ground, double bound, int& rays) {
    std::mt19937 rng(12);
    std::uniform_real_distribution<double> grazing(1, 12), around(0, 6.28);
    int found = 0;
    for (rays = 0; rays < 1500;) {
        const glm::dvec3 target = randomTarget(ground, rng, bound);
        const auto f = [&](glm::dvec3 d) {
            return ground.distance(target + d) - ground.distance(target - d);
        };
        const glm::dvec3 normal = glm::normalize(glm::dvec3(f({0.1, 0, 0}), f({0, 0.1, 0}), f({0, 0, 0.1})));
        const double turn = around(rng), dip = glm::radians(grazing(rng));
        const glm::dvec3 level = glm::cross(normal, glm::dvec3(std::cos(turn), 0, std::sin(turn)));
        if (glm::length(level) < 0.3) continue;
        const glm::dvec3 dir = glm::normalize(level) * std::cos(dip) - normal * std::sin(dip);
        const auto ray = rayThrough(ground, target, dir, bound);
        if (!ray) continue;
        ++rays;
        double first = std::numeric_limits<double>::infinity();
        for (const Triangle& t : triangles) first = std::min(first, hitAt(t, ray->from, dir));
        found += first > ray->deep;
    }
    return found;
}

}  // namespace world::test
