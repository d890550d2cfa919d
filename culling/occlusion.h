// culling/occlusion.h — certificates: clusters that need not be drawn into a cascade, with proof.
// Source: our own construction.
//
// A cluster that other static casters hide (culling/hidden_clusters.h says when) gets a certificate, which
// names them. "Strictly nearer" makes chains of certificates sound: at each texel the nearest surface of
// all is hidden by nobody, so it is drawn.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "culling/hidden_clusters.h"
#include "culling/light_casters.h"
#include "world/casters.h"

namespace culling {

struct CertifyCosts {
    uint64_t rays = 0;            ///< texel centres asked about: the footprints of the clusters tested
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
    SearchConfig search;
    bool sticky = false;  ///< a deliberate defect for tests: certificates outlive their occluders
};

/// Holds certificates, and looks for them when casters come near a cascade. One caller at a time; `admit` runs
/// on all of TBB's threads and gives the same answer for any number of them.
class Occlusion {
public:
    /// `table` and `light` must outlive it.
    Occlusion(const world::CasterTable& table, const LightCasters& light, const OcclusionConfig& config);

    /// Looks for certificates in a cascade, for the clusters of those of `casters` that were not admitted to it before;
    /// the others are not tried again. Both lists hold static casters, each once.
    ///   provers  may hide them: all that lie over them, or fewer certificates are found
    CertifyCosts admit(int cascade, std::span<const world::CasterId> casters, std::span<const world::CasterId> provers);

    /// Static casters that leave or turn active, before the table forgets or moves them. Their own
    /// certificates go, and those that they prove are revoked. What a revoked one hid shows nowhere
    /// but under the casters removed: whoever redraws their bounds has redrawn it.
    ///   returns  certificates revoked of casters that stay
    size_t remove(std::span<const world::CasterId> casters);

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
        HiddenCluster hidden;
        bool alive = false;
    };
    void issue(int cascade, HiddenCluster hidden);
    void kill(uint32_t certificate);

    const world::CasterTable& table_;
    const LightCasters& light_;
    OcclusionConfig config_;
    std::vector<std::vector<uint8_t>> admitted_;  ///< [cascade][caster]
    std::vector<std::array<std::vector<uint8_t>, kMaxCascades>> bits_;  ///< [caster][cascade][cluster]
    std::vector<Certificate> certificates_;
    std::vector<uint32_t> free_;
    std::vector<std::vector<uint32_t>> provenBy_;   ///< [occluder] certificates
    std::vector<std::vector<uint32_t>> ownedBy_;    ///< [caster] certificates of its clusters
    size_t live_ = 0;
};

}  // namespace culling
