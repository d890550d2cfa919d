// tests/culling/hidden_layers.h — scenes in which casters hide each other, for what is said of hidden casters.
#pragma once

#include <glm/gtc/quaternion.hpp>
#include <random>
#include <vector>

#include "culling/caster_texels.h"
#include "tests/toy_scene.h"

namespace tests {

constexpr double kLayerTexel = 0.1;  ///< [m]
constexpr int kLayerSide = 96;

/// The map around a point, under the toy scene's only cascade.
inline culling::MapTexels mapAround(const ToyScene& scene, glm::dvec3 at) {
    const glm::dvec2 centre(scene.light.space().toLight(at));
    return {0, glm::i64vec2(glm::floor(centre / kLayerTexel)) - int64_t(kLayerSide / 2), kLayerSide};
}

inline ToyScene sceneUnder(glm::dvec3 sun) { return ToyScene(sun, {{4.4, kLayerTexel}}); }

/// Sheets over boxes over smaller sheets, turned at random, around `origin`: much is hidden, much in part.
struct HiddenLayers {
    explicit HiddenLayers(uint32_t seed, glm::dvec3 origin = glm::dvec3(0))
        : scene(sceneUnder({0.35, -1, 0.2})), map(mapAround(scene, origin)) {
        std::mt19937 rng(seed);
        const auto uniform = [&rng](double low, double high) { return low + (high - low) * double(rng()) / 4294967296.0; };
        const auto add = [&](world::MeshSlot mesh, double low, double high, double tilt) {
            world::Placement at = placedAt(origin + glm::dvec3(uniform(-6, 6), uniform(low, high), uniform(-6, 6)));
            const glm::dquat x = glm::angleAxis(uniform(-tilt, tilt), glm::dvec3(1, 0, 0));
            const glm::dquat z = glm::angleAxis(uniform(-tilt, tilt), glm::dvec3(0, 0, 1));
            at.linear = glm::mat3(glm::mat3_cast(x * z));
            ids.push_back(scene.addStatic(mesh, at));
        };
        const auto large = scene.addMesh(sheetMesh(5, 6)), small = scene.addMesh(sheetMesh(0.5f, 3));
        const auto box = scene.addMesh(boxMesh({0.7f, 0.9f, 0.6f}));
        for (int i = 0; i < 12; ++i) add(large, 2, 6, 0.2);
        for (int i = 0; i < 150; ++i) add(i % 2 ? box : small, -6, 4, 3);
    }
    ToyScene scene;
    culling::MapTexels map;
    std::vector<world::CasterId> ids;
};

}  // namespace tests
