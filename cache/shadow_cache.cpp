#include "cache/shadow_cache.h"

#include <algorithm>

#include "cache/plan_writer.h"
#include "cache/scroll.h"
#include "culling/caster_query.h"

namespace cache {

namespace {

glm::dvec2 metres(const Lattice& lattice, Texel t) { return glm::dvec2(t) * lattice.texel; }

TexelRect footprint(const Lattice& lattice, const world::Box& light) {
    return light.empty() ? TexelRect{} : lattice.footprint(glm::dvec2(light.min), glm::dvec2(light.max));
}

TexelRect footprint(const Lattice& lattice, const culling::LightCaster& caster, const culling::ClusterRect& rect) {
    const glm::dvec2 origin(caster.origin);
    return lattice.footprint(origin + glm::dvec2(rect.min), origin + glm::dvec2(rect.max));
}

/// Static casters over a region of the lattice, with the texel of room that drawing leaves.
void staticsOver(const Scene& scene, const Lattice& lattice, const TexelRect& rect,
                 std::vector<world::CasterId>& casters) {
    culling::castersOver(scene.statics, scene.light, metres(lattice, rect.min - Texel(1)),
                         metres(lattice, rect.max + Texel(1)), casters);
}

void tally(CascadeStatistics& statistics, Cost& cost, const PlanWriter::Counts& counts) {
    cost += counts.cost;
    statistics.clustersFound += counts.clustersFound;
    statistics.clustersHidden += counts.clustersHidden;
}

/// Copies the dirty rectangles of the cache map over the working map and draws active casters there.
void writeWorking(const Scene& scene, const Lattice& lattice, std::span<const TexelRect> dirt, PlanWriter& writer,
                  CascadePlan& plan, CascadeStatistics& statistics) {
    std::vector<Piece> pieces;
    for (const TexelRect& rect : dirt) splitAtWrap(lattice, rect, pieces);
    for (const Piece& piece : pieces) {
        plan.restores.push_back(piece.store);
        statistics.active.texels += static_cast<uint64_t>(piece.rect.area());
        statistics.active += writer.draw(piece, scene.active, false, plan.activePasses).cost;
    }
}

}  // namespace

ShadowCache::ShadowCache(std::vector<culling::Cascade> cascades, const CacheConfig& config) : config_(config) {
    for (const culling::Cascade& c : cascades) states_.push_back({{c.texel, config.side}, {}, false});
}

TexelRect ShadowCache::windowAround(int cascade, glm::dvec2 eye) const {
    const Lattice& lattice = states_[size_t(cascade)].lattice;
    return lattice.window(lattice.windowAt(eye));
}

void ShadowCache::forget() {
    for (State& state : states_) state.drawn = false;
}

void ShadowCache::findRegions(const Scene& scene, const Events& events, int cascade, TexelRect window,
                              std::vector<Region>& regions) const {
    const State& state = states_[size_t(cascade)];
    const Lattice& lattice = state.lattice;
    regions.clear();
    if (!state.drawn || isJump(state.window.min, window.min, lattice.side)) {
        regions.push_back({window, state.drawn ? Cause::kJump : Cause::kStart, true});
        return;
    }
    RectSet covered;
    const auto cover = [&](const TexelRect& rect, Cause cause, bool clear) {
        RectSet fresh;
        fresh.addExactly(rect);
        for (const TexelRect& r : covered.rects()) fresh.remove(r);
        for (const TexelRect& r : fresh.rects()) {
            covered.addExactly(r);
            regions.push_back({r, cause, clear});
        }
    };
    for (const TexelRect& slab : exposedSlabs(state.window.min, window.min, lattice.side))
        cover(slab, Cause::kScroll, true);

    RectSet rects;
    if (config_.sabotage != Sabotage::kDeafDeparture) {
        for (Cause cause : {Cause::kDeparture, Cause::kDemotion}) {
            rects.clear();
            for (const Departure& d : events.departures)
                if (d.cause == cause) rects.add(intersection(footprint(lattice, d.bounds), window));
            for (const TexelRect& r : rects.rects()) cover(r, cause, true);
        }
    }
    for (Cause cause : {Cause::kArrival, Cause::kPromotion}) {
        rects.clear();
        for (const Arrival& a : events.arrivals) {
            if (a.cause != cause) continue;
            const culling::LightCaster& caster = scene.light[a.caster];
            if (!footprint(lattice, caster.bounds).overlaps(window)) continue;
            const auto& clusters = scene.light.rects(a.caster, cascade);
            TexelRect shown;  // hidden clusters change nothing
            for (uint32_t k = 0; k < clusters.size(); ++k)
                if (!scene.occlusion || !scene.occlusion->hidden(cascade, a.caster, k))
                    shown = hull(shown, footprint(lattice, caster, clusters[k]));
            rects.add(intersection(shown, window));
        }
        for (const TexelRect& r : rects.rects()) cover(r, cause, false);
    }
}

void ShadowCache::plan(const Scene& scene, const Events& events, glm::dvec2 eye, FramePlan& plan,
                       std::vector<CascadeStatistics>& statistics) {
    plan.transforms.clear();
    plan.items.clear();
    plan.cascades.assign(states_.size(), {});
    statistics.assign(states_.size(), {});
    std::vector<world::CasterId> arrived;
    for (const Arrival& a : events.arrivals) arrived.push_back(a.caster);
    std::vector<world::CasterId> casters;
    std::vector<Piece> pieces;
    const bool hide = scene.occlusion != nullptr;

    for (size_t c = 0; c < states_.size(); ++c) {
        State& state = states_[c];
        const Lattice& lattice = state.lattice;
        CascadePlan& cascade = plan.cascades[c];
        CascadeStatistics& s = statistics[c];
        PlanWriter writer(scene, config_, int(c), lattice, plan);
        const TexelRect window = windowAround(int(c), eye);
        s.window = window.min;
        if (state.drawn) s.move = window.min - state.window.min;

        findRegions(scene, events, int(c), window, regions_);
        for (const Region& region : regions_) {
            Cost& cost = s.byCause[size_t(region.cause)];
            pieces.clear();
            splitAtWrap(lattice, region.rect, pieces);
            if (region.clear) {
                staticsOver(scene, lattice, region.rect, casters);
                if (config_.sabotage == Sabotage::kLiteralScroll && region.cause == Cause::kScroll)
                    std::erase_if(casters, [&](world::CasterId id) {
                        return footprint(lattice, scene.light[id].bounds).overlaps(state.window);
                    });
            }
            for (const Piece& piece : pieces) {
                cost.texels += static_cast<uint64_t>(piece.rect.area());
                if (region.clear) cascade.clears.push_back(piece.store);
                // Whatever is new in a region that keeps its texels is drawn under their one cause.
                tally(s, cost, writer.draw(piece, region.clear ? casters : arrived, hide, cascade.staticPasses));
            }
        }

        RectSet dirt;
        for (const Region& region : regions_) dirt.addExactly(region.rect);
        s.total.texels = static_cast<uint64_t>(dirt.area());
        for (const DrawPass& pass : cascade.staticPasses) {
            s.total.draws += pass.itemCount;
            for (uint32_t i = pass.firstItem; i < pass.firstItem + pass.itemCount; ++i) {
                const DrawItem& item = plan.items[i];
                s.total.triangles += item.indexCount / 3;
                if (i == pass.firstItem || item.transform != plan.items[i - 1].transform) ++s.total.casters;
            }
        }
        for (const world::Box& box : events.activeDirt) dirt.add(intersection(footprint(lattice, box), window));
        writeWorking(scene, lattice, dirt.rects(), writer, cascade, s);

        state.window = window;
        state.drawn = true;
    }
}

void ShadowCache::planRedraw(const Scene& scene, FramePlan& plan, std::vector<CascadeStatistics>& statistics) const {
    plan.transforms.clear();
    plan.items.clear();
    plan.cascades.assign(states_.size(), {});
    statistics.assign(states_.size(), {});
    std::vector<world::CasterId> casters;
    std::vector<Piece> pieces;
    for (size_t c = 0; c < states_.size(); ++c) {
        const State& state = states_[c];
        CascadePlan& cascade = plan.cascades[c];
        CascadeStatistics& s = statistics[c];
        PlanWriter writer(scene, config_, int(c), state.lattice, plan);
        s.window = state.window.min;
        pieces.clear();
        splitAtWrap(state.lattice, state.window, pieces);
        staticsOver(scene, state.lattice, state.window, casters);
        s.total.texels = static_cast<uint64_t>(state.window.area());
        for (const Piece& piece : pieces) {
            cascade.clears.push_back(piece.store);
            tally(s, s.total, writer.draw(piece, casters, false, cascade.staticPasses));
        }
        s.byCause[size_t(Cause::kStart)] = s.total;
        writeWorking(scene, state.lattice, std::span(&state.window, 1), writer, cascade, s);
    }
}

}  // namespace cache
