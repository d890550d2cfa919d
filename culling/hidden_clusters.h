// culling/hidden_clusters.h — the search for clusters that lie behind other casters at every texel.
// Source: our own construction. All questions are about rays that run side by side through the centres of
// one lattice, so a rasteriser answers them: a square of texels at a time, all triangles above it at once.
//
// A cluster is hidden in a cascade if at every texel centre of its footprint, grown by one texel, some
// other static caster, at the level that the cascade draws, lies nearer the sun than the cluster's own
// nearest depth. What covers a centre, and how deep, is proven in double precision with room for what a
// rasteriser may round (culling/coverage.h).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "culling/light_casters.h"
#include "world/casters.h"

namespace culling {

/// Texels are proven in squares of so many a side: what is known of one stays in a core's cache.
constexpr int kTile = 64;

struct SearchConfig {
    uint32_t raysPerCluster = 4096;  ///< a cluster whose footprint has more texels is simply drawn
    double depthRange = 1;           ///< metres of light space per unit of map depth
    int side = 1024;                 ///< map edge [texels]
};

/// The texels of a cluster, grown by one: a ray toward the sun is asked for from the centre of each.
struct Footprint {
    world::CasterId caster = 0;
    uint32_t cluster = 0;
    glm::i64vec2 low{0}, high{0};  ///< [lattice texels], high excluded
    double front = 0;              ///< depth of the corner nearest the sun [m]
    uint64_t rays() const { return uint64_t((high.x - low.x) * (high.y - low.y)); }
};

/// Footprints of at most `raysPerCluster` texels, in order of the casters and their clusters.
std::vector<Footprint> footprints(const world::CasterTable& table, const LightCasters& light, int cascade,
                                  std::span<const world::CasterId> casters, uint32_t raysPerCluster);

/// Rays that these ask for together, without what it takes to find their depths.
uint64_t raysOf(const LightCasters& light, int cascade, world::CasterId caster, uint32_t raysPerCluster);

struct HiddenCluster {
    world::CasterId caster = 0;
    uint32_t cluster = 0;
    std::vector<world::CasterId> occluders;  ///< those that prove it; ascending, unique
};

/// Those of the footprints that `provers` hide; a caster may hide its own clusters. In the order of the
/// footprints. Runs on all of TBB's threads and gives the same answer for any number of them. Each thread keeps the
/// memory that its largest search took, until it ends.
std::vector<HiddenCluster> hiddenClusters(const world::CasterTable& table, const LightCasters& light, int cascade,
                                          std::span<const Footprint> asked, std::span<const world::CasterId> provers,
                                          const SearchConfig& config);

}  // namespace culling
