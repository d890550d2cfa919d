// tests/toy_scene.h — a small live scene of boxes and sheets, and a plain rasteriser that executes
// frame plans: the yardstick for what the cache decides.
#pragma once

#include <algorithm>
#include <cmath>
#include <deque>
#include <random>
#include <vector>

#include "cache/frame_plan.h"
#include "cache/shadow_cache.h"
#include "culling/light_casters.h"
#include "culling/light_space.h"
#include "world/casters.h"
#include "world/clusters.h"
#include "world/octree.h"

namespace tests {

inline void addQuad(world::MeshLevel& level, glm::vec3 a, glm::vec3 b, glm::vec3 c, glm::vec3 d) {
    const auto first = static_cast<uint32_t>(level.positions.size());
    for (const glm::vec3& p : {a, b, c, d}) level.positions.push_back(p);
    for (uint32_t i : {0u, 1u, 2u, 0u, 2u, 3u}) level.indices.push_back(first + i);
}

inline world::Mesh finished(world::MeshLevel level) {
    world::Mesh mesh;
    world::buildClusters(level);
    for (const glm::vec3& p : level.positions) mesh.bounds.add(glm::dvec3(p));
    mesh.levels.push_back(std::move(level));
    return mesh;
}

/// A box of edge lengths `size` around its own origin.
inline world::Mesh boxMesh(glm::vec3 size) {
    const glm::vec3 h = size * 0.5f;
    const auto corner = [&](int i) {
        return glm::vec3(i & 1 ? h.x : -h.x, i & 2 ? h.y : -h.y, i & 4 ? h.z : -h.z);
    };
    world::MeshLevel level;
    for (const auto& f : {std::array{0, 1, 3, 2}, {4, 6, 7, 5}, {0, 4, 5, 1}, {2, 3, 7, 6}, {0, 2, 6, 4}, {1, 5, 7, 3}})
        addQuad(level, corner(f[0]), corner(f[1]), corner(f[2]), corner(f[3]));
    return finished(std::move(level));
}

/// A level sheet of n x n quads, `edge` metres a side, around its own origin.
inline world::Mesh sheetMesh(float edge, int n) {
    world::MeshLevel level;
    for (int j = 0; j <= n; ++j)
        for (int i = 0; i <= n; ++i)
            level.positions.push_back({edge * (float(i) / float(n) - 0.5f), 0, edge * (float(j) / float(n) - 0.5f)});
    const auto at = [&](int i, int j) { return static_cast<uint32_t>(j * (n + 1) + i); };
    for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i)
            for (uint32_t v : {at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j), at(i + 1, j + 1), at(i, j + 1)})
                level.indices.push_back(v);
    return finished(std::move(level));
}

inline world::Placement placedAt(glm::dvec3 p, double scale = 1) {
    world::Placement placement;
    placement.linear = glm::mat3(static_cast<float>(scale));
    placement.translation = p;
    return placement;
}

/// Casters with everything that the cache needs around them. Geometry ids are mesh slots.
struct ToyScene {
    explicit ToyScene(glm::dvec3 sun, std::vector<culling::Cascade> cascades, double reach = 1000)
        : light(culling::makeLightSpace(sun).value(), std::move(cascades)),
          statics({glm::dvec3(-reach), glm::dvec3(reach)}, 1) {}

    world::MeshSlot addMesh(world::Mesh mesh) {
        meshes.push_back(std::move(mesh));
        const world::MeshSlot slot = table.addMesh(meshes.back());
        for (auto& g : table.mesh(slot).geometry) g = slot;
        return slot;
    }
    world::CasterId addStatic(world::MeshSlot mesh, const world::Placement& placement) {
        const auto id = table.add(mesh, placement, world::CasterState::kStatic, {});
        light.addStatic(id, table);
        statics.insert(id, table[id].bounds);
        return id;
    }
    world::CasterId addActive(world::MeshSlot mesh, const world::Placement& placement) {
        const auto id = table.add(mesh, placement, world::CasterState::kActive, {});
        light.addActive(id, table);
        active.insert(std::lower_bound(active.begin(), active.end(), id), id);
        return id;
    }
    cache::Scene view(const culling::Occlusion* occlusion = nullptr) const {
        return {table, light, statics, active, occlusion};
    }

    std::deque<world::Mesh> meshes;
    world::CasterTable table;
    culling::LightCasters light;
    world::Octree statics;
    std::vector<world::CasterId> active;
};

/// Executes frame plans with a plain rasteriser: positions snap to 1/256 texel, a texel is covered
/// if its centre lies inside or on the edge of a triangle, the nearest depth stays.
class SoftMaps {
public:
    SoftMaps(const ToyScene& scene, size_t cascades, int side) : scene_(scene), side_(side) {
        maps_.assign(cascades, {std::vector<float>(size_t(side) * size_t(side), 1.0f),
                                std::vector<float>(size_t(side) * size_t(side), 1.0f)});
    }
    struct Maps {
        std::vector<float> cache, working;
        friend bool operator==(const Maps&, const Maps&) = default;
    };

    void execute(const cache::FramePlan& plan) {
        for (size_t c = 0; c < plan.cascades.size(); ++c) {
            const cache::CascadePlan& p = plan.cascades[c];
            Maps& m = maps_[c];
            for (const auto& r : p.unknowns) each(r, [&](size_t i) { m.cache[i] = cache::kUnknownDepth; });
            for (const auto& r : p.clears) each(r, [&](size_t i) { m.cache[i] = 1; });
            for (const auto& pass : p.staticPasses) draw(plan, pass, m.cache);
            for (const auto& r : p.restores) each(r, [&](size_t i) { m.working[i] = m.cache[i]; });
            for (const auto& pass : p.activePasses) draw(plan, pass, m.working);
        }
    }
    const std::vector<Maps>& maps() const { return maps_; }

private:
    template <class F>
    void each(const cache::StoreRect& r, F f) {
        for (int y = r.min.y; y < r.max.y; ++y)
            for (int x = r.min.x; x < r.max.x; ++x) f(size_t(y) * size_t(side_) + size_t(x));
    }
    void draw(const cache::FramePlan& plan, const cache::DrawPass& pass, std::vector<float>& map) {
        for (uint32_t k = pass.firstItem; k < pass.firstItem + pass.itemCount; ++k) {
            const cache::DrawItem& item = plan.items[k];
            const world::MeshLevel& level = scene_.table.mesh(item.geometry).mesh->levels[0];
            for (uint32_t i = item.firstIndex; i < item.firstIndex + item.indexCount; i += 3) {
                glm::dvec3 v[3];
                for (int n = 0; n < 3; ++n) {
                    const glm::vec4 p(level.positions[level.indices[i + uint32_t(n)]], 1);
                    const glm::mat3x4& m = plan.transforms[item.transform];
                    const auto texels = [&](float clip) {
                        return std::round((double(clip) + 1) * 0.5 * side_ * 256) / 256;
                    };
                    v[n] = {texels(glm::dot(m[0], p)), texels(glm::dot(m[1], p)), double(glm::dot(m[2], p))};
                }
                fill(v, pass.scissor, map);
            }
        }
    }
    void fill(const glm::dvec3 (&v)[3], const cache::StoreRect& scissor, std::vector<float>& map) {
        const auto cross = [](glm::dvec2 a, glm::dvec2 b) { return a.x * b.y - a.y * b.x; };
        const double area = cross(glm::dvec2(v[1] - v[0]), glm::dvec2(v[2] - v[0]));
        if (area == 0) return;
        const auto low = [&](int axis) { return std::min({v[0][axis], v[1][axis], v[2][axis]}); };
        const auto high = [&](int axis) { return std::max({v[0][axis], v[1][axis], v[2][axis]}); };
        const cache::StoreRect r{{std::max(double(scissor.min.x), std::floor(low(0))),
                                  std::max(double(scissor.min.y), std::floor(low(1)))},
                                 {std::min(double(scissor.max.x), std::ceil(high(0)) + 1),
                                  std::min(double(scissor.max.y), std::ceil(high(1)) + 1)}};
        for (int y = r.min.y; y < r.max.y; ++y)
            for (int x = r.min.x; x < r.max.x; ++x) {
                const glm::dvec2 p(x + 0.5, y + 0.5);
                double w[3];
                for (int e = 0; e < 3; ++e)
                    w[e] = cross(glm::dvec2(v[(e + 2) % 3] - v[(e + 1) % 3]), p - glm::dvec2(v[(e + 1) % 3])) / area;
                if (w[0] < 0 || w[1] < 0 || w[2] < 0) continue;
                const double d = std::clamp(w[0] * v[0].z + w[1] * v[1].z + w[2] * v[2].z, 0.0, 1.0);
                const double z = double(cache::kNearestDepth) + (1 - double(cache::kNearestDepth)) * d;
                float& held = map[size_t(y) * size_t(side_) + size_t(x)];
                held = std::min(held, static_cast<float>(z));
            }
    }

    const ToyScene& scene_;
    int side_;
    std::vector<Maps> maps_;
};

}  // namespace tests
