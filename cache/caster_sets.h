// cache/caster_sets.h — which objects count as static and which as active.
// Source: Insomniac Games, "CSM Scrolling", 2012 (static and active sets); the rules are ours.
#pragma once

#include <cstdint>
#include <vector>

#include "world/casters.h"

namespace cache {

/// Active casters and since when each has rested. A caster turns active at once when it moves and
/// static after a rest, so that a short stop does not redraw the cache twice.
class CasterSets {
public:
    /// `restSeconds` >= 0; at most `promotionsPerFrame` casters turn static in one frame, so that a
    /// hundred that stop together do not make one dear frame.
    CasterSets(double restSeconds, uint32_t promotionsPerFrame);

    /// The caster moved at `time` [s]: it is active from now on.
    void moved(world::CasterId caster, double time);
    /// The caster changes its shape all the time: it is active from now on and never promoted.
    void keepActive(world::CasterId caster);
    /// The caster is gone.
    void forget(world::CasterId caster);
    /// Active casters that have rested long enough leave the active set: longest rest first, then by
    /// id. Returned ascending.
    std::vector<world::CasterId> promote(double time);

    /// Ascending.
    const std::vector<world::CasterId>& active() const { return active_; }

private:
    std::vector<world::CasterId> active_;
    std::vector<double> lastMove_;  ///< parallel to active_ [s]
    double rest_;
    uint32_t cap_;
};

}  // namespace cache
