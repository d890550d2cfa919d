// cache/plan_writer.h — turns regions of a lattice into scissored passes of a FramePlan.
// Source: our own.
#pragma once

#include <span>
#include <vector>

#include "cache/frame_plan.h"
#include "cache/lattice.h"
#include "cache/shadow_cache.h"

namespace cache {

/// A rectangle of one quadrant, and where it is stored.
struct Piece {
    TexelRect rect;   ///< lattice texels
    Texel quadrant;   ///< all of `rect` lies in this copy of the stored map
    StoreRect store;
};

/// Low and high corner [m] of what may be rasterised into a rectangle: it and one texel around it, since positions
/// are rounded by a few hundredths of a texel at most.
inline glm::dvec2 lowOf(const Lattice& lattice, const TexelRect& rect) {
    return (glm::dvec2(rect.min) - 1.0) * lattice.texel;
}
inline glm::dvec2 highOf(const Lattice& lattice, const TexelRect& rect) {
    return (glm::dvec2(rect.max) + 1.0) * lattice.texel;
}

/// Cuts `rect` (inside a window) where the stored map wraps: 1 to 4 pieces.
void splitAtWrap(const Lattice& lattice, const TexelRect& rect, std::vector<Piece>& pieces);

/// Writes the draws of one cascade. Counts what it writes.
class PlanWriter {
public:
    PlanWriter(const Scene& scene, const DepthRange& depth, int cascade, const Lattice& lattice, FramePlan& plan);

    struct Counts {
        Cost cost;  ///< texels stay 0
        uint64_t clustersFound = 0, clustersHidden = 0, trianglesHidden = 0, castersDropped = 0;
        Counts& operator+=(const Counts& o) {
            cost += o.cost;
            clustersFound += o.clustersFound;
            clustersHidden += o.clustersHidden;
            trianglesHidden += o.trianglesHidden;
            castersDropped += o.castersDropped;
            return *this;
        }
    };

    /// Adds a pass that draws into `piece` every cluster of `casters` that may touch it.
    ///   hide  leave out clusters with a certificate
    Counts draw(const Piece& piece, std::span<const world::CasterId> casters, bool hide,
                std::vector<DrawPass>& passes);

private:
    bool begin(const Piece& piece, glm::dvec2 min, glm::dvec2 max, world::CasterId caster);
    void add(uint32_t cluster);
    const Scene& scene_;
    const DepthRange depth_;
    const int cascade_;
    const Lattice& lattice_;
    FramePlan& plan_;
    Counts counts_;
    // The caster being written.
    world::CasterId caster_ = 0;
    const world::MeshLevel* level_ = nullptr;
    GeometryId geometry_ = 0;
    Texel quadrant_{0};
    glm::vec2 low_{0}, high_{0};  ///< the piece, grown, relative to the caster's origin [m]
    bool placed_ = false;         ///< its transform is in the plan
};

}  // namespace cache
