#include "cache/shadow_cache.h"

#include <algorithm>
#include <utility>

#include "cache/planned_frame.h"

namespace cache {

namespace {

/// Over so many frames the maps of a cascade's next range of depths are filled.
constexpr uint64_t kRebaseFrames = 60;

}  // namespace

ShadowCache::State::State(const culling::Cascade& cascade, const CacheConfig& config, size_t place)
    : lattice{cascade.texel, config.side, config.guardBand},
      split(cascade.split),
      anchor(cascade, config.scene, config.depthSteps),
      map(place) {}

ShadowCache::ShadowCache(const std::vector<culling::Cascade>& cascades, const CacheConfig& config)
    : scratch_(std::make_unique<Scratch>()), spare_(cascades.size()), config_(config) {
    CHECK(config.guardBand >= 1 && config.scene.length > 0 && config.depthSteps > 0);
    for (const culling::Cascade& c : cascades) states_.emplace_back(c, config, states_.size());
}

ShadowCache::ShadowCache(ShadowCache&&) noexcept = default;
ShadowCache::~ShadowCache() = default;

TexelRect ShadowCache::windowAround(int cascade, glm::dvec2 eye) const {
    const Lattice& lattice = states_[size_t(cascade)].lattice;
    return lattice.window(lattice.windowAt(eye));
}

void ShadowCache::adopt(int cascade, const ShadowCache& other, int from) {
    State& state = states_[size_t(cascade)];
    const size_t map = state.map;
    frame_ = other.frame_;  // the debts' dates
    state = other.states_[size_t(from)];
    state.map = map;
}

bool ShadowCache::complete() const {
    return std::all_of(states_.begin(), states_.end(), [](const State& s) { return s.complete(); });
}

void ShadowCache::forget() {
    for (State& state : states_) state.drawn = false;
    rebase_.reset();
}

uint64_t ShadowCache::ageBound(uint64_t texels) const {
    const auto side = static_cast<uint64_t>(config_.side);
    const uint64_t half = texels - texels / 2;
    CHECK(half > 0);
    return kPatience + (states_.size() * side * side + half - 1) / half;
}

void ShadowCache::plan(const Scene& scene, const Events& events, const Demand& demand, FramePlan& plan,
                       std::vector<CascadeStatistics>& statistics) {
    CHECK(plan.cascades.size() >= config_.firstMap + maps());
    statistics.assign(states_.size(), {});
    ++frame_;
    std::vector<Frame::Target>& all = scratch_->all;
    all.clear();
    for (State& state : states_) all.push_back({&state, int(all.size())});
    Frame(*this, all, scene, events, demand, plan, statistics).run();
    if (config_.spareMap) rebase(scene, events, demand, plan, statistics);
}

/// Fills the spare maps for a cascade whose range wears out, and hands them over once they are whole.
void ShadowCache::rebase(const Scene& scene, const Events& events, const Demand& demand, FramePlan& plan,
                         std::vector<CascadeStatistics>& statistics) {
    const auto wearsOut = [&](const State& s) { return s.drawn && s.anchor.wearsOut(s.depth, demand.eye.z); };
    if (rebase_) {
        const State& next = rebase_->next;
        if (!wearsOut(states_[size_t(rebase_->cascade)]) || !next.anchor.holds(next.depth, demand.eye.z)) rebase_.reset();
    }
    for (size_t c = 0; c < states_.size() && !rebase_; ++c) {
        if ((demand.asleep >> c & 1) || !wearsOut(states_[c])) continue;
        rebase_ = Rebase{int(c), states_[c]};
        rebase_->next.map = spare_;
        rebase_->next.drawn = false;
    }
    if (!rebase_) return;
    Demand share = demand;
    share.begin = Cause::kRebase;
    share.asleep = 0;
    Cost spent;
    for (const CascadeStatistics& s : statistics) spent += s.total;
    share.limits = demand.limits.less(spent);
    // What the shown maps needed keeps the next ones up with the world; the rest fills them.
    const size_t c = size_t(rebase_->cascade);
    const auto texels = static_cast<uint64_t>(config_.side) * static_cast<uint64_t>(config_.side);
    share.limits.texels =
        std::min(share.limits.texels, statistics[c].total.texels + (texels + kRebaseFrames - 1) / kRebaseFrames);
    const Frame::Target target{&rebase_->next, rebase_->cascade};
    CascadeStatistics more;
    Frame(*this, std::span(&target, 1), scene, events, share, plan, std::span(&more, 1)).run();
    statistics[c].addFor(Cause::kRebase, more);
    if (!rebase_->next.complete()) return;
    spare_ = states_[c].map;
    states_[c] = std::move(rebase_->next);
    rebase_.reset();
}

void ShadowCache::planRedraw(const Scene& scene, FramePlan& plan, std::vector<CascadeStatistics>& statistics) const {
    CHECK(plan.cascades.size() >= config_.firstMap + maps());
    statistics.assign(states_.size(), {});
    std::vector<world::CasterId> casters;
    std::vector<Piece> pieces;
    culling::CasterRows active;
    active.fill(scene.light, scene.active);
    for (size_t c = 0; c < states_.size(); ++c) {
        const State& state = states_[c];
        if (!state.drawn) continue;
        CascadePlan& cascade = plan.cascades[map(int(c))];
        CascadeStatistics& s = statistics[c];
        cascade.cascade = int(c);
        PlanWriter writer(scene, state.depth, int(c), state.lattice, plan);
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
        writeWorking(active, state.lattice, std::span(&state.window, 1), writer, cascade, s, pieces, casters);
    }
}

}  // namespace cache
