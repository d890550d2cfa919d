// culling/occlusion.h — certificates: clusters that need not be drawn into a cascade, with proof.
// Source: our own construction; rays by Embree (Wald et al., "Embree: A Kernel Framework for
// Efficient CPU Ray Tracing", 2014).
//
// A cluster is hidden in a cascade if at every texel centre of its footprint, grown by one texel,
// some other static caster, at the level that the cascade draws, lies nearer the sun than the
// cluster's own nearest depth. Embree finds candidate triangles; each is then proven in double
// precision, with room for what a rasteriser may round:
//   - the texel's centre lies inside the triangle, or inside it and the neighbour across a shared
//     edge, by more than a subpixel (edges of one mesh are watertight, gaps between meshes are not);
//   - the triangle's depth there plus its slope's error stays nearer than the cluster's nearest.
// "Strictly nearer" makes chains of certificates sound: at each texel the nearest surface of all is
// hidden by nobody, so it is drawn.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "culling/light_casters.h"
#include "culling/trace_scenes.h"
#include "world/casters.h"
#include "world/result.h"

namespace culling {

struct CertifyCosts {
    uint64_t rays = 0;
    uint64_t clustersTested = 0;  ///< within the ray budget, over all cascades
    uint64_t certificates = 0;
    CertifyCosts& operator+=(const CertifyCosts& o) {
        rays += o.rays;
        clustersTested += o.clustersTested;
        certificates += o.certificates;
        return *this;
    }
};

struct OcclusionConfig {
    uint32_t raysPerCluster = 4096;  ///< a cluster whose footprint has more texels is simply drawn
    double depthRange = 1;           ///< metres of light space per unit of map depth
    glm::dvec3 anchor{0};            ///< light-space point near the casters [m]: Embree works in float
    int side = 1024;                 ///< map edge [texels]
    bool sticky = false;  ///< a deliberate defect for tests: certificates outlive their occluders
};

/// Holds Embree scenes of the static casters and the certificates they prove. One caller at a time;
/// `admit` runs on all of TBB's threads and gives the same answer for any number of them.
class Occlusion {
public:
    /// `table` and `light` must outlive it. kDevice if Embree refuses.
    static world::Result<std::unique_ptr<Occlusion>> create(const world::CasterTable& table,
                                                           const LightCasters& light,
                                                           const OcclusionConfig& config);
    ~Occlusion();

    /// Static casters that a cascade's window reaches or soon will. Those that are new to the cascade
    /// may prove from now on, and certificates are looked for, for their clusters, there. What was
    /// admitted earlier is not tried again.
    CertifyCosts admit(int cascade, std::span<const world::CasterId> casters);

    /// Static casters that leave or turn active, before the table forgets or moves them. Their own
    /// certificates go, and those that they prove are revoked. What a revoked one hid shows nowhere
    /// but under the casters removed: whoever redraws their bounds has redrawn it.
    ///   returns  certificates revoked of casters that stay
    size_t remove(std::span<const world::CasterId> casters);

    /// Drops what is kept of a mesh; no admitted caster may use it.
    void forgetMesh(world::MeshSlot slot);

    /// True if the cluster, of the level drawn in that cascade, need not be drawn.
    bool hidden(int cascade, world::CasterId caster, uint32_t cluster) const {
        if (caster >= bits_.size()) return false;
        const auto& bits = bits_[caster][static_cast<size_t>(cascade)];
        return !bits.empty() && bits[cluster] != 0;
    }
    size_t certificates() const { return live_; }

private:
    struct Certificate {
        int cascade = 0;
        world::CasterId caster = 0;
        uint32_t cluster = 0;
        std::vector<world::CasterId> occluders;  ///< ascending, unique
        bool alive = false;
    };
    struct Attempt {  ///< what one thread finds out of one caster in one cascade
        std::vector<Certificate> proven;
        CertifyCosts costs;
    };
    Occlusion(const world::CasterTable& table, const LightCasters& light, const OcclusionConfig& config,
              std::unique_ptr<TraceScenes> scenes);
    Attempt attempt(world::CasterId caster, int cascade) const;
    bool prove(SunRay& ray, int cascade, double nearest, uint64_t& rays) const;
    void issue(Certificate certificate);
    void kill(uint32_t certificate);

    const world::CasterTable& table_;
    const LightCasters& light_;
    OcclusionConfig config_;
    std::unique_ptr<TraceScenes> scenes_;
    std::vector<std::array<std::vector<uint8_t>, kMaxCascades>> bits_;  ///< [caster][cascade][cluster]
    std::vector<Certificate> certificates_;
    std::vector<uint32_t> free_;
    std::vector<std::vector<uint32_t>> provenBy_;   ///< [occluder] certificates
    std::vector<std::vector<uint32_t>> ownedBy_;    ///< [caster] certificates of its clusters
    size_t live_ = 0;
};

}  // namespace culling
