#include "culling/occlusion.h"

#include <algorithm>
#include <utility>

namespace culling {

Occlusion::Occlusion(const world::CasterTable& table, const LightCasters& light, const OcclusionConfig& config)
    : table_(table), light_(light), config_(config), admitted_(light.cascades().size()) {}

size_t Occlusion::remove(std::span<const world::CasterId> casters) {
    for (world::CasterId id : casters) {
        for (auto& admitted : admitted_)
            if (id < admitted.size()) admitted[id] = 0;
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

CertifyCosts Occlusion::admit(int cascade, std::span<const world::CasterId> casters,
                              std::span<const world::CasterId> provers) {
    std::vector<uint8_t>& admitted = admitted_[static_cast<size_t>(cascade)];
    admitted.resize(std::max(admitted.size(), table_.slots()), 0);
    std::vector<world::CasterId> fresh;
    for (world::CasterId caster : casters)
        if (!std::exchange(admitted[caster], 1)) fresh.push_back(caster);
    const std::vector<Footprint> asked = footprints(table_, light_, cascade, fresh, config_.search.raysPerCluster);
    CertifyCosts costs{.clustersTested = asked.size()};
    for (const Footprint& footprint : asked) costs.rays += footprint.rays();
    for (HiddenCluster& hidden : hiddenClusters(table_, light_, cascade, asked, provers, config_.search)) {
        issue(cascade, std::move(hidden));
        ++costs.certificates;
    }
    return costs;
}

}  // namespace culling
