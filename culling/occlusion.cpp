#include "culling/occlusion.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

#include "culling/caster_query.h"

namespace culling {

Occlusion::Occlusion(const world::CasterTable& table, const LightCasters& light, const OcclusionConfig& config)
    : table_(table),
      light_(light),
      config_(config),
      states_(light.cascades().size()),
      waiting_(light.cascades().size()),
      begun_(light.cascades().size()) {}

size_t Occlusion::remove(std::span<const world::CasterId> casters) {
    for (world::CasterId id : casters) {
        for (size_t c = 0; c < states_.size(); ++c) {
            if (id < states_[c].size()) states_[c][id] = State::kUnknown;
            std::erase_if(begun_[c], [id](const Footprint& f) { return f.caster == id; });
        }
        if (id < ownedBy_.size())
            while (!ownedBy_[id].empty()) kill(ownedBy_[id].back());
    }
    size_t revoked = 0;
    for (world::CasterId id : casters) {
        if (id >= provenBy_.size()) continue;
        if (config_.sticky) provenBy_[id].clear();
        for (; !provenBy_[id].empty(); ++revoked) kill(provenBy_[id].back());
        // Another caster will have the number: what this one had room for must not stay with it.
        bits_[id] = {};
        ownedBy_[id] = std::vector<uint32_t>();
        provenBy_[id] = std::vector<uint32_t>();
    }
    return revoked;
}

void Occlusion::issue(int cascade, HiddenCluster hidden) {
    uint32_t at = static_cast<uint32_t>(certificates_.size());
    if (free_.empty()) {
        certificates_.emplace_back();
    } else {
        at = free_.back();
        free_.pop_back();
    }
    const size_t slots = std::max<size_t>(hidden.caster, hidden.occluders.back()) + 1;
    if (bits_.size() < slots) {
        bits_.resize(slots);
        provenBy_.resize(slots);
        ownedBy_.resize(slots);
    }
    auto& bits = bits_[hidden.caster][static_cast<size_t>(cascade)];
    if (bits.empty()) bits.resize(light_.rects(hidden.caster, cascade).size(), 0);
    bits[hidden.cluster] = 1;
    ownedBy_[hidden.caster].push_back(at);
    for (world::CasterId occluder : hidden.occluders) provenBy_[occluder].push_back(at);
    certificates_[at] = {cascade, std::move(hidden), true};
    ++live_;
}

void Occlusion::kill(uint32_t certificate) {
    Certificate& c = certificates_[certificate];
    CHECK(c.alive);
    auto& bits = bits_[c.hidden.caster][static_cast<size_t>(c.cascade)];
    bits[c.hidden.cluster] = 0;
    if (std::find(bits.begin(), bits.end(), 1) == bits.end()) bits.clear();
    std::erase(ownedBy_[c.hidden.caster], certificate);
    for (world::CasterId occluder : c.hidden.occluders) std::erase(provenBy_[occluder], certificate);
    c = {};
    free_.push_back(certificate);
    --live_;
}

void Occlusion::await(int cascade, std::span<const world::CasterId> casters) {
    std::vector<State>& states = states_[static_cast<size_t>(cascade)];
    states.resize(std::max(states.size(), table_.slots()), State::kUnknown);
    std::vector<world::CasterId>& waiting = waiting_[static_cast<size_t>(cascade)];
    std::erase_if(waiting, [&](world::CasterId caster) { return states[caster] != State::kWaiting; });
    const double edge = light_.cascades()[static_cast<size_t>(cascade)].texel * kTile;
    std::vector<std::tuple<double, double, world::CasterId>> fresh;  // tile by tile
    for (world::CasterId caster : casters) {
        if (states[caster] != State::kUnknown) continue;
        states[caster] = State::kWaiting;
        const glm::dvec3 middle = light_[caster].bounds.centre() / edge;
        fresh.push_back({std::floor(middle.y), std::floor(middle.x), caster});
    }
    std::sort(fresh.begin(), fresh.end());
    for (const auto& [y, x, caster] : fresh) waiting.push_back(caster);
}

/// The clusters whose turn it is.
std::vector<Footprint> Occlusion::next(size_t cascade, uint64_t rays) {
    std::vector<Footprint> asked = std::exchange(begun_[cascade], {});
    uint64_t sum = 0;
    for (const Footprint& f : asked) sum += f.rays();
    std::vector<world::CasterId>& waiting = waiting_[cascade];
    std::vector<world::CasterId> casters;
    auto at = waiting.begin();
    for (; at != waiting.end() && sum < rays; ++at) {
        State& state = states_[cascade][*at];
        if (state != State::kWaiting) continue;
        state = State::kTried;
        casters.push_back(*at);
        sum += raysOf(light_, int(cascade), *at, config_.search.raysPerCluster);
    }
    waiting.erase(waiting.begin(), at);
    const std::vector<Footprint> more = footprints(table_, light_, int(cascade), casters, config_.search.raysPerCluster);
    asked.insert(asked.end(), more.begin(), more.end());
    auto end = asked.begin();
    for (sum = 0; end != asked.end() && sum < rays; ++end) sum += end->rays();
    begun_[cascade].assign(end, asked.end());
    asked.erase(end, asked.end());
    return asked;
}

CertifyCosts Occlusion::search(const world::Octree& statics, uint64_t rays) {
    CertifyCosts costs;
    std::vector<world::CasterId> provers;
    for (size_t c = waiting_.size(); c-- > 0 && costs.rays < rays;) {
        const std::vector<Footprint> asked = next(c, rays - costs.rays);
        if (asked.empty()) continue;
        glm::i64vec2 low = asked.front().low, high = asked.front().high;
        for (const Footprint& f : asked) {
            low = glm::min(low, f.low);
            high = glm::max(high, f.high);
            costs.rays += f.rays();
        }
        costs.clustersTested += asked.size();
        const double texel = light_.cascades()[c].texel;
        castersOver(statics, light_, glm::dvec2(low) * texel, glm::dvec2(high) * texel, provers);
        for (HiddenCluster& hidden : hiddenClusters(table_, light_, int(c), asked, provers, config_.search)) {
            issue(int(c), std::move(hidden));
            ++costs.certificates;
        }
    }
    return costs;
}

}  // namespace culling
