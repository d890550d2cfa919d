// culling/occlusion.h — certificates: clusters that need not be drawn into a cascade, with proof.
// Source: our own construction.
//
// A cluster that other static casters hide (culling/hidden_clusters.h says when) gets a certificate, which
// names them. "Strictly nearer" makes chains of certificates sound: at each texel the nearest surface of
// all is hidden by nobody, so it is drawn. A certificate that comes late costs triangles and changes no texel: the search
// may be spread over as many frames as one likes.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "culling/hidden_clusters.h"
#include "culling/light_casters.h"
#include "world/casters.h"
#include "world/octree.h"

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

/// How many rays a frame may spend on certificates: as many as pay, by what the frames before found. Counted, not
/// timed: the same world gives the same allowance.
class RayAllowance {
public:
    /// A full frame's: 3 ms of a thread, seldom more than 10. Fewer spread the search over more frames and make it
    /// dearer, since what hides neighbours is looked at again.
    static constexpr uint64_t kMost = 1 << 14;
    static constexpr uint64_t kLeast = 1 << 12;  ///< where nothing pays: the camera may come to where it does
    static constexpr uint64_t kLent = 128 * kMost;
    /// What a certificate is worth: 0.7 ms of a thread, its cluster drawn some ten times.
    static constexpr uint64_t kPerCertificate = 1 << 11;

    uint64_t rays() const { return std::clamp(credit_, kLeast, kMost); }
    void spent(const CertifyCosts& costs) {
        const uint64_t credit = credit_ + costs.certificates * kPerCertificate;
        credit_ = std::min(kLent, credit - std::min(credit, costs.rays));
    }

private:
    uint64_t credit_ = kLent;
};

struct OcclusionConfig {
    SearchConfig search;
    bool sticky = false;  ///< a deliberate defect for tests: certificates outlive their occluders
};

/// Holds certificates, and looks for them when casters have come near a cascade. One caller at a time; `search` runs
/// on all of TBB's threads and gives the same answer for any number of them.
class Occlusion {
public:
    /// `table` and `light` must outlive it.
    Occlusion(const world::CasterTable& table, const LightCasters& light, const OcclusionConfig& config);

    /// Static casters that came near a cascade: they wait for a search, each once while it stays. They wait in the order
    /// in which they came, and those that came together side by side, since neighbours share what hides them.
    void await(int cascade, std::span<const world::CasterId> casters);

    /// Looks for certificates for the clusters of casters that wait: those of the coarsest cascade first, where a cluster
    /// asks the fewest rays and is hidden the most often. The others go on waiting; those that leave wait no more.
    ///   statics  octree of all static casters: what may hide them
    ///   rays     after so many no other cluster is tried, > 0
    CertifyCosts search(const world::Octree& statics, uint64_t rays);

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
    enum class State : uint8_t { kUnknown, kWaiting, kTried };
    std::vector<Footprint> next(size_t cascade, uint64_t rays);
    void issue(int cascade, HiddenCluster hidden);
    void kill(uint32_t certificate);

    const world::CasterTable& table_;
    const LightCasters& light_;
    OcclusionConfig config_;
    std::vector<std::vector<State>> states_;  ///< [cascade][caster]
    std::vector<std::vector<world::CasterId>> waiting_;  ///< [cascade]; some of them have left, or came to wait again
    std::vector<std::vector<Footprint>> begun_;  ///< [cascade] clusters, not tried yet, of a caster that others were of
    std::vector<std::array<std::vector<uint8_t>, kMaxCascades>> bits_;  ///< [caster][cascade][cluster]
    std::vector<Certificate> certificates_;
    std::vector<uint32_t> free_;
    std::vector<std::vector<uint32_t>> provenBy_;   ///< [occluder] certificates
    std::vector<std::vector<uint32_t>> ownedBy_;    ///< [caster] certificates of its clusters
    size_t live_ = 0;
};

}  // namespace culling
