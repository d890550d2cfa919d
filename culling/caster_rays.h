// culling/caster_rays.h — casters that a few rays toward the sun take for hidden: how engines cull shadow casters.
// Sources: rays by Embree (Wald et al., "Embree: A Kernel Framework for Efficient CPU Ray Tracing", 2014); points far from
// each other by Gonzalez, "Clustering to Minimize the Maximum Intercluster Distance", 1985.
//
// Rays start where the caster would be drawn: at centres of texels that it covers, on its surface nearest the sun there.
// So each ray asks what the map decides, whether the caster owns that texel, and a caster of which all texels are asked is
// hidden rightly: whatever goes wrong is for want of rays. Points of the whole surface would also ask below the ground and
// behind the caster itself, where nothing is ever seen; corners of bounds, where nothing is drawn. Of all texels
// (of more than 4,096, so many of them, evenly spread) the first is the one nearest the middle, and each next one lies as far
// as can be from those before: rims and tips, which show first, come early.
#pragma once

#include <memory>
#include <span>

#include "culling/caster_texels.h"
#include "culling/hidden_casters.h"
#include "world/result.h"

namespace culling {

/// Static casters over one map, at the level that it draws, as triangles of an Embree scene. Any number of threads may
/// ask.
class CasterRays {
public:
    static constexpr int kMost = 64;  ///< rays a caster

    /// `casters` are all static ones over the map: those that are asked about, and what hides them. Nothing of the arguments
    /// is kept. kUsage, naming it, for a caster with a corner that is not finite or lies beyond 1e9 m; kDevice if Embree
    /// refuses.
    static world::Result<std::unique_ptr<CasterRays>> create(const world::CasterTable& table, const LightCasters& light,
                                                             const MapTexels& map,
                                                             std::span<const world::CasterId> casters);
    ~CasterRays();

    /// Those that cover a texel centre of the map, in the order in which they were given: the map draws nothing of others.
    std::span<const world::CasterId> asked() const;

    /// Those of `asked` from which each of so many rays meets a triangle of another caster nearer the sun, by more than
    /// what single precision may round; a caster of fewer texels is asked a ray of each. What more rays call hidden,
    /// fewer do as well.
    ///   raysPerCaster  1 to kMost
    /// Rays are shot in rounds, up to the 1st, 4th, 16th and 64th of each caster, and none of a caster after a round that
    /// found it open. Runs on all of TBB's threads and gives the same answer for any number of them.
    HiddenCasters hidden(int raysPerCaster) const;

private:
    struct Impl;
    explicit CasterRays(std::unique_ptr<Impl> impl);
    std::unique_ptr<Impl> impl_;
};

}  // namespace culling
