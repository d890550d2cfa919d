// cache/spot_cache.h — decides what one spot light's two maps need this frame.
// Source: Insomniac Games, "CSM Scrolling", 2012, section 2 (the plain scheme for local lights: a static map
// kept while the light and what rests in its cone stay as they are, active casters over a copy of it).
#pragma once

#include <functional>
#include <vector>

#include "cache/frame_plan.h"
#include "cache/shadow_cache.h"
#include "culling/spot_light.h"

namespace cache {

/// What one light cost in a frame. The cache map is redrawn whole or not at all, so it has one cause.
struct SpotStatistics {
    Cause cause = Cause::kStart;  ///< the first of the list that applies; of no meaning where `statics` is nothing
    Cost statics;                 ///< drawn into the cache map
    Cost active;                  ///< working map: texels restored, active casters drawn
};

/// The geometry of one level of a caster's mesh, put on the GPU if need be.
using GeometryOf = std::function<world::Result<GeometryId>(world::CasterId, size_t level)>;

/// How a spot light's map stores z, the distance along the light's axis: the depth that items' transforms and
/// the perspective division give, kNearestDepth + (1 - kNearestDepth) * (1 - near / z). Not reversed: 0 is
/// near, kEmptyDepth without end. What is nearer than `near` is cut off.
double distanceOf(float depth, double near);

/// `plan` commits: the GPU must execute each plan, in order. One thread at a time.
///
/// The cache map holds the static casters that touch the map, the working map the active ones as well. The
/// cache map is redrawn whole when the light changed and when a static caster that touches the map arrived
/// or departed; the working map is restored whole and drawn over when the cache map changed and when an
/// active caster is new or was in a place that touches the map.
class SpotCache {
public:
    explicit SpotCache(const culling::SpotSpace& space, Sabotage sabotage = Sabotage::kNone)
        : wanted_(space), held_(space), sabotage_(sabotage) {}

    /// From the next plan on.
    void turn(const culling::SpotSpace& space);
    /// Forgets what the maps hold: the next plan draws everything.
    void forget() { drawn_ = false; }

    /// Plans the frame's work on the maps at place `map` of the plan. Transforms are rows x, y, z in the
    /// light's frame, over near, x and y also over slope: clip = (x, y, z - 1, z).
    ///   events  boxes in world metres
    /// Errors are those of `geometry`: then the plan is of no use, and what is held must be forgotten.
    world::Result<world::Done> plan(const Scene& scene, const Events& events, const GeometryOf& geometry, size_t map,
                                    FramePlan& plan, SpotStatistics& statistics);
    /// Plans drawing both maps from scratch as they were last committed. Changes nothing of its own.
    world::Result<world::Done> planRedraw(const Scene& scene, const GeometryOf& geometry, size_t map,
                                          FramePlan& plan) const;

    bool drawn() const { return drawn_; }  ///< the maps hold `space`
    const culling::SpotSpace& space() const { return held_; }  ///< as last committed

private:
    culling::SpotSpace wanted_, held_;
    bool drawn_ = false;
    Sabotage sabotage_;
};

}  // namespace cache
