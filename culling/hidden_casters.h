// culling/hidden_casters.h — casters that one map need not draw, with proof at every texel: what certificates
// (culling/occlusion.h) say of whole casters.
// Source: our own construction.
#pragma once

#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "culling/caster_texels.h"
#include "culling/hidden_clusters.h"
#include "world/octree.h"

namespace culling {

/// What a search for hidden casters came to.
struct HiddenCasters {
    std::vector<world::CasterId> casters;  ///< in the order in which they were asked about
    uint64_t rays = 0;                     ///< that were shot, or texel centres asked about
};

struct ProvenHidden {
    HiddenCasters whole;
    /// Of these casters and of others, ascending.
    std::vector<std::pair<world::CasterId, uint32_t>> clusters;
};

/// The clusters of the casters that meet the map and are proven hidden (culling/hidden_clusters.h), and the casters of
/// which that is every one, whatever lies beside the map.
///   asked    static casters
///   statics  octree of all static casters: what may hide them
/// Runs on all of TBB's threads and gives the same answer for any number of them.
ProvenHidden provenHidden(const world::CasterTable& table, const LightCasters& light, const MapTexels& map,
                          std::span<const world::CasterId> asked, const world::Octree& statics,
                          const SearchConfig& config);

}  // namespace culling
