#include "cache/caster_sets.h"

#include <algorithm>
#include <limits>

namespace cache {

CasterSets::CasterSets(double restSeconds, uint32_t promotionsPerFrame)
    : rest_(restSeconds), cap_(promotionsPerFrame) {}

void CasterSets::moved(world::CasterId caster, double time) {
    const auto at = std::lower_bound(active_.begin(), active_.end(), caster);
    const auto index = at - active_.begin();
    if (at == active_.end() || *at != caster) {
        active_.insert(at, caster);
        lastMove_.insert(lastMove_.begin() + index, time);
    } else {
        lastMove_[static_cast<size_t>(index)] = time;
    }
}

void CasterSets::keepActive(world::CasterId caster) { moved(caster, std::numeric_limits<double>::infinity()); }

void CasterSets::forget(world::CasterId caster) {
    const auto at = std::lower_bound(active_.begin(), active_.end(), caster);
    if (at == active_.end() || *at != caster) return;
    lastMove_.erase(lastMove_.begin() + (at - active_.begin()));
    active_.erase(at);
}

std::vector<world::CasterId> CasterSets::promote(double time) {
    std::vector<size_t> rested;
    for (size_t i = 0; i < active_.size(); ++i)
        if (time - lastMove_[i] >= rest_) rested.push_back(i);
    std::sort(rested.begin(), rested.end(), [&](size_t a, size_t b) {
        return lastMove_[a] != lastMove_[b] ? lastMove_[a] < lastMove_[b] : a < b;
    });
    if (rested.size() > cap_) rested.resize(cap_);
    std::sort(rested.begin(), rested.end());
    std::vector<world::CasterId> promoted;
    for (size_t i : rested) promoted.push_back(active_[i]);
    for (size_t k = rested.size(); k-- > 0;) {
        active_.erase(active_.begin() + static_cast<std::ptrdiff_t>(rested[k]));
        lastMove_.erase(lastMove_.begin() + static_cast<std::ptrdiff_t>(rested[k]));
    }
    return promoted;
}

}  // namespace cache
