// cache/shadow_cache.h — decides what each cascade's maps need this frame; emits a FramePlan.
// Source: our own; built on Losasso & Hoppe, "Geometry Clipmaps", 2004 (scrolling), and Insomniac Games,
// "CSM Scrolling", 2012 (static cache under active casters), whose `dS = S - S'` is mended here:
// an exposed slab draws every static caster that meets it.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "cache/depth_range.h"
#include "cache/frame_plan.h"
#include "cache/lattice.h"
#include "cache/owed.h"
#include "cache/rect_set.h"
#include "cache/statistics.h"
#include "cache/work.h"
#include "culling/light_casters.h"
#include "culling/occlusion.h"
#include "world/casters.h"
#include "world/octree.h"

namespace cache {

/// Deliberate defects, each of which a comparison with a map drawn from scratch must catch.
enum class Sabotage : uint8_t {
    kNone,
    kLiteralScroll,  ///< slabs draw S - S' only: casters that straddle the old border are cut
    kDeafDeparture,  ///< a departure clears nothing
    kStickyCertificate, ///< an occluder leaves and what it hid stays hidden (done by culling)
    kForgottenDebt,     ///< what a limited frame leaves undone counts as done
    kUnknownAsEmpty,    ///< texels in which nothing was drawn yet say that nothing is there
    kMixedSuns,         ///< the maps of a new direction begin with what the old one left (done by the server)
    kSleptMotion,       ///< active casters that moved while a cascade slept leave their old texels behind
    kSilentLack,        ///< maps that lack chunks say that they are whole (done by the server)
    kKeptDepths,        ///< the range of depths moves and the texels keep what they hold
    kDeafArrival,       ///< what joins the static set is not drawn
    kSilentLevel,       ///< a caster that changes its level of detail neither departs nor arrives
    kUnrestored,        ///< the working map keeps what active casters drew in the frame before
    kLostMaps,          ///< other settings, and a cascade that keeps its state loses its maps (done by the server)
};

struct CacheConfig {
    int side = 1024;        ///< texels a side
    int guardBand = 1;      ///< windows move in steps of this many texels, >= 1
    DepthRange scene{};     ///< all that casts or receives
    double depthSteps = 1 << 24;  ///< distinct depths of the maps' format, > 0
    size_t firstMap = 0;    ///< place of the first of its maps in a FramePlan; the others follow
    bool spareMap = false;  ///< one pair of maps more than cascades, to fill before a range of depths moves
    Sabotage sabotage = Sabotage::kNone;
};

/// What the plan looks at. All parts belong together and describe the state after this frame's
/// events.
struct Scene {
    const world::CasterTable& table;
    const culling::LightCasters& light;
    const world::Octree& statics;           ///< of static casters, by id
    std::span<const world::CasterId> active; ///< ascending
    const culling::Occlusion* occlusion = nullptr; ///< null: draw everything
};

constexpr uint32_t kAllCascades = ~0u;

/// Something left the static set, or a part of it did; where it was must be redrawn.
struct Departure {
    world::Box bounds;  ///< light space [m], as last drawn
    Cause cause = Cause::kDeparture;
    uint32_t cascades = kAllCascades;  ///< bit c: in whose maps it shows
};

/// A caster joined the static set, or is drawn in another way.
struct Arrival {
    world::CasterId caster = 0;
    Cause cause = Cause::kArrival;
    uint32_t cascades = kAllCascades;  ///< likewise
};

/// What happened since the last plan. Certificates that fell need no entry: their occluder's
/// departure redraws its rectangle, and elsewhere the others that proved the certificate still hide
/// what it hid.
struct Events {
    std::span<const Departure> departures;
    std::span<const Arrival> arrivals;                  ///< ascending by caster
    std::span<const world::Box> activeDirt;  ///< light-space bounds where active casters were or are new
};

/// A region that a frame drew into a cache map, and why.
struct Redrawn {
    TexelRect rect;  ///< inside the window
    Cause cause = Cause::kStart;
};

/// What a frame is asked for.
struct Demand {
    glm::dvec3 eye{0};    ///< light space [m]
    Cause begin = Cause::kStart;  ///< of drawing maps that hold nothing yet
    uint32_t asleep = 0;  ///< bit c: nothing that cascade c serves can be seen; its maps may wait
    Limits limits{};      ///< on what is drawn into the cache maps
};

/// One cache map and one working map per cascade, as a decision: holds windows and debts, never pixels.
/// `plan` commits: the GPU must execute each plan, in order. One thread at a time.
///
/// A texel of a drawn window is valid, stale or unknown. Without limits every cascade that is awake is
/// valid after each plan. With limits the most urgent work is done first and the rest is owed: what the
/// map never held is set to kUnknownDepth, what it held stays as it was. A cascade that sleeps keeps its
/// window and touches nothing; what happened meanwhile is owed when it wakes.
///
/// Where a cascade's range of depths is shorter than the scene and wears out, the spare maps are filled with
/// the next range, a share in each frame, and become the cascade's once they are whole. A range that is left
/// before that is redrawn at once. Both have the cause kRebase.
class ShadowCache {
public:
    ShadowCache(const std::vector<culling::Cascade>& cascades, const CacheConfig& config);
    ShadowCache(ShadowCache&&) noexcept;
    ~ShadowCache();

    /// Window of each cascade around an eye [light-space x, y in metres], before any plan for it.
    TexelRect windowAround(int cascade, glm::dvec2 eye) const;

    /// Plans the frame: afterwards the cache maps hold all static casters within the windows around the
    /// eye, and the working maps the active ones as well, but for what is owed.
    /// Allocates nothing where there are no limits, nothing joins or leaves the static set, and no list grows
    /// longer than before.
    ///   plan        reset by the caller, with room for this cache's maps; other caches may share it
    ///   statistics  one per cascade, replaced
    void plan(const Scene& scene, const Events& events, const Demand& demand, FramePlan& plan,
              std::vector<CascadeStatistics>& statistics);

    /// Plans drawing all maps from scratch in their committed windows, without certificates.
    /// Changes nothing of its own.
    void planRedraw(const Scene& scene, FramePlan& plan, std::vector<CascadeStatistics>& statistics) const;

    /// Takes over what another cache's maps hold for one of its cascades, which serves the same distance with the same
    /// lattice and format: the caller has put its pair of maps in the place of this one's. Before any plan.
    void adopt(int cascade, const ShadowCache& other, int from);
    /// Every cascade is drawn and owes nothing.
    bool complete() const;
    /// Forgets what the maps hold: the next plan draws everything.
    void forget();

    int cascades() const { return int(states_.size()); }
    /// Place of the cascade's maps in a FramePlan; another one after a rebase.
    size_t map(int cascade) const { return config_.firstMap + states_[size_t(cascade)].map; }
    /// Of the maps, as drawn.
    const DepthRange& depth(int cascade) const { return states_[size_t(cascade)].depth; }
    double split(int cascade) const { return states_[size_t(cascade)].split; }
    /// True once the maps hold a window.
    bool drawn(int cascade) const { return states_[size_t(cascade)].drawn; }
    TexelRect window(int cascade) const { return states_[size_t(cascade)].window; }
    /// What the cache map, and with it the working map, owes the world.
    std::span<const OwedRegion> owed(int cascade) const { return states_[size_t(cascade)].owed.regions(); }
    /// Where the working map alone is stale: active casters moved while the cascade slept.
    std::span<const TexelRect> slept(int cascade) const { return states_[size_t(cascade)].slept.rects(); }
    /// What the last plan drew into the cascade's cache map: disjoint. Until the next plan.
    std::span<const Redrawn> redrawn(int cascade) const { return states_[size_t(cascade)].redrawn; }
    const Lattice& lattice(int cascade) const { return states_[size_t(cascade)].lattice; }
    const CacheConfig& config() const { return config_; }

    /// No texel of a cascade that stays awake waits longer than this [frames] while each frame may draw
    /// `texels` texels: those that have waited for kPatience frames are drawn in turn, with half of the
    /// limit.
    uint64_t ageBound(uint64_t texels) const;

private:
    struct State {
        State(const culling::Cascade& cascade, const CacheConfig& config, size_t map);
        bool complete() const { return drawn && owed.empty(); }
        Lattice lattice;
        double split;  ///< [m]
        DepthAnchor anchor;
        DepthRange depth;
        size_t map;  ///< from config_.firstMap
        TexelRect window;
        bool drawn = false;  ///< the maps hold the window
        OwedSet owed;
        RectSet slept;
        std::vector<Redrawn> redrawn;  ///< by the last plan
    };
    struct Rebase {
        int cascade = 0;
        State next;
    };
    struct Scratch;
    class Frame;
    void rebase(const Scene& scene, const Events& events, const Demand& demand, FramePlan& plan,
                std::vector<CascadeStatistics>& statistics);
    size_t maps() const { return states_.size() + (config_.spareMap ? 1 : 0); }

    std::vector<State> states_;
    std::unique_ptr<Scratch> scratch_;
    std::optional<Rebase> rebase_;  ///< under way
    size_t spare_;                  ///< the pair of maps that no cascade has, from config_.firstMap
    CacheConfig config_;
    uint64_t frame_ = 0;
};

}  // namespace cache
