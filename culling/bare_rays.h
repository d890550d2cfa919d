// culling/bare_rays.h — what Embree alone takes for the rays of a certificate search: the yardstick of
// its speed, and a second opinion on its answers.
// Source: rays by Embree (Wald et al., "Embree: A Kernel Framework for Efficient CPU Ray Tracing", 2014).
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "culling/hidden_clusters.h"
#include "culling/light_casters.h"
#include "world/casters.h"
#include "world/result.h"

namespace culling {

/// Casters at the levels that one cascade draws, as one Embree scene of triangles in light space, and a ray toward
/// the sun from each texel centre of footprints, at the depth of the cluster's nearest corner. Single precision
/// around the first footprint: evidence, no proof.
class BareRays {
public:
    /// kDevice if Embree refuses.
    static world::Result<std::unique_ptr<BareRays>> create(const world::CasterTable& table, const LightCasters& light,
                                                          int cascade, std::span<const world::CasterId> casters,
                                                          std::span<const Footprint> footprints);
    ~BareRays();

    uint64_t rays() const;
    /// Shoots all rays in packets, on all of TBB's threads. Returns how many met something.
    uint64_t shoot() const;

private:
    struct Impl;
    explicit BareRays(std::unique_ptr<Impl> impl);
    std::unique_ptr<Impl> impl_;
};

}  // namespace culling
