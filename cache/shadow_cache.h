// cache/shadow_cache.h — decides what each cascade's maps need this frame; emits a FramePlan.
// Source: our own; built on Losasso & Hoppe, "Geometry Clipmaps", 2004 (scrolling), and Insomniac Games,
// "CSM Scrolling", 2012 (static cache under active casters), whose `dS = S - S'` is mended here:
// an exposed slab draws every static caster that meets it.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "cache/frame_plan.h"
#include "cache/lattice.h"
#include "cache/rect_set.h"
#include "cache/statistics.h"
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
};

struct CacheConfig {
    int side = 1024;        ///< texels a side
    double depthNear = 0;   ///< light-space z of depth 0 [m]; nearer casters are clamped to it
    double depthRange = 1;  ///< metres per unit of depth, > 0
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

/// Something left the static set; where it was must be redrawn.
struct Departure {
    world::Box bounds;  ///< light space [m], as last drawn
    Cause cause = Cause::kDeparture;
};

/// A caster joined the static set.
struct Arrival {
    world::CasterId caster = 0;
    Cause cause = Cause::kArrival;
};

/// What happened since the last plan. Certificates that fell need no entry: their occluder's
/// departure redraws its rectangle, and elsewhere the others that proved the certificate still hide
/// what it hid.
struct Events {
    std::span<const Departure> departures;
    std::span<const Arrival> arrivals;                  ///< ascending by caster
    std::span<const world::Box> activeDirt;  ///< light-space bounds where active casters were or are new
};

/// One cache map and one working map per cascade, as a decision: holds windows, never pixels.
/// `plan` commits: the GPU must execute each plan, in order. One thread at a time.
class ShadowCache {
public:
    ShadowCache(std::vector<culling::Cascade> cascades, const CacheConfig& config);

    /// Window of each cascade around an eye [light-space x, y in metres], before any plan for it.
    TexelRect windowAround(int cascade, glm::dvec2 eye) const;

    /// Plans the frame: afterwards the cache maps hold all static casters within the windows around
    /// `eye`, and the working maps the active ones as well.
    ///   statistics  one per cascade, replaced
    void plan(const Scene& scene, const Events& events, glm::dvec2 eye, FramePlan& plan,
              std::vector<CascadeStatistics>& statistics);

    /// Plans drawing all maps from scratch in their committed windows, without certificates.
    /// Changes nothing.
    void planRedraw(const Scene& scene, FramePlan& plan, std::vector<CascadeStatistics>& statistics) const;

    /// Forgets what the maps hold: the next plan draws everything.
    void forget();

    TexelRect window(int cascade) const { return states_[size_t(cascade)].window; }
    const Lattice& lattice(int cascade) const { return states_[size_t(cascade)].lattice; }
    const CacheConfig& config() const { return config_; }

private:
    struct Region {
        TexelRect rect;
        Cause cause = Cause::kStart;
        bool clear = true;  ///< drawn from nothing; else only new casters are added
    };
    struct State {
        Lattice lattice;
        TexelRect window;
        bool drawn = false;  ///< the maps hold the window
    };
    void findRegions(const Scene& scene, const Events& events, int cascade, TexelRect window,
                     std::vector<Region>& regions) const;

    std::vector<State> states_;
    CacheConfig config_;
    std::vector<Region> regions_;
};

}  // namespace cache
