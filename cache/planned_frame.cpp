#include "cache/planned_frame.h"

#include <algorithm>

#include "cache/scroll.h"

namespace cache {

namespace {

/// A block no longer than this [texels] is not cut further to fit a limit.
constexpr int64_t kSmallestBlock = 4;

}  // namespace

void staticsOver(const Scene& scene, const Lattice& lattice, const TexelRect& rect,
                 std::vector<world::CasterId>& casters) {
    culling::castersOver(scene.statics, scene.light, lowOf(lattice, rect), highOf(lattice, rect), casters);
}

void tally(CascadeStatistics& statistics, Cost& cost, const PlanWriter::Counts& counts) {
    cost += counts.cost;
    statistics.clustersFound += counts.clustersFound;
    statistics.clustersHidden += counts.clustersHidden;
    statistics.trianglesHidden += counts.trianglesHidden;
    statistics.castersDropped += counts.castersDropped;
}

void writeWorking(const culling::CasterRows& active, const Lattice& lattice, std::span<const TexelRect> dirt,
                  PlanWriter& writer, CascadePlan& plan, CascadeStatistics& statistics, std::vector<Piece>& pieces,
                  std::vector<world::CasterId>& casters) {
    pieces.clear();
    for (const TexelRect& rect : dirt) splitAtWrap(lattice, rect, pieces);
    for (const Piece& piece : pieces) {
        plan.restores.push_back(piece.store);
        statistics.active.texels += static_cast<uint64_t>(piece.rect.area());
        active.over(lowOf(lattice, piece.rect), highOf(lattice, piece.rect), casters);
        statistics.active += writer.draw(piece, casters, false, plan.activePasses).cost;
    }
}

ShadowCache::Frame::Frame(const ShadowCache& cache, std::span<const Target> targets, const Scene& scene,
                          const Events& events, const Demand& demand, FramePlan& plan,
                          std::span<CascadeStatistics> statistics)
    : cache_(cache),
      scene_(scene),
      events_(events),
      demand_(demand),
      plan_(plan),
      statistics_(statistics),
      scratch_(*cache.scratch_),
      cascades_(scratch_.cascades),
      work_(scratch_.work),
      arrivals_(scratch_.arrivals),
      casters_(scratch_.casters),
      pieces_(scratch_.pieces) {
    work_.clear();
    arrivals_.clear();
    for (const Arrival& a : events.arrivals) arrivals_.push_back(a.caster);
    scratch_.active.fill(scene.light, scene.active);
    cascades_.resize(std::max(cascades_.size(), targets.size()));
    for (size_t c = 0; c < targets.size(); ++c) {
        const auto [state, number] = targets[c];
        if (!state->drawn) state->depth = state->anchor.at(demand.eye.z);
        Cascade& cascade = cascades_[c];
        state->redrawn.clear();
        cascade.state = state;
        cascade.number = number;
        cascade.before = state->window;
        cascade.eye = state->lattice.texelAt(glm::dvec2(demand.eye));
        cascade.drawn.clear();
        cascade.forgotten.clear();
    }
}

/// Where the frame's events change static maps under a cascade's window: by departures, and by arrivals alone.
void ShadowCache::Frame::changed(size_t c, std::vector<Invalidation>& left, std::vector<Invalidation>& joined) const {
    const State& state = *cascades_[c].state;
    const Sabotage sabotage = cache_.config_.sabotage;
    if (sabotage != Sabotage::kDeafDeparture) departed(state.lattice, cascades_[c].number, state.window, events_, left);
    if (sabotage != Sabotage::kDeafArrival) arrived(scene_, state.lattice, cascades_[c].number, state.window, events_, joined);
    if (sabotage == Sabotage::kSilentLevel)
        for (auto* list : {&left, &joined})
            std::erase_if(*list, [](const Invalidation& i) { return i.cause == Cause::kLevel; });
}

/// Notes what happens under a window that nobody looks at.
void ShadowCache::Frame::sleep(size_t c) {
    State& state = *cascades_[c].state;
    CascadeStatistics& s = statistics_[c];
    s.asleep = true;
    s.window = state.window.min;
    if (!state.drawn) return;
    std::vector<Invalidation> left, joined;
    changed(c, left, joined);
    for (const auto& invalid : {left, joined})
        for (const Invalidation& i : invalid) state.owed.add({i.rect, i.cause, Owes::kStale, cache_.frame_});
    state.owed.compactStale();  // a cascade may sleep for long; nothing becomes unknown meanwhile
    if (cache_.config_.sabotage != Sabotage::kSleptMotion)
        for (const world::Box& box : events_.activeDirt)
            state.slept.add(intersection(footprint(state.lattice, box), state.window));
}

/// Moves the window and lists what is to be drawn in it, the oldest debts first.
void ShadowCache::Frame::collect(size_t c) {
    State& state = *cascades_[c].state;
    CascadeStatistics& s = statistics_[c];
    const glm::dvec2 eye(demand_.eye);
    const TexelRect window = state.lattice.window(state.lattice.windowAt(eye)), before = state.window;
    const bool held = state.drawn;
    if (held) s.move = window.min - before.min;
    state.window = window;
    state.drawn = true;
    s.window = window.min;

    const auto add = [&](const OwedRegion& region, bool clear) { work_.push_back({int(c), region, clear}); };
    const uint64_t now = cache_.frame_;
    const bool jumps = isJump(before.min, window.min, state.lattice.side);
    const bool leaves = !state.anchor.holds(state.depth, demand_.eye.z);
    if (jumps || leaves) state.depth = state.anchor.at(demand_.eye.z);
    if (!held || jumps || (leaves && cache_.config_.sabotage != Sabotage::kKeptDepths)) {
        state.owed.clear();
        state.slept.clear();
        const Cause cause = !held ? demand_.begin : leaves ? Cause::kRebase : Cause::kJump;
        add({window, cause, Owes::kUnknown, now}, true);
        return;
    }
    state.owed.clip(window);
    forgetDepths(c, state.owed.compactUnknown());
    state.owed.compactStale();
    RectSet &covered = scratch_.covered, &fresh = scratch_.fresh;
    covered.clear();
    for (const OwedRegion& region : state.owed.regions()) {
        add(region, true);
        covered.addExactly(region.rect);
    }
    const auto cover = [&](const TexelRect& rect, Cause cause, Owes owes, bool clear) {
        fresh.clear();
        fresh.addExactly(rect);
        for (const TexelRect& r : covered.rects()) fresh.remove(r);
        for (const TexelRect& r : fresh.rects()) {
            covered.addExactly(r);
            add({r, cause, owes, now}, clear);
        }
    };
    for (const TexelRect& slab : exposedSlabs(before.min, window.min, state.lattice.side))
        cover(slab, Cause::kScroll, Owes::kUnknown, true);
    std::vector<Invalidation> left, joined;
    changed(c, left, joined);
    for (const Invalidation& i : left) cover(i.rect, i.cause, Owes::kStale, true);
    for (const Invalidation& i : joined) cover(i.rect, i.cause, Owes::kStale, false);
    state.owed.clear();  // all of it is in the list now; what is left undone comes back
}

PlanWriter::Counts ShadowCache::Frame::write(const Work& work) {
    const State& state = *cascades_[size_t(work.cascade)].state;
    const TexelRect& rect = work.region.rect;
    CascadePlan& cascade = maps(size_t(work.cascade));
    pieces_.clear();
    splitAtWrap(state.lattice, rect, pieces_);
    if (work.clear) {
        staticsOver(scene_, state.lattice, rect, casters_);
        if (cache_.config_.sabotage == Sabotage::kLiteralScroll && work.region.cause == Cause::kScroll)
            std::erase_if(casters_, [&](world::CasterId id) {
                return footprint(state.lattice, scene_.light[id].bounds)
                    .overlaps(cascades_[size_t(work.cascade)].before);
            });
    }
    PlanWriter::Counts counts;
    PlanWriter writer(scene_, state.depth, cascades_[size_t(work.cascade)].number, state.lattice, plan_);
    for (const Piece& piece : pieces_) {
        counts.cost.texels += static_cast<uint64_t>(piece.rect.area());
        if (work.clear) cascade.clears.push_back(piece.store);
        // Whatever is new in a region that keeps its texels is drawn under their one cause.
        counts += writer.draw(piece, work.clear ? casters_ : arrivals_, scene_.occlusion != nullptr,
                              cascade.staticPasses);
    }
    return counts;
}

void ShadowCache::Frame::noteDrawn(const Work& work) {
    Cascade& cascade = cascades_[size_t(work.cascade)];
    cascade.drawn.addExactly(work.region.rect);
    cascade.state->redrawn.push_back({work.region.rect, work.region.cause});
}

/// Draws everything uncut: cut work draws clusters once for each block that they meet. False if the limits leave no room
/// for it; then nothing is drawn.
bool ShadowCache::Frame::drawWhole(const Limits& limits) {
    uint64_t texels = 0, triangles = 0;
    for (const Work& work : work_) texels += static_cast<uint64_t>(work.region.rect.area());
    if (texels > limits.texels) return false;
    const size_t transforms = plan_.transforms.size(), items = plan_.items.size();
    scratch_.written.clear();
    for (size_t c = 0; c < statistics_.size(); ++c)
        scratch_.written.push_back({maps(c).clears.size(), maps(c).staticPasses.size()});
    scratch_.counts.clear();
    for (const Work& work : work_) {
        scratch_.counts.push_back(write(work));
        triangles += scratch_.counts.back().cost.triangles;
        if (triangles <= limits.triangles) continue;
        plan_.transforms.resize(transforms);
        plan_.casters.resize(transforms);
        plan_.items.resize(items);
        for (size_t c = 0; c < statistics_.size(); ++c) {
            maps(c).clears.resize(scratch_.written[c].first);
            maps(c).staticPasses.resize(scratch_.written[c].second);
        }
        return false;
    }
    for (size_t k = 0; k < work_.size(); ++k) {
        CascadeStatistics& s = statistics_[size_t(work_[k].cascade)];
        tally(s, s.byCause[size_t(work_[k].region.cause)], scratch_.counts[k]);
        noteDrawn(work_[k]);
    }
    return true;
}

/// Sets texels to unknown in both maps.
void ShadowCache::Frame::forgetDepths(size_t c, const TexelRect& rect) {
    if (rect.empty()) return;
    pieces_.clear();
    splitAtWrap(cascades_[c].state->lattice, rect, pieces_);
    CascadePlan& cascade = maps(c);
    for (const Piece& piece : pieces_)
        (cache_.config_.sabotage == Sabotage::kUnknownAsEmpty ? cascade.clears : cascade.unknowns).push_back(piece.store);
    cascades_[c].forgotten.addExactly(rect);
}

void ShadowCache::Frame::owe(const Work& work, const TexelRect& rect) {
    OwedRegion region = work.region;
    region.rect = rect;
    const auto c = size_t(work.cascade);
    if (region.owes == Owes::kUnknown && region.since == cache_.frame_) forgetDepths(c, rect);
    if (cache_.config_.sabotage != Sabotage::kForgottenDebt) cascades_[c].state->owed.add(region);
}

/// Draws as much of a region as the limits leave room for, and owes the rest. False when they are used up.
bool ShadowCache::Frame::take(Work work, Limits& left) {
    const auto c = size_t(work.cascade);
    const Texel eye = cascades_[c].eye;
    CascadePlan& cascade = maps(c);
    CascadeStatistics& s = statistics_[c];
    std::vector<TexelRect> todo, rest{work.region.rect};
    for (uint64_t room = left.texels; room > 0 && !rest.empty();) {
        const TexelRect from = rest.back();
        rest.pop_back();
        const bool fits = static_cast<uint64_t>(from.area()) <= room;
        todo.push_back(fits ? from : nearestPart(from, int64_t(room), eye));
        subtract(from, todo.back(), rest);
        room -= static_cast<uint64_t>(todo.back().area());
    }
    std::reverse(todo.begin(), todo.end());  // the nearest is taken from the back
    bool more = rest.empty();
    while (!todo.empty()) {
        work.region.rect = todo.back();
        todo.pop_back();
        const size_t transforms = plan_.transforms.size(), items = plan_.items.size();
        const size_t clears = cascade.clears.size(), passes = cascade.staticPasses.size();
        const PlanWriter::Counts counts = write(work);
        const Texel size = work.region.rect.max - work.region.rect.min;
        const bool smallest = std::max(size.x, size.y) <= kSmallestBlock;
        if (counts.cost.triangles <= left.triangles || (smallest && left.untouched)) {
            tally(s, s.byCause[size_t(work.region.cause)], counts);
            noteDrawn(work);
            drawn_ += counts.cost;
            left = left.less(counts.cost);
            continue;
        }
        plan_.transforms.resize(transforms);
        plan_.casters.resize(transforms);
        plan_.items.resize(items);
        cascade.clears.resize(clears);
        cascade.staticPasses.resize(passes);
        if (smallest) {
            more = false;
            rest.push_back(work.region.rect);
            rest.insert(rest.end(), todo.begin(), todo.end());
            break;
        }
        const TexelRect near = nearestHalf(work.region.rect, eye);
        subtract(work.region.rect, near, todo);
        todo.push_back(near);
    }
    for (const TexelRect& r : rest) owe(work, r);
    return more;
}

void ShadowCache::Frame::drawWithin(Limits limits) {
    cutIntoBlocks(work_);
    std::vector<Texel> eyes;
    for (size_t c = 0; c < statistics_.size(); ++c) eyes.push_back(cascades_[c].eye);
    // Half of the limits goes to what has waited too long, in turn: so no texel waits for ever.
    const uint64_t now = cache_.frame_;
    const auto late = std::stable_partition(work_.begin(), work_.end(), [now](const Work& w) {
        return now - w.region.since > kPatience;
    });
    std::vector<Work> waited(work_.begin(), late);
    work_.erase(work_.begin(), late);
    oldestFirst(waited, eyes);
    const auto half = [](uint64_t limit) { return limit == Limits::kNone ? limit : limit - limit / 2; };
    Limits forLate{half(limits.texels), half(limits.triangles), limits.untouched};
    bool more = true;
    for (const Work& w : waited) {
        if (more) more = take(w, forLate);
        else work_.push_back(w);
    }
    limits = limits.less(drawn_);
    nearestFirst(work_, eyes);
    more = true;
    for (const Work& w : work_) {
        if (more) more = take(w, limits);
        else owe(w, w.region.rect);
    }
}

/// Counts the static part on its own, from what was written.
void ShadowCache::Frame::count(size_t c) {
    const CascadePlan& cascade = maps(c);
    const State& state = *cascades_[c].state;
    CascadeStatistics& s = statistics_[c];
    s.total.texels = static_cast<uint64_t>(cascades_[c].drawn.area());
    for (const DrawPass& pass : cascade.staticPasses) {
        s.total.draws += pass.itemCount;
        for (uint32_t i = pass.firstItem; i < pass.firstItem + pass.itemCount; ++i) {
            const DrawItem& item = plan_.items[i];
            s.total.triangles += item.indexCount / 3;
            if (i == pass.firstItem || item.transform != plan_.items[i - 1].transform) ++s.total.casters;
        }
    }
    s.unknownTexels = static_cast<uint64_t>(state.owed.area(Owes::kUnknown));
    s.staleTexels = static_cast<uint64_t>(state.owed.area(Owes::kStale));
    s.oldestDebt = state.owed.age(cache_.frame_);
}

void ShadowCache::Frame::run() {
    for (size_t c = 0; c < statistics_.size(); ++c) {
        maps(c).cascade = cascades_[c].number;
        if (demand_.asleep >> cascades_[c].number & 1) sleep(c);
        else collect(c);
    }
    if (!drawWhole(demand_.limits)) drawWithin(demand_.limits);
    for (size_t c = 0; c < statistics_.size(); ++c) {
        Cascade& cascade = cascades_[c];
        State& state = *cascade.state;
        count(c);
        if (statistics_[c].asleep) continue;
        RectSet& dirt = scratch_.dirt;
        dirt = cascade.drawn;
        for (const TexelRect& rect : cascade.forgotten.rects()) dirt.addExactly(rect);
        for (const TexelRect& rect : state.slept.rects()) dirt.add(intersection(rect, state.window));
        state.slept.clear();
        if (cache_.config_.sabotage != Sabotage::kUnrestored)
            for (const world::Box& box : events_.activeDirt)
                dirt.add(intersection(footprint(state.lattice, box), state.window));
        PlanWriter writer(scene_, state.depth, cascade.number, state.lattice, plan_);
        writeWorking(scratch_.active, state.lattice, dirt.rects(), writer, maps(c), statistics_[c], pieces_, casters_);
    }
}

}  // namespace cache
