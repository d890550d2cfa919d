#include "server/shadow_mask.h"

#include <map>
#include <span>

#include "culling/shadow_views.h"
#include "server/cascade_images.h"
#include "server/shading.h"

namespace server {

world::Result<std::unique_ptr<culling::Truth>> traceable(const world::CasterTable& casters) {
    auto truth = culling::Truth::create();
    if (!truth) return truth.error();
    std::map<world::MeshSlot, uint32_t> meshes;
    for (world::CasterId id = 0; id < casters.slots(); ++id) {
        const world::Caster& caster = casters[id];
        if (caster.state == world::CasterState::kFree) continue;
        if (!meshes.contains(caster.mesh)) {
            const auto mesh = truth.value()->addMesh(casters.meshOf(id).levels.front());
            if (!mesh) return mesh.error();
            meshes[caster.mesh] = mesh.value();
        }
        if (const auto added = truth.value()->add(id, meshes[caster.mesh], caster.placement); !added) return added.error();
    }
    return truth;
}

world::Result<std::vector<float>> lightByMaps(ShadowSystem& system, int camera, const culling::TruthFrame& seen,
                                              std::vector<bool>& known) {
    std::vector<float> light(seen.states.size());
    known.assign(seen.states.size(), true);
    std::vector<Receiver> receivers;
    for (size_t pixel = 0; pixel < light.size(); ++pixel) {
        if (seen.states[pixel] == culling::Sunlight::kSky) light[pixel] = 1;
        if (culling::sunward(seen.states[pixel]))
            receivers.push_back({seen.eye + glm::dvec3(seen.points[pixel]), seen.normals[pixel], uint32_t(pixel)});
    }
    const auto maps = readImages(system, camera);
    if (!maps) return maps.error();
    auto method = culling::methodNamed("gnomon");
    if (!method) return method.error();
    method.value().side = system.config().side;
    method.value().depthBits = system.config().format == gpu::DepthFormat::kD16 ? 16 : 32;
    const auto space = culling::makeLightSpace(seen.sun);
    if (!space) return space.error();
    const std::vector<std::span<const float>> images(maps.value().images.begin(), maps.value().images.end());
    culling::View view;
    view.eye = seen.eye;
    const std::vector<ReceiverLight> answers = shade(method.value(), maps.value().views, space.value(), view, images, receivers);
    for (size_t i = 0; i < receivers.size(); ++i) {
        light[receivers[i].pixel] = answers[i].light;
        known[receivers[i].pixel] = answers[i].texel > 0;
    }
    return light;
}

}  // namespace server
