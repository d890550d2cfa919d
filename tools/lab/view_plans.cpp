#include "tools/lab/view_plans.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <limits>

#include "culling/caster_query.h"
#include "culling/receivers.h"

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

/// Deepest that a cluster may reach, light space [m].
double deepest(const culling::LightCaster& caster, const world::Cluster& cluster) {
    const glm::dvec3 row(caster.lightFromMesh[0].z, caster.lightFromMesh[1].z, caster.lightFromMesh[2].z);
    const glm::dvec3 min(cluster.min), max(cluster.max);
    return caster.origin.z + glm::dot(row, (min + max) * 0.5) + glm::dot(glm::abs(row), (max - min) * 0.5);
}

/// The pass of a view with its bias, without items.
gpu::ViewPass passOf(const culling::ShadowView& view, const culling::ShadowBias& bias) {
    gpu::ViewPass pass;
    pass.map = view.map;
    pass.clipFromView = glm::mat4(view.clipFromLight);
    // Depth is in units of the range at w = 1.
    const auto constant = float(bias.constant * view.texel / view.depthRange);
    for (int column = 0; column < 4; ++column) pass.clipFromView[column][2] += constant * pass.clipFromView[column][3];
    pass.slopeBias = float(bias.slope);
    for (size_t i = 0; i < view.wedge.size(); ++i) pass.wedge[i] = glm::vec3(view.wedge[i]);
    return pass;
}

}  // namespace

ViewCasters::ViewCasters(const Scene& scene, const culling::LightSpace& light, const culling::ShadowMethod& method,
                         std::span<const culling::ShadowView> views)
    : scene_(scene), bias_(method.bias), casters_(light, cascadesOf(views), {.levelError = method.levelError}) {
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

void ViewCasters::drawCaster(world::CasterId caster, int number, const culling::ShadowView& of, double from,
                             std::span<const CasterCluster> hidden, ViewTarget& target, gpu::ViewPlan& plan,
                             cache::Cost& cost) const {
    const culling::LightCaster& light = casters_[caster];
    if (light.bounds.max.x < of.low.x || light.bounds.min.x > of.high.x || light.bounds.max.y < of.low.y ||
        light.bounds.min.y > of.high.y || light.bounds.max.z <= from)
        return;
    const world::MeshLevel& level = scene_.casters().meshOf(caster).levels[size_t(casters_.level(caster, number))];
    const glm::dvec2 low = of.low - glm::dvec2(light.origin), high = of.high - glm::dvec2(light.origin);
    bool placed = false;
    culling::eachMeeting(casters_.rects(caster, number).rows, {culling::roundedDown(low.x), culling::roundedDown(low.y)},
                         {culling::roundedUp(high.x), culling::roundedUp(high.y)}, [&](size_t k) {
        const world::Cluster& cluster = level.clusters[k];
        if (light.bounds.min.z <= from && deepest(light, cluster) <= from) return;
        if (std::binary_search(hidden.begin(), hidden.end(), CasterCluster(caster, uint32_t(k)))) return;
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
        plan.items.push_back({target.geometry(level), cluster.firstIndex, cluster.indexCount, uint32_t(plan.transforms.size() - 1)});
        ++cost.draws;
    });
}

cache::Cost ViewCasters::draw(std::span<const world::CasterId> casters, int number, const culling::ShadowView& of,
                              ViewTarget& target, gpu::ViewPlan& plan, double from,
                              std::span<const CasterCluster> hidden) const {
    cache::Cost cost;
    gpu::ViewPass pass = passOf(of, bias_);
    pass.firstItem = uint32_t(plan.items.size());
    for (const world::CasterId id : casters) drawCaster(id, number, of, from, hidden, target, plan, cost);
    pass.itemCount = uint32_t(plan.items.size()) - pass.firstItem;
    plan.passes.push_back(pass);
    return cost;
}

std::vector<world::CasterId> ViewCasters::staticsOver(const culling::ShadowView& view) const {
    std::vector<world::CasterId> found;
    culling::castersOver(scene_.statics(), casters_, view.low, view.high, found);
    return found;
}

cache::Cost ViewCasters::plan(std::span<const culling::ShadowView> views, bool statics, ViewTarget& target,
                              gpu::ViewPlan& plan, const culling::View* seenBy) {
    const world::Octree none({}, 1);
    const auto unseen = [&](world::CasterId id) {
        const culling::Cascade endless{.split = std::numeric_limits<double>::infinity(), .texel = 0};
        return culling::unseenCascades(*seenBy, {&endless, 1}, none, scene_.casters(), {&id, 1}, true) != 0;
    };
    plan = {};
    cache::Cost cost;
    for (size_t v = 0; v < views.size(); ++v) {
        const culling::ShadowView& view = views[v];
        if (view.statics && !statics) continue;
        if (plan.clears.empty() || plan.clears.back() != view.map) plan.clears.push_back(view.map);
        std::vector<world::CasterId> casters = staticsOver(view);
        if (!view.statics) casters.insert(casters.end(), scene_.movers().begin(), scene_.movers().end());
        if (seenBy) std::erase_if(casters, unseen);
        cost += draw(casters, int(v), view, target, plan);
    }
    return cost;
}

}  // namespace tools::lab
