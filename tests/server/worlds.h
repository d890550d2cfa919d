// tests/server/worlds.h — worlds to run the whole system on, baked into a temporary folder, and a
// device with validation that must stay silent.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <memory>
#include <random>
#include <string>

#include "gpu/device.h"
#include "server/shadow_system.h"
#include "tests/toy_scene.h"
#include "world/bake.h"
#include "world/store.h"

namespace tests {

/// One validated device per test program: creating one costs more than most tests.
inline gpu::Device& validatedDevice() {
    static const std::unique_ptr<gpu::Device> device = [] {
        auto made = gpu::Device::create({.validation = true, .nameContains = ""});
        if (!made) throw std::runtime_error(made.error().what);
        return std::move(made.value());
    }();
    return *device;
}

/// Fails if the validation layer said anything since the last call.
inline void expectSilence() {
    static size_t seen = 0;
    const std::vector<std::string> messages = validatedDevice().validationMessages();
    for (; seen < messages.size(); ++seen) ADD_FAILURE() << messages[seen];
}

/// A file name in a folder that goes with the program.
inline std::string temporary(const std::string& name) {
    struct Folder {
        std::filesystem::path path;
        Folder() {
            std::string pattern = (std::filesystem::temp_directory_path() / "gnomon-test-XXXXXX").string();
            if (!mkdtemp(pattern.data())) throw std::runtime_error("no temporary folder");
            path = pattern;
        }
        ~Folder() { std::filesystem::remove_all(path); }
    };
    static const Folder folder;
    return (folder.path / name).string();
}

/// Bakes `source` and opens the world.
inline world::WorldStore baked(const world::BakeSource& source, const std::string& name) {
    const std::string path = temporary(name);
    auto stats = world::bake(source, path, [](size_t, size_t) {});
    if (!stats) throw std::runtime_error(stats.error().what);
    auto store = world::WorldStore::open(path);
    if (!store) throw std::runtime_error(store.error().what);
    return std::move(store.value());
}

/// Streets of boxes under roofs: 12 x 12 chunks of 16 m around `origin`, each with a sheet of ground,
/// boxes that straddle borders, and a low roof that hides what stands under it. Every box is named.
inline world::BakeSource streets(glm::dvec3 origin) {
    world::BakeSource source;
    source.header.chunkSize = 16;
    source.header.sun = glm::normalize(glm::dvec3(0.5, -0.9, 0.3));
    source.header.source = "streets";
    for (world::Mesh mesh : {boxMesh({1, 2, 1}), boxMesh({4, 3, 2}), sheetMesh(18, 12), sheetMesh(9, 6)}) {
        for (world::MeshLevel& level : mesh.levels) level.clusters.clear();
        source.meshes.push_back(std::move(mesh));
    }
    const glm::i64vec2 base(glm::floor(glm::dvec2(origin.x, origin.z) / 16.0));
    for (int x = -6; x < 6; ++x)
        for (int z = -6; z < 6; ++z)
            source.chunks.push_back({int32_t(base.x) + x, 0, int32_t(base.y) + z});
    source.make = [](world::ChunkKey key) -> world::Result<world::SourceChunk> {
        world::SourceChunk chunk;
        std::mt19937 rng(uint32_t(key.x * 1000 + key.z));
        const auto uniform = [&rng](double a, double b) { return a + (b - a) * double(rng()) / 4294967295.0; };
        const glm::dvec3 corner(key.x * 16.0, 0, key.z * 16.0);
        const auto add = [&](uint32_t mesh, glm::dvec3 p, const std::string& name) {
            const double a = uniform(0, 6.28);
            world::Instance instance{mesh, placedAt(corner + p)};
            if (mesh < 2) {
                instance.placement.linear =
                    glm::mat3(float(std::cos(a)), 0, float(-std::sin(a)), 0, 1, 0, float(std::sin(a)), 0, float(std::cos(a)));
            }
            chunk.instances.push_back(instance);
            chunk.names.push_back(name);
        };
        add(2, {8, 0, 8}, "");
        add(3, {uniform(2, 14), 5, uniform(2, 14)}, "roof " + world::toString(key));
        for (int i = 0; i < 8; ++i)
            add(uint32_t(i % 3 == 0), {uniform(0, 16), 1, uniform(0, 16)}, "box " + world::toString(key) + " " + std::to_string(i));
        return chunk;
    };
    return source;
}

/// Streets around the origin, baked once.
inline const world::WorldStore& streetsWorld() {
    static const world::WorldStore store = baked(streets(glm::dvec3(0)), "streets.world");
    return store;
}

/// On the validated device.
inline std::unique_ptr<server::ShadowSystem> systemOn(const world::WorldStore& store, const server::ShadowConfig& config,
                                                      world::WorldEditor* editor = nullptr) {
    auto system = server::ShadowSystem::create(validatedDevice(), store, config, editor);
    if (!system) throw std::runtime_error(system.error().what);
    return std::move(system.value());
}

}  // namespace tests
