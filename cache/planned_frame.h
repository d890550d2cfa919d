// cache/planned_frame.h — one frame of a ShadowCache being planned: what its maps lack, in what order, and how much of it
// fits the limits. Of cache/shadow_cache.cpp alone.
#pragma once

#include <span>
#include <utility>
#include <vector>

#include "cache/invalidation.h"
#include "cache/plan_writer.h"
#include "cache/shadow_cache.h"
#include "culling/caster_query.h"

namespace cache {

/// Static casters over a region of the lattice, with the texel of room that drawing leaves.
void staticsOver(const Scene& scene, const Lattice& lattice, const TexelRect& rect,
                 std::vector<world::CasterId>& casters);

/// Adds what was written to a cost, and the rest of it to the cascade's statistics.
void tally(CascadeStatistics& statistics, Cost& cost, const PlanWriter::Counts& counts);

/// Copies the dirty rectangles of the cache map over the working map and draws active casters there.
///   pieces, casters  scratch
void writeWorking(const culling::CasterRows& active, const Lattice& lattice, std::span<const TexelRect> dirt,
                  PlanWriter& writer, CascadePlan& plan, CascadeStatistics& statistics, std::vector<Piece>& pieces,
                  std::vector<world::CasterId>& casters);

/// What each frame fills anew, in memory that it finds.
struct ShadowCache::Scratch {
    /// A state and the cascade that it is one of.
    struct Target {
        State* state;
        int cascade;
    };
    struct Cascade {
        State* state = nullptr;
        int number = 0;
        TexelRect before;          ///< window of the frame before
        Texel eye{0};
        RectSet drawn, forgotten;  ///< of the cache map: what the working map must follow
    };
    std::vector<Target> all;
    std::vector<Cascade> cascades;
    std::vector<Work> work;
    std::vector<world::CasterId> arrivals, casters;
    culling::CasterRows active;
    std::vector<Piece> pieces;
    std::vector<PlanWriter::Counts> counts;         ///< per item of `work`
    std::vector<std::pair<size_t, size_t>> written; ///< per target: clears and static passes of its plan
    RectSet covered, fresh, dirt;
};

/// One frame being planned.
class ShadowCache::Frame {
public:
    using Target = Scratch::Target;
    Frame(const ShadowCache& cache, std::span<const Target> targets, const Scene& scene, const Events& events,
          const Demand& demand, FramePlan& plan, std::span<CascadeStatistics> statistics);
    void run();

private:
    using Cascade = Scratch::Cascade;
    CascadePlan& maps(size_t c) { return plan_.cascades[cache_.config_.firstMap + cascades_[c].state->map]; }
    void changed(size_t cascade, std::vector<Invalidation>& left, std::vector<Invalidation>& joined) const;
    void sleep(size_t cascade);
    void collect(size_t cascade);
    bool drawWhole(const Limits& limits);
    void drawWithin(Limits limits);
    bool take(Work work, Limits& left);
    PlanWriter::Counts write(const Work& work);
    void owe(const Work& work, const TexelRect& rect);
    void forgetDepths(size_t cascade, const TexelRect& rect);
    void noteDrawn(const Work& work);
    void count(size_t cascade);

    const ShadowCache& cache_;
    const Scene& scene_;
    const Events& events_;
    const Demand& demand_;
    FramePlan& plan_;
    std::span<CascadeStatistics> statistics_;  ///< one per target
    Scratch& scratch_;
    std::vector<Cascade>& cascades_;  ///< one per target; all indices are into these
    std::vector<Work>& work_;
    std::vector<world::CasterId>&arrivals_, &casters_;
    std::vector<Piece>& pieces_;
    Cost drawn_;  ///< so far, where limits cut the work
};

}  // namespace cache
