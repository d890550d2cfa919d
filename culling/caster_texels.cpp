#include "culling/caster_texels.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <tuple>

namespace culling {

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Texels from `first` up to `last`, both within.
struct TexelRange {
    glm::ivec2 first{0}, last{-1};
    glm::ivec2 size() const { return glm::max(last - first + 1, 0); }
};

/// Those of a map whose centres lie in [min, max] [texels]; of numbers, not NaN.
TexelRange rangeOf(glm::dvec2 min, glm::dvec2 max, int side) {
    return {glm::ivec2(glm::clamp(glm::ceil(min - 0.5), 0.0, double(side))),
            glm::ivec2(glm::clamp(glm::floor(max - 0.5), -1.0, side - 1.0))};
}

double cross(glm::dvec2 a, glm::dvec2 b) { return a.x * b.y - a.y * b.x; }

/// `visit(texel, depth)` for each centre within a triangle or on its edges.
///   corners  x and y [texels] from the map's low corner, z [m]
template <class Visit>
void eachCentre(const std::array<glm::dvec3, 3>& corners, int side, Visit visit) {
    const glm::dvec2 a(corners[0]), b(corners[1]), c(corners[2]);
    const double area = cross(b - a, c - a);
    if (!(std::abs(area) > 0)) return;  // seen edge on
    const TexelRange range = rangeOf(glm::min(glm::min(a, b), c), glm::max(glm::max(a, b), c), side);
    const auto weightsAt = [&](glm::dvec2 p) {
        return glm::dvec3(cross(c - b, p - b), cross(a - c, p - c), cross(b - a, p - a)) / area;
    };
    const glm::dvec3 along = glm::dvec3(b.y - c.y, c.y - a.y, a.y - b.y) / area;  // what x adds to the weights
    for (int y = range.first.y; y <= range.last.y; ++y) {
        // The row's span, widened by a texel: the weights themselves decide.
        const glm::dvec3 begin = weightsAt({range.first.x + 0.5, y + 0.5});
        double first = 0, last = range.last.x - range.first.x;
        for (int edge = 0; edge < 3; ++edge) {
            if (along[edge] > 0) first = std::max(first, -begin[edge] / along[edge] - 1);
            if (along[edge] < 0) last = std::min(last, -begin[edge] / along[edge] + 1);
        }
        if (first > last) continue;
        for (int x = range.first.x + int(first); x <= range.first.x + int(last); ++x) {
            const glm::dvec3 weights = weightsAt({x + 0.5, y + 0.5});
            if (weights.x < 0 || weights.y < 0 || weights.z < 0) continue;
            visit(glm::ivec2(x, y), glm::dot(weights, glm::dvec3(corners[0].z, corners[1].z, corners[2].z)));
        }
    }
}

}  // namespace

std::vector<CasterTexel> texelsOf(const world::CasterTable& table, const LightCasters& light, const MapTexels& map,
                                  world::CasterId caster) {
    const double texel = light.cascades()[static_cast<size_t>(map.cascade)].texel;
    const LightCaster& placed = light[caster];
    const glm::dvec2 low(map.low);
    const TexelRange all = rangeOf(glm::dvec2(placed.bounds.min) / texel - low,
                                   glm::dvec2(placed.bounds.max) / texel - low, map.side);
    const glm::ivec2 size = all.size();
    std::vector<double> depths(size_t(size.x) * size_t(size.y), kInfinity);
    const world::MeshLevel& level = table.meshOf(caster).levels[static_cast<size_t>(light.level(caster, map.cascade))];
    const auto corner = [&](uint32_t index) {
        const glm::dvec3 p = placed.lightFromMesh * glm::dvec3(level.positions[index]) + placed.origin;
        return glm::dvec3(glm::dvec2(p) / texel - low, p.z);
    };
    const glm::dvec2 from = low * texel - glm::dvec2(placed.origin), to = from + map.side * texel;
    eachMeeting(light.rects(caster, map.cascade).rows, {roundedDown(from.x), roundedDown(from.y)},
                {roundedUp(to.x), roundedUp(to.y)}, [&](size_t k) {
        const world::Cluster& cluster = level.clusters[k];
        const uint32_t* index = level.indices.data() + cluster.firstIndex;
        for (const uint32_t* end = index + cluster.indexCount; index != end; index += 3)
            eachCentre({corner(index[0]), corner(index[1]), corner(index[2])}, map.side, [&](glm::ivec2 at, double depth) {
                // Bounds are of the same corners, but for what rounding does to them.
                at = glm::clamp(at, all.first, all.last) - all.first;
                double& nearest = depths[size_t(at.y) * size_t(size.x) + size_t(at.x)];
                nearest = std::min(nearest, depth);
            });
    });
    std::vector<CasterTexel> texels;
    for (int y = 0; y < size.y; ++y)
        for (int x = 0; x < size.x; ++x)
            if (const double depth = depths[size_t(y) * size_t(size.x) + size_t(x)]; depth < kInfinity)
                texels.push_back({all.first + glm::ivec2(x, y), depth});
    return texels;
}

std::vector<world::CasterId> ownersOf(const world::CasterTable& table, const LightCasters& light, const MapTexels& map,
                                      std::span<const world::CasterId> casters) {
    struct Nearest {
        double depth = kInfinity;
        world::CasterId caster = 0;
        void offer(const Nearest& other) {
            if (std::tie(other.depth, other.caster) < std::tie(depth, caster)) *this = other;
        }
    };
    const size_t count = size_t(map.side) * size_t(map.side);
    tbb::enumerable_thread_specific<std::vector<Nearest>> each{std::vector<Nearest>(count)};
    tbb::parallel_for(size_t(0), casters.size(), [&](size_t k) {
        std::vector<Nearest>& nearest = each.local();
        for (const CasterTexel& t : texelsOf(table, light, map, casters[k]))
            nearest[size_t(t.texel.y) * size_t(map.side) + size_t(t.texel.x)].offer({t.depth, casters[k]});
    });
    std::vector<Nearest> all(count);
    for (const std::vector<Nearest>& some : each)
        for (size_t i = 0; i < count; ++i) all[i].offer(some[i]);
    std::vector<world::CasterId> owners;
    for (const Nearest& nearest : all)
        if (nearest.depth < kInfinity) owners.push_back(nearest.caster);
    std::sort(owners.begin(), owners.end());
    owners.erase(std::unique(owners.begin(), owners.end()), owners.end());
    return owners;
}

}  // namespace culling
