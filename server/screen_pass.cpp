#include "server/screen_pass.h"

#include <algorithm>
#include <glm/gtc/matrix_transform.hpp>

#include "server/filter_taps.h"

namespace server {

gpu::ShadowPassConfig passConfig(const culling::ShadowMethod& method, int maps, size_t receivers) {
    gpu::ShadowPassConfig config;
    config.maps = maps;
    config.side = method.side;
    config.format = method.depthBits == 16 ? gpu::DepthFormat::kD16 : gpu::DepthFormat::kD32;
    config.atlas = method.atlas;
    config.receivers = uint32_t(receivers);
    const FilterTaps taps = tapsOf(method.filter);
    for (size_t i = 0; i < taps.count; ++i) config.taps.steps[i] = glm::vec2(taps.steps[i]);
    config.taps.count = uint32_t(taps.count);
    config.taps.turned = taps.turned;
    config.taps.between = taps.between;
    config.taps.reach = float(taps.reach);
    return config;
}

gpu::PassScene passScene(const culling::ShadowMethod& method, std::span<const culling::ShadowView> views,
                         const culling::LightSpace& light, const culling::View& camera) {
    const glm::dvec3 eye = light.toLight(camera.eye);
    gpu::PassScene scene;
    for (const culling::ShadowView& view : views) {
        gpu::PassView made;
        const glm::dmat4 clipFromEye = glm::translate(view.clipFromLight, eye - view.origin);
        made.clipFromEye = glm::mat4(clipFromEye);
        made.eyeFromClip = glm::mat4(glm::inverse(clipFromEye));
        for (size_t i = 0; i < view.wedge.size(); ++i) made.wedge[i] = glm::vec3(view.wedge[i]);
        made.low = glm::vec2(view.low - glm::dvec2(eye));
        made.high = glm::vec2(view.high - glm::dvec2(eye));
        made.begin = float(view.begin);
        made.end = float(view.end);
        made.map = view.map;
        scene.views.push_back(made);
        scene.far = std::max(scene.far, made.end);
    }
    scene.lightFromWorld = glm::mat3(light.lightFromWorld);
    scene.forward = glm::vec3(camera.orientation * glm::dvec3(0, 0, -1));
    scene.byInterval = method.selection == culling::Selection::kInterval;
    scene.receiverBias = float(method.bias.receiver);
    scene.gradientBias = float(method.bias.gradient);
    scene.gradientMost = float(method.bias.gradientMost);
    scene.mostFall = method.bias.plane ? float(kMostFall) : 0;
    scene.normalOffset = float(method.bias.normalOffset);
    scene.blend = float(method.blend);
    scene.fade = float(method.fade);
    return scene;
}

gpu::PassReceiver passReceiver(const culling::View& camera, const Receiver& receiver) {
    return {glm::vec3(receiver.point - camera.eye), receiver.pixel, receiver.normal};
}

}  // namespace server
