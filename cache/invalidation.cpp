#include "cache/invalidation.h"

#include "cache/rect_set.h"

namespace cache {

namespace {

TexelRect footprint(const Lattice& lattice, const culling::LightCaster& caster, const culling::ClusterRect& rect) {
    const glm::dvec2 origin(caster.origin);
    return lattice.footprint(origin + glm::dvec2(rect.min), origin + glm::dvec2(rect.max));
}

void append(const RectSet& rects, Cause cause, std::vector<Invalidation>& list) {
    for (const TexelRect& rect : rects.rects()) list.push_back({rect, cause});
}

}  // namespace

TexelRect footprint(const Lattice& lattice, const world::Box& light) {
    return light.empty() ? TexelRect{} : lattice.footprint(glm::dvec2(light.min), glm::dvec2(light.max));
}

void departed(const Lattice& lattice, int cascade, const TexelRect& window, const Events& events,
              std::vector<Invalidation>& list) {
    for (Cause cause : {Cause::kDeparture, Cause::kDemotion, Cause::kLevel, Cause::kEdit}) {
        RectSet rects;
        for (const Departure& d : events.departures)
            if (d.cause == cause && (d.cascades >> cascade & 1)) rects.add(intersection(footprint(lattice, d.bounds), window));
        append(rects, cause, list);
    }
}

void arrived(const Scene& scene, const Lattice& lattice, int cascade, const TexelRect& window, const Events& events,
             std::vector<Invalidation>& list) {
    for (Cause cause : {Cause::kLevel, Cause::kArrival, Cause::kPromotion}) {
        RectSet rects;
        for (const Arrival& a : events.arrivals) {
            if (a.cause != cause || !(a.cascades >> cascade & 1)) continue;
            const culling::LightCaster& caster = scene.light[a.caster];
            if (!footprint(lattice, caster.bounds).overlaps(window)) continue;
            const culling::ClusterRects clusters = scene.light.rects(a.caster, cascade);
            TexelRect shown;  // hidden clusters change nothing
            for (uint32_t k = 0; k < clusters.size(); ++k)
                if (!scene.occlusion || !scene.occlusion->hidden(cascade, a.caster, k))
                    shown = hull(shown, footprint(lattice, caster, clusters[k]));
            rects.add(intersection(shown, window));
        }
        append(rects, cause, list);
    }
}

}  // namespace cache
