#include "cache/frame_plan.h"

#include <algorithm>
#include <span>

#include "world/hash.h"

namespace cache {

void FramePlan::reset(size_t maps) {
    transforms.clear();
    casters.clear();
    items.clear();
    cascades.assign(maps, {});
}

bool FramePlan::idle() const {
    return std::all_of(cascades.begin(), cascades.end(), [](const CascadePlan& c) { return c.idle(); });
}

uint64_t FramePlan::hash() const {
    static_assert(sizeof(DrawItem) == 4 * sizeof(uint32_t));
    static_assert(sizeof(DrawPass) == 6 * sizeof(uint32_t));
    static_assert(sizeof(glm::mat3x4) == 12 * sizeof(float));
    uint64_t h = 0;
    const auto add = [&h](const auto& list) {
        using T = typename std::decay_t<decltype(list)>::value_type;
        const uint64_t count = list.size();
        h = world::hashValues(std::span(&count, 1), h);
        h = world::hashValues(std::span<const T>(list), h);
    };
    add(transforms);
    add(items);
    for (const CascadePlan& c : cascades) {
        add(c.unknowns);
        add(c.clears);
        add(c.staticPasses);
        add(c.restores);
        add(c.activePasses);
    }
    return h;
}

}  // namespace cache
