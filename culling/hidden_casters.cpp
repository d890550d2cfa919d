#include "culling/hidden_casters.h"

#include <algorithm>
#include <utility>

#include "culling/caster_query.h"

namespace culling {

ProvenHidden provenHidden(const world::CasterTable& table, const LightCasters& light, const MapTexels& map,
                          std::span<const world::CasterId> asked, const world::Octree& statics,
                          const SearchConfig& config) {
    ProvenHidden found;
    const double texel = light.cascades()[static_cast<size_t>(map.cascade)].texel;
    const glm::dvec2 low = glm::dvec2(map.low) * texel, high = low + map.side * texel;
    const glm::i64vec2 end = map.low + int64_t(map.side);
    std::vector<Footprint> feet = footprints(table, light, map.cascade, asked, config.raysPerCluster);
    std::erase_if(feet, [&](const Footprint& f) {
        return f.high.x <= map.low.x || f.high.y <= map.low.y || f.low.x >= end.x || f.low.y >= end.y;
    });
    glm::i64vec2 first = map.low, last = end;  // of what is asked about, some of it beside the map
    for (const Footprint& f : feet) {
        first = glm::min(first, f.low);
        last = glm::max(last, f.high);
        found.whole.rays += f.rays();
    }
    std::vector<world::CasterId> provers;
    castersOver(statics, light, glm::dvec2(first) * texel, glm::dvec2(last) * texel, provers);
    auto& hidden = found.clusters;
    for (const HiddenCluster& h : hiddenClusters(table, light, map.cascade, feet, provers, config))
        hidden.push_back({h.caster, h.cluster});
    std::sort(hidden.begin(), hidden.end());
    for (const world::CasterId caster : asked) {
        const glm::dvec2 origin(light[caster].origin), from = low - origin, to = high - origin;
        bool all = true;
        eachMeeting(light.rects(caster, map.cascade).rows, {roundedDown(from.x), roundedDown(from.y)},
                    {roundedUp(to.x), roundedUp(to.y)}, [&](size_t k) {
            all = all && std::binary_search(hidden.begin(), hidden.end(), std::pair(caster, uint32_t(k)));
        });
        if (all) found.whole.casters.push_back(caster);
    }
    return found;
}

}  // namespace culling
