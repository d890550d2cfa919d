// tools/lab/view_plans.h — what is drawn through the views of a method, and what it costs.
#pragma once

#include <limits>
#include <span>
#include <utility>
#include <vector>

#include "cache/statistics.h"
#include "culling/light_casters.h"
#include "culling/shadow_views.h"
#include "gpu/view_maps.h"
#include "tools/lab/scene.h"
#include "tools/lab/view_target.h"

namespace tools::lab {

/// A caster and one of its clusters, at the level that a view draws.
using CasterCluster = std::pair<world::CasterId, uint32_t>;

/// The scene's casters as the views of one method see them: at levels of detail that follow each view's texels, those
/// of the first frame where they change. Clusters are the unit of culling, as they are for the cache.
class ViewCasters {
public:
    /// `scene` must outlive it.
    ViewCasters(const Scene& scene, const culling::LightSpace& light, const culling::ShadowMethod& method,
                std::span<const culling::ShadowView> views);

    /// After the scene's movers have moved.
    void moved(std::span<const world::CasterId> casters);

    const culling::LightCaster& operator[](world::CasterId caster) const { return casters_[caster]; }
    /// A cascade for each view.
    const culling::LightCasters& light() const { return casters_; }
    /// Static casters at any depth over the view's rectangle, ascending.
    std::vector<world::CasterId> staticsOver(const culling::ShadowView& view) const;

    /// Empties the maps of `views` and draws all that may cast into them; a view of statics alone only if `statics`.
    ///   target  gets the geometry
    ///   plan    replaced
    ///   seenBy  a deliberate defect: what this camera does not see is left out; null: nothing is
    cache::Cost plan(std::span<const culling::ShadowView> views, bool statics, ViewTarget& target, gpu::ViewPlan& plan,
                     const culling::View* seenBy = nullptr);

    /// Adds a pass that draws what of some casters meets the view's rectangle and reaches deeper than `from`, light
    /// space [m].
    ///   number  of the view, for the level of detail
    ///   of      the view; its rectangle may be a part of the map's
    ///   hidden  clusters that are left out, ascending
    cache::Cost draw(std::span<const world::CasterId> casters, int number, const culling::ShadowView& of,
                     ViewTarget& target, gpu::ViewPlan& plan,
                     double from = -std::numeric_limits<double>::infinity(), std::span<const CasterCluster> hidden = {}) const;

private:
    void drawCaster(world::CasterId caster, int number, const culling::ShadowView& of, double from,
                    std::span<const CasterCluster> hidden, ViewTarget& target, gpu::ViewPlan& plan, cache::Cost& cost) const;

    const Scene& scene_;
    culling::ShadowBias bias_;
    culling::LightCasters casters_;
};

}  // namespace tools::lab
