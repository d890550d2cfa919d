// tools/lab/view_plans.h — what is drawn to the maps of a method that keeps nothing, and what it costs.
#pragma once

#include <functional>
#include <span>
#include <vector>

#include "cache/statistics.h"
#include "culling/light_casters.h"
#include "culling/shadow_views.h"
#include "gpu/view_maps.h"
#include "tools/lab/scene.h"

namespace tools::lab {

/// The scene's casters as the views of one method see them: at levels of detail that follow each view's texels, those
/// of the first frame where they change. Clusters are the unit of culling, as they are for the cache.
class ViewCasters {
public:
    using Geometry = std::function<cache::GeometryId(const world::MeshLevel&)>;

    /// `scene` must outlive it.
    ViewCasters(const Scene& scene, const culling::LightSpace& light, const culling::ShadowMethod& method,
                std::span<const culling::ShadowView> views);

    /// After the scene's movers have moved.
    void moved(std::span<const world::CasterId> casters);

    /// Empties the maps of `views` and draws all that may cast into them; a view of statics alone only if `statics`.
    ///   geometry  the number of a mesh level on the GPU
    ///   plan      replaced
    cache::Cost plan(std::span<const culling::ShadowView> views, bool statics, const Geometry& geometry,
                     gpu::ViewPlan& plan);

private:
    void drawCaster(world::CasterId caster, int view, const culling::ShadowView& of, const Geometry& geometry,
                    gpu::ViewPlan& plan, cache::Cost& cost) const;

    const Scene& scene_;
    culling::LightCasters casters_;
    std::vector<world::CasterId> found_;
};

}  // namespace tools::lab
