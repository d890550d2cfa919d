// server/screen_pass.h — a method's settings, views and points as the GPU's deferred pass takes them: what doubles know
// of places in the world is taken relative to the eye before it becomes floats.
#pragma once

#include <span>
#include <vector>

#include "gpu/shadow_pass.h"
#include "server/shading.h"

namespace server {

/// Of a pass for a method that has so many maps, and at most so many points at once.
gpu::ShadowPassConfig passConfig(const culling::ShadowMethod& method, int maps, size_t receivers);

/// A frame's scene. Arguments as those of `shade`, whose answers the pass then gives, but for rounding to floats.
gpu::PassScene passScene(const culling::ShadowMethod& method, std::span<const culling::ShadowView> views,
                         const culling::LightSpace& light, const culling::View& camera);

gpu::PassReceiver passReceiver(const culling::View& camera, const Receiver& receiver);

}  // namespace server
