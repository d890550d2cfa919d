#include "culling/hidden_clusters.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>

#include "culling/coverage.h"

namespace culling {

namespace {

/// Depths nearer to each other than this share of the range are not told apart: a float depth in
/// [0, 1] and the arithmetic behind it are good to about 2^-22.
constexpr double kDepthShare = 1.0 / (1 << 20);

/// Room for positions computed in single precision, per texel of reach.
constexpr double kFloatShare = 1.0 / (1 << 21);

/// Places the corners of a caster's mesh on a cascade's lattice, relative to one of its texels.
class Placer {
public:
    Placer(const LightCaster& caster, double texel, glm::i64vec2 low) {
        const glm::dvec3 scale(1 / texel, 1 / texel, 1);
        for (int column = 0; column < 3; ++column) latticeFromMesh_[column] = caster.lightFromMesh[column] * scale;
        origin_ = caster.origin * scale - glm::dvec3(low, 0);
    }
    glm::dvec3 operator()(const glm::vec3& pMesh) const { return latticeFromMesh_ * glm::dvec3(pMesh) + origin_; }

private:
    glm::dmat3 latticeFromMesh_{1};
    glm::dvec3 origin_{0};
};

const world::MeshLevel& levelOf(const world::CasterTable& table, const LightCasters& light, world::CasterId caster,
                                int cascade) {
    return table.meshOf(caster).levels[static_cast<size_t>(light.level(caster, cascade))];
}

/// Room that a centre must have in a caster's triangles [texels]: corners can lie so far from a map's origin.
double marginOf(const LightCaster& caster, double texel, int side) {
    return kSnapTexels + (glm::length(caster.bounds.extent()) / texel + side) * kFloatShare;
}

int64_t tileOf(int64_t texel) { return (texel >= 0 ? texel : texel - (kTile - 1)) / kTile; }

/// The part of a footprint that lies in a tile.
struct Part {
    glm::i64vec2 tile{0};
    size_t asked = 0;  ///< index of the footprint
    std::vector<world::CasterId> occluders;  ///< empty: not hidden
};

/// A square of the lattice with something asked in it.
struct Tile {
    glm::i64vec2 tile{0};
    std::span<Part> parts;
    std::vector<world::CasterId> provers;  ///< whose bounds meet it

    glm::i64vec2 low() const { return tile * int64_t(kTile); }
};

bool rowMajor(glm::i64vec2 a, glm::i64vec2 b) { return std::tie(a.y, a.x) < std::tie(b.y, b.x); }

std::vector<Part> partsOf(std::span<const Footprint> asked) {
    std::vector<Part> parts;
    for (size_t i = 0; i < asked.size(); ++i) {
        const Footprint& f = asked[i];
        for (int64_t y = tileOf(f.low.y); y <= tileOf(f.high.y - 1); ++y)
            for (int64_t x = tileOf(f.low.x); x <= tileOf(f.high.x - 1); ++x) parts.push_back({{x, y}, i, {}});
    }
    std::stable_sort(parts.begin(), parts.end(),
                     [](const Part& a, const Part& b) { return rowMajor(a.tile, b.tile); });
    return parts;
}

std::vector<Tile> tilesOf(std::span<Part> parts) {
    std::vector<Tile> tiles;
    for (size_t first = 0, end = 0; first < parts.size(); first = end) {
        while (end < parts.size() && parts[end].tile == parts[first].tile) ++end;
        tiles.push_back({parts[first].tile, parts.subspan(first, end - first), {}});
    }
    return tiles;
}

/// Hands each prover to the tiles that its bounds meet.
void spread(std::span<const world::CasterId> provers, const LightCasters& light, int cascade, std::vector<Tile>& tiles) {
    const double edge = light.cascades()[static_cast<size_t>(cascade)].texel * kTile;  // [m]
    glm::dvec2 min(std::numeric_limits<double>::infinity()), max(-min);
    for (const Tile& tile : tiles) {
        min = glm::min(min, glm::dvec2(tile.tile) * edge);
        max = glm::max(max, glm::dvec2(tile.tile + int64_t(1)) * edge);
    }
    for (world::CasterId caster : provers) {
        const world::Box& bounds = light[caster].bounds;
        // A few of many casters are new in most frames: most of the others stand elsewhere.
        if (bounds.min.x > max.x || bounds.max.x < min.x || bounds.min.y > max.y || bounds.max.y < min.y) continue;
        if (!light.drawn(caster, cascade)) continue;
        const glm::i64vec2 first(glm::floor(glm::dvec2(bounds.min) / edge)), last(glm::floor(glm::dvec2(bounds.max) / edge));
        auto tile = tiles.begin();
        for (int64_t y = std::max(first.y, tiles.front().tile.y); y <= std::min(last.y, tiles.back().tile.y); ++y) {
            tile = std::lower_bound(tile, tiles.end(), glm::i64vec2(first.x, y),
                                    [](const Tile& a, glm::i64vec2 b) { return rowMajor(a.tile, b); });
            for (; tile != tiles.end() && tile->tile.y == y && tile->tile.x <= last.x; ++tile)
                tile->provers.push_back(caster);
        }
    }
}

/// The lattice texels that a cluster touches, grown by one; high excluded. They may be too many for integers.
struct Touched {
    glm::dvec2 low{0}, high{0};
    double area() const { return (high.x - low.x) * (high.y - low.y); }
};

Touched touched(const ClusterRect& rect, glm::dvec2 origin, double texel) {
    return {glm::floor((origin + glm::dvec2(rect.min)) / texel) - 1.0,
            glm::floor((origin + glm::dvec2(rect.max)) / texel) + 2.0};
}

/// How deep clusters that are asked about lie, texel by texel: what is no nearer, or elsewhere, proves nothing.
class Fronts {
public:
    void reset(glm::ivec2 size) {
        size_ = size;
        fronts_.assign(size_t(size.x) * size_t(size.y), -std::numeric_limits<double>::infinity());
    }
    void add(glm::ivec2 first, glm::ivec2 last, double front) {
        for (int y = first.y; y <= last.y; ++y)
            for (int x = first.x; x <= last.x; ++x) at(x, y) = std::max(at(x, y), front);
    }
    /// True if something that begins at `depth` may lie before what is asked about, at one of the texels.
    bool before(double depth, glm::ivec2 first, glm::ivec2 last) {
        for (int y = first.y; y <= last.y; ++y)
            for (int x = first.x; x <= last.x; ++x)
                if (depth < at(x, y)) return true;
        return false;
    }

private:
    double& at(int x, int y) { return fronts_[size_t(y) * size_t(size_.x) + size_t(x)]; }
    glm::ivec2 size_{0};
    std::vector<double> fronts_;
};

/// What one thread needs to answer tiles.
struct Scratch {
    Coverage coverage;
    Fronts fronts;
    std::vector<uint32_t> met;        ///< clusters
    std::vector<glm::dvec3> corners;  ///< of a whole level, placed
};

class Search {
public:
    Search(const world::CasterTable& table, const LightCasters& light, int cascade, std::span<const Footprint> asked,
           const SearchConfig& config)
        : table_(table), light_(light), cascade_(cascade), asked_(asked), config_(config),
          texel_(light.cascades()[static_cast<size_t>(cascade)].texel) {}

    /// Proves what covers the tile, and answers its parts.
    void answer(Tile& tile, Scratch& scratch) const;

private:
    void cover(world::CasterId caster, glm::i64vec2 low, Scratch& scratch) const;
    double nearest(const Footprint& footprint) const;

    const world::CasterTable& table_;
    const LightCasters& light_;
    int cascade_;
    std::span<const Footprint> asked_;
    SearchConfig config_;
    double texel_;
};

void Search::cover(world::CasterId caster, glm::i64vec2 low, Scratch& scratch) const {
    const world::MeshLevel& level = levelOf(table_, light_, caster, cascade_);
    const ClusterRects rects = light_.rects(caster, cascade_);
    const glm::dvec2 origin = glm::dvec2(light_[caster].origin) - glm::dvec2(low) * texel_;
    // Depth of a box of the mesh's frame.
    const glm::dmat3& linear = light_[caster].lightFromMesh;
    const glm::dvec3 deep(linear[0].z, linear[1].z, linear[2].z);
    scratch.met.clear();
    size_t corners = 0;
    for (uint32_t k = 0; k < rects.size(); ++k) {
        const glm::dvec2 min = origin + glm::dvec2(rects[k].min), max = origin + glm::dvec2(rects[k].max);
        const Coverage::Range range = scratch.coverage.range(min / texel_, max / texel_, 1);
        if (range.empty()) continue;
        const world::Cluster& cluster = level.clusters[k];
        const glm::dvec3 centre = 0.5 * (glm::dvec3(cluster.min) + glm::dvec3(cluster.max));
        const double nearest = light_[caster].origin.z + glm::dot(deep, centre) -
                               glm::dot(glm::abs(deep), glm::dvec3(cluster.max) - centre);
        if (!scratch.fronts.before(nearest, range.first, range.last)) continue;
        scratch.met.push_back(k);
        corners += level.clusters[k].indexCount;
    }
    const double margin = marginOf(light_[caster], texel_, config_.side);
    const auto addClusters = [&](const auto& corner) {
        for (uint32_t k : scratch.met) {
            const world::Cluster& cluster = level.clusters[k];
            const uint32_t* index = level.indices.data() + cluster.firstIndex;
            for (const uint32_t* end = index + cluster.indexCount; index != end; index += 3)
                scratch.coverage.add(caster, {corner(index[0]), corner(index[1]), corner(index[2])}, margin);
        }
    };
    const Placer place(light_[caster], texel_, low);
    if (corners < level.positions.size()) return addClusters([&](uint32_t v) { return place(level.positions[v]); });
    // Triangles share corners: placed once they cost a third.
    scratch.corners.clear();
    for (const glm::vec3& p : level.positions) scratch.corners.push_back(place(p));
    addClusters([&](uint32_t v) { return scratch.corners[v]; });
}

/// The nearest depth at which a rasteriser can put the cluster [m]; minus infinity if that is not bounded.
double Search::nearest(const Footprint& footprint) const {
    const world::MeshLevel& level = levelOf(table_, light_, footprint.caster, cascade_);
    const double margin = marginOf(light_[footprint.caster], texel_, config_.side);
    const Placer place(light_[footprint.caster], texel_, footprint.low);
    const world::Cluster& cluster = level.clusters[footprint.cluster];
    double nearest = footprint.front;
    for (uint32_t i = cluster.firstIndex; i < cluster.firstIndex + cluster.indexCount; i += 3) {
        PlacedTriangle triangle;
        for (uint32_t k = 0; k < 3; ++k) triangle[k] = place(level.positions[level.indices[i + k]]);
        nearest = std::min(nearest, std::min({triangle[0].z, triangle[1].z, triangle[2].z}) - depthSlope(triangle) * margin);
    }
    return nearest;
}

void Search::answer(Tile& tile, Scratch& scratch) const {
    Coverage& coverage = scratch.coverage;
    glm::i64vec2 low = tile.low() + int64_t(kTile), high = tile.low();
    for (const Part& part : tile.parts) {
        low = glm::min(low, glm::max(asked_[part.asked].low, tile.low()));
        high = glm::max(high, glm::min(asked_[part.asked].high, tile.low() + int64_t(kTile)));
    }
    coverage.reset(glm::ivec2(high - low));
    scratch.fronts.reset(glm::ivec2(high - low));
    for (const Part& part : tile.parts) {
        const Footprint& f = asked_[part.asked];
        scratch.fronts.add(glm::max(f.low, low) - low, glm::min(f.high, high) - low - int64_t(1), f.front);
    }
    for (world::CasterId caster : tile.provers) cover(caster, low, scratch);
    coverage.join();
    const double room = 2 * config_.depthRange * kDepthShare;  // of the cluster's depth and of the occluder's
    for (Part& part : tile.parts) {
        const Footprint& f = asked_[part.asked];
        const glm::ivec2 first(glm::max(f.low, low) - low), last(glm::min(f.high, high) - low - int64_t(1));
        // Most have an open texel, and are spared the slopes.
        if (!coverage.nearer(first, last, f.front - room) || !coverage.nearer(first, last, nearest(f) - room)) continue;
        for (int y = first.y; y <= last.y; ++y)
            for (int x = first.x; x <= last.x; ++x) {
                const world::CasterId occluder = coverage.caster({x, y});
                if (part.occluders.empty() || part.occluders.back() != occluder) part.occluders.push_back(occluder);
            }
    }
}

}  // namespace

std::vector<Footprint> footprints(const world::CasterTable& table, const LightCasters& light, int cascade,
                                  std::span<const world::CasterId> casters, uint32_t raysPerCluster) {
    const double texel = light.cascades()[static_cast<size_t>(cascade)].texel;
    std::vector<std::vector<Footprint>> each(casters.size());
    tbb::parallel_for(size_t(0), casters.size(), [&](size_t at) {
        const world::CasterId caster = casters[at];
        const ClusterRects rects = light.rects(caster, cascade);
        const glm::dvec2 origin(light[caster].origin);
        const world::MeshLevel& level = levelOf(table, light, caster, cascade);
        const Placer place(light[caster], texel, glm::i64vec2(0));
        for (uint32_t k = 0; k < rects.size(); ++k) {
            const Touched t = touched(rects[k], origin, texel);
            if (!(t.area() <= double(raysPerCluster))) continue;
            Footprint f{caster, k, glm::i64vec2(t.low), glm::i64vec2(t.high), std::numeric_limits<double>::infinity()};
            const world::Cluster& cluster = level.clusters[k];
            for (uint32_t i = cluster.firstIndex; i < cluster.firstIndex + cluster.indexCount; ++i)
                f.front = std::min(f.front, place(level.positions[level.indices[i]]).z);
            each[at].push_back(f);
        }
    });
    std::vector<Footprint> all;
    for (const auto& some : each) all.insert(all.end(), some.begin(), some.end());
    return all;
}

uint64_t raysOf(const LightCasters& light, int cascade, world::CasterId caster, uint32_t raysPerCluster) {
    const double texel = light.cascades()[static_cast<size_t>(cascade)].texel;
    const ClusterRects rects = light.rects(caster, cascade);
    uint64_t rays = 0;
    for (size_t k = 0; k < rects.size(); ++k)
        if (const double area = touched(rects[k], glm::dvec2(light[caster].origin), texel).area();
            area <= double(raysPerCluster))
            rays += static_cast<uint64_t>(area);
    return rays;
}

std::vector<HiddenCluster> hiddenClusters(const world::CasterTable& table, const LightCasters& light, int cascade,
                                          std::span<const Footprint> asked, std::span<const world::CasterId> provers,
                                          const SearchConfig& config) {
    if (asked.empty()) return {};
    std::vector<Part> parts = partsOf(asked);
    std::vector<Tile> tiles = tilesOf(parts);
    spread(provers, light, cascade, tiles);
    const Search search(table, light, cascade, asked, config);
    tbb::parallel_for(size_t(0), tiles.size(), [&](size_t i) {
        // Kept from frame to frame: else the system would be asked for its pages, and clear them, in each.
        static thread_local Scratch scratch;
        search.answer(tiles[i], scratch);
    });

    std::vector<uint32_t> open(asked.size(), 0);
    std::vector<HiddenCluster> found(asked.size());
    for (const Part& part : parts) {
        open[part.asked] += part.occluders.empty();
        auto& occluders = found[part.asked].occluders;
        occluders.insert(occluders.end(), part.occluders.begin(), part.occluders.end());
    }
    std::vector<HiddenCluster> hidden;
    for (size_t i = 0; i < asked.size(); ++i) {
        if (open[i]) continue;
        auto& occluders = found[i].occluders;
        std::sort(occluders.begin(), occluders.end());
        occluders.erase(std::unique(occluders.begin(), occluders.end()), occluders.end());
        hidden.push_back({asked[i].caster, asked[i].cluster, std::move(occluders)});
    }
    return hidden;
}

}  // namespace culling
