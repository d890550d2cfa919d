#include "tools/lab/view_plans.h"

#include <tbb/parallel_for.h>

#include "culling/caster_query.h"

namespace tools::lab {
namespace {

std::vector<culling::Cascade> cascadesOf(std::span<const culling::ShadowView> views) {
    std::vector<culling::Cascade> cascades;
    for (const culling::ShadowView& view : views) cascades.push_back({view.end, view.texel});
    return cascades;
}

/// From a mesh's own frame to a view's: light space, relative to the view's origin.
glm::mat3x4 rowsOf(const culling::LightCaster& caster, const culling::ShadowView& view) {
    glm::mat3x4 rows;
    const glm::dvec3 origin = caster.origin - view.origin;
    for (int axis = 0; axis < 3; ++axis) {
        for (int k = 0; k < 3; ++k) rows[axis][k] = float(caster.lightFromMesh[k][axis]);
        rows[axis][3] = float(origin[axis]);
    }
    return rows;
}

}  // namespace

ViewCasters::ViewCasters(const Scene& scene, const culling::LightSpace& light, const culling::ShadowMethod& method,
                         std::span<const culling::ShadowView> views)
    : scene_(scene), casters_(light, cascadesOf(views), {.levelError = method.levelError}) {
    const world::CasterTable& table = scene.casters();
    casters_.reserve(table.slots());
    tbb::parallel_for(world::CasterId{0}, world::CasterId(table.slots()), [&](world::CasterId id) {
        if (table[id].state == world::CasterState::kStatic) casters_.addStatic(id, table);
        else casters_.addActive(id, table);
    });
}

void ViewCasters::moved(std::span<const world::CasterId> casters) {
    for (const world::CasterId id : casters) casters_.addActive(id, scene_.casters());
}

void ViewCasters::drawCaster(world::CasterId caster, int view, const culling::ShadowView& of, const Geometry& geometry,
                             gpu::ViewPlan& plan, cache::Cost& cost) const {
    const culling::LightCaster& light = casters_[caster];
    if (light.bounds.max.x < of.low.x || light.bounds.min.x > of.high.x || light.bounds.max.y < of.low.y ||
        light.bounds.min.y > of.high.y)
        return;
    const world::MeshLevel& level = scene_.casters().meshOf(caster).levels[size_t(casters_.level(caster, view))];
    const glm::dvec2 low = of.low - glm::dvec2(light.origin), high = of.high - glm::dvec2(light.origin);
    bool placed = false;
    culling::eachMeeting(casters_.rects(caster, view).rows, {culling::roundedDown(low.x), culling::roundedDown(low.y)},
                         {culling::roundedUp(high.x), culling::roundedUp(high.y)}, [&](size_t k) {
        const world::Cluster& cluster = level.clusters[k];
        cost.triangles += cluster.indexCount / 3;
        if (placed && plan.items.back().firstIndex + plan.items.back().indexCount == cluster.firstIndex) {
            plan.items.back().indexCount += cluster.indexCount;
            return;
        }
        if (!placed) {
            plan.transforms.push_back(rowsOf(light, of));
            ++cost.casters;
            placed = true;
        }
        plan.items.push_back({geometry(level), cluster.firstIndex, cluster.indexCount, uint32_t(plan.transforms.size() - 1)});
        ++cost.draws;
    });
}

cache::Cost ViewCasters::plan(std::span<const culling::ShadowView> views, bool statics, const Geometry& geometry,
                              gpu::ViewPlan& plan) {
    plan = {};
    cache::Cost cost;
    for (size_t v = 0; v < views.size(); ++v) {
        const culling::ShadowView& view = views[v];
        if (view.statics && !statics) continue;
        if (plan.clears.empty() || plan.clears.back() != view.map) plan.clears.push_back(view.map);
        gpu::ViewPass pass;
        pass.map = view.map;
        pass.clipFromView = glm::mat4(view.clipFromLight);
        for (size_t i = 0; i < view.wedge.size(); ++i) pass.wedge[i] = glm::vec3(view.wedge[i]);
        pass.firstItem = uint32_t(plan.items.size());
        culling::castersOver(scene_.statics(), casters_, view.low, view.high, found_);
        for (const world::CasterId id : found_) drawCaster(id, int(v), view, geometry, plan, cost);
        if (!view.statics)
            for (const world::CasterId id : scene_.movers()) drawCaster(id, int(v), view, geometry, plan, cost);
        pass.itemCount = uint32_t(plan.items.size()) - pass.firstItem;
        plan.passes.push_back(pass);
    }
    return cost;
}

}  // namespace tools::lab
