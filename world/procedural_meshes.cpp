// world/procedural_meshes.cpp — see procedural_meshes.h.
#include "world/procedural_meshes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <utility>

#include "world/noise.h"

namespace world {
namespace {

using glm::vec3;

/// Collects closed parts.
class Builder {
public:
    void box(vec3 low, vec3 high) { frustum(low, high, 1, 1); }

    /// A box whose top is scaled towards its middle in x and z.
    void frustum(vec3 low, vec3 high, float topX, float topZ) {
        const vec3 mid = (low + high) * 0.5f, half = (high - low) * 0.5f;
        const uint32_t v = count();
        for (const float y : {-1.0f, 1.0f}) {
            const float sx = y > 0 ? topX : 1, sz = y > 0 ? topZ : 1;
            for (const auto& [x, z] : {std::pair(-1.0f, -1.0f), {1.0f, -1.0f}, {1.0f, 1.0f}, {-1.0f, 1.0f}}) {
                level_.positions.push_back(mid + half * vec3(x * sx, y, z * sz));
            }
        }
        loops(v, 4, 2);
    }

    /// Rings of n vertices around the y axis through `at`, each {radius, y}, lowest first; closed by
    /// flat ends, or by a point where a radius is 0 (only the last).
    void lathe(vec3 at, int n, const std::vector<glm::vec2>& rings) {
        const uint32_t v = count();
        uint32_t full = 0;
        for (const glm::vec2& ring : rings) {
            if (ring.x == 0) break;
            for (int i = 0; i < n; ++i) {
                const float a = 2 * std::numbers::pi_v<float> * float(i) / float(n);
                level_.positions.push_back(at + vec3(ring.x * std::cos(a), ring.y, ring.x * std::sin(a)));
            }
            ++full;
        }
        if (full == rings.size()) {
            loops(v, static_cast<uint32_t>(n), full);
            return;
        }
        const uint32_t tip = count(), m = static_cast<uint32_t>(n);
        level_.positions.push_back(at + vec3(0, rings.back().y, 0));
        sides(v, m, full);
        cap(v, m, false);
        for (uint32_t i = 0; i < m; ++i)
            triangle(v + (full - 1) * m + i, tip, v + (full - 1) * m + (i + 1) % m);
    }

    /// A roof: ridge along x, over the rectangle given by two corners at the eaves.
    void roof(vec3 low, vec3 high) {
        const uint32_t v = count();
        const float z = (low.z + high.z) / 2;
        level_.positions.insert(level_.positions.end(), {{low.x, low.y, low.z},
                                                         {high.x, low.y, low.z},
                                                         {high.x, low.y, high.z},
                                                         {low.x, low.y, high.z},
                                                         {low.x, high.y, z},
                                                         {high.x, high.y, z}});
        for (const auto& [a, b, c] : {std::array{0u, 1u, 2u},
                                      {0u, 2u, 3u},
                                      {0u, 4u, 5u},
                                      {0u, 5u, 1u},
                                      {2u, 5u, 4u},
                                      {2u, 4u, 3u},
                                      {0u, 3u, 4u},
                                      {1u, 5u, 2u}}) {
            triangle(v + a, v + b, v + c);
        }
    }

    /// A ball from an icosahedron split `splits` times, stretched to `radii`, dented by noise of the
    /// given share of the radius.
    void ball(vec3 at, vec3 radii, int splits, float dents, uint32_t seed) {
        const float g = std::numbers::phi_v<float>;
        std::vector<vec3> p{{-1, g, 0},  {1, g, 0},  {-1, -g, 0}, {1, -g, 0}, {0, -1, g},  {0, 1, g},
                            {0, -1, -g}, {0, 1, -g}, {g, 0, -1},  {g, 0, 1},  {-g, 0, -1}, {-g, 0, 1}};
        std::vector<std::array<uint32_t, 3>> faces{
            {0, 11, 5},  {0, 5, 1},  {0, 1, 7},  {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
            {11, 10, 2}, {10, 7, 6}, {7, 1, 8},  {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
            {3, 8, 9},   {4, 9, 5},  {2, 4, 11}, {6, 2, 10}, {8, 6, 7},   {9, 8, 1}};
        for (int s = 0; s < splits; ++s) {
            std::map<std::pair<uint32_t, uint32_t>, uint32_t> middles;
            const auto middle = [&](uint32_t a, uint32_t b) {
                const auto [it, fresh] = middles.try_emplace(std::pair(std::min(a, b), std::max(a, b)),
                                                             static_cast<uint32_t>(p.size()));
                if (fresh) p.push_back((glm::normalize(p[a]) + glm::normalize(p[b])) * 0.5f);
                return it->second;
            };
            std::vector<std::array<uint32_t, 3>> finer;
            for (const auto& [a, b, c] : faces) {
                const uint32_t ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
                finer.insert(finer.end(), {{a, ab, ca}, {b, bc, ab}, {c, ca, bc}, {ab, bc, ca}});
            }
            faces = std::move(finer);
        }
        const uint32_t v = count();
        for (const vec3& q : p) {
            const vec3 unit = glm::normalize(q);
            const auto dent = static_cast<float>(noise3(glm::dvec3(unit) * 1.7 + 0.37, seed));
            level_.positions.push_back(at + unit * radii * (1 + dents * dent));
        }
        for (const auto& [a, b, c] : faces) triangle(v + a, v + b, v + c);
    }

    Mesh take() {
        Mesh mesh;
        for (const vec3& p : level_.positions) mesh.bounds.add(glm::dvec3(p));
        mesh.levels.push_back(std::move(level_));
        return mesh;
    }

private:
    uint32_t count() const { return static_cast<uint32_t>(level_.positions.size()); }
    void triangle(uint32_t a, uint32_t b, uint32_t c) {
        level_.indices.insert(level_.indices.end(), {a, b, c});
    }
    /// Walls between rings of n vertices each, which run from +x to +z, from the lowest upwards.
    void sides(uint32_t v, uint32_t n, uint32_t rings) {
        for (uint32_t r = 0; r + 1 < rings; ++r) {
            for (uint32_t i = 0; i < n; ++i) {
                const uint32_t a = v + r * n + i, b = v + r * n + (i + 1) % n;
                triangle(a, a + n, b + n);
                triangle(a, b + n, b);
            }
        }
    }
    void cap(uint32_t v, uint32_t n, bool top) {
        for (uint32_t i = 1; i + 1 < n; ++i) {
            top ? triangle(v, v + i + 1, v + i) : triangle(v, v + i, v + i + 1);
        }
    }
    void loops(uint32_t v, uint32_t n, uint32_t rings) {
        sides(v, n, rings);
        cap(v, n, false);
        cap(v + (rings - 1) * n, n, true);
    }

    MeshLevel level_;
};

Mesh conifer() {
    Builder b;
    b.lathe({0, 0, 0}, 6, {{0.25f, -0.8f}, {0.18f, 3}});
    b.lathe({0, 0, 0}, 10, {{2.0f, 1.4f}, {0, 5.5f}});
    b.lathe({0, 0, 0}, 10, {{1.6f, 3.6f}, {0, 7.6f}});
    b.lathe({0, 0, 0}, 10, {{1.1f, 5.8f}, {0, 9.6f}});
    return b.take();
}

Mesh broadleaf() {
    Builder b;
    b.lathe({0, 0, 0}, 7, {{0.35f, -0.8f}, {0.25f, 2.2f}, {0.15f, 4}});
    b.ball({0, 5, 0}, {2.4f, 2.1f, 2.4f}, 2, 0.15f, 5);
    b.ball({1.3f, 4, 0.5f}, {1.5f, 1.2f, 1.5f}, 1, 0.15f, 6);
    b.ball({-1.1f, 4.2f, -0.7f}, {1.6f, 1.2f, 1.5f}, 1, 0.15f, 7);
    return b.take();
}

Mesh bush() {
    Builder b;
    b.ball({0, 0.5f, 0}, {1.0f, 0.8f, 0.9f}, 1, 0.2f, 8);
    b.ball({0.7f, 0.3f, 0.4f}, {0.6f, 0.5f, 0.6f}, 1, 0.2f, 9);
    return b.take();
}

Mesh boulder() {
    Builder b;
    b.ball({0, 0.5f, 0}, {1.4f, 1.1f, 1.2f}, 2, 0.35f, 10);
    return b.take();
}

Mesh rockSlab() {
    Builder b;
    b.ball({0, 0.15f, 0}, {2.6f, 0.6f, 1.7f}, 1, 0.3f, 11);
    b.ball({0.9f, 0.6f, 0.2f}, {1.3f, 0.4f, 1.0f}, 1, 0.3f, 12);
    return b.take();
}

Mesh house() {
    Builder b;
    b.box({-5, -1.5f, -4}, {5, 5.2f, 4});
    b.roof({-5.6f, 5, -4.7f}, {5.6f, 8.2f, 4.7f});
    b.box({2.4f, 5.5f, 0.8f}, {3.3f, 9.2f, 1.6f});
    b.box({-1, -1.5f, -5.2f}, {1, 0.4f, -3.9f});
    b.box({-1.4f, 2.5f, -5.4f}, {1.4f, 2.7f, -3.9f});
    for (const float x : {-1.2f, 1.2f}) b.lathe({x, 0, -5.1f}, 6, {{0.09f, 0.3f}, {0.09f, 2.55f}});
    return b.take();
}

Mesh cottage() {
    Builder b;
    b.box({-3.6f, -1.2f, -3}, {3.6f, 2.9f, 3});
    b.roof({-4.1f, 2.7f, -3.6f}, {4.1f, 5.4f, 3.6f});
    b.box({-2.6f, 3.2f, -0.9f}, {-1.9f, 6.1f, -0.3f});
    b.box({1.2f, -1.2f, 2.9f}, {3.4f, 2.1f, 5});
    return b.take();
}

Mesh shed() {
    Builder b;
    b.box({-2, -0.8f, -1.5f}, {2, 2.2f, 1.5f});
    b.roof({-2.3f, 2.1f, -1.8f}, {2.3f, 3.1f, 1.8f});
    b.box({-3.4f, -0.5f, -1}, {-2.05f, 1, 1});
    return b.take();
}

Mesh pole() {
    Builder b;
    b.lathe({0, 0, 0}, 8, {{0.16f, -0.8f}, {0.11f, 8}});
    b.box({-1.1f, 7.2f, -0.06f}, {1.1f, 7.4f, 0.06f});
    for (const float x : {-0.95f, 0.95f}) b.lathe({x, 0, 0}, 6, {{0.06f, 7.38f}, {0.06f, 7.65f}});
    return b.take();
}

Mesh wall() {
    Builder b;
    b.box({-2.05f, -0.6f, -0.2f}, {2.05f, 1.1f, 0.2f});
    b.frustum({-2.05f, 1.05f, -0.28f}, {2.05f, 1.25f, 0.28f}, 1, 0.6f);
    b.box({-2.25f, -0.6f, -0.3f}, {-1.75f, 1.4f, 0.3f});
    return b.take();
}

Mesh fence() {
    Builder b;
    for (const float x : {-1.95f, 0.0f}) b.box({x - 0.06f, -0.6f, -0.06f}, {x + 0.06f, 1.3f, 0.06f});
    for (const float y : {0.35f, 0.75f, 1.1f}) b.box({-2.05f, y, -0.03f}, {2.05f, y + 0.12f, 0.03f});
    return b.take();
}

/// Four wheels along x at the given ends of a vehicle.
void wheels(Builder& b, float halfWidth, std::array<float, 2> axles, float radius) {
    for (const float z : axles) {
        for (const float x : {-halfWidth, halfWidth}) {
            b.box({x - 0.11f, 0, z - 0.6f * radius}, {x + 0.11f, 2 * radius, z + 0.6f * radius});
            b.box({x - 0.1f, 0.4f * radius, z - radius}, {x + 0.1f, 1.6f * radius, z + radius});
        }
    }
}

Mesh car() {
    Builder b;
    b.frustum({-0.88f, 0.25f, -2.1f}, {0.88f, 0.85f, 2.1f}, 0.95f, 0.96f);
    b.frustum({-0.8f, 0.8f, -1.0f}, {0.8f, 1.45f, 1.8f}, 0.8f, 0.65f);
    wheels(b, 0.75f, {-1.3f, 1.3f}, 0.32f);
    return b.take();
}

Mesh van() {
    Builder b;
    b.box({-0.95f, 0.3f, -1.5f}, {0.95f, 2.3f, 2.5f});
    b.frustum({-0.93f, 0.3f, -2.5f}, {0.93f, 1.5f, -1.4f}, 0.95f, 0.7f);
    wheels(b, 0.82f, {-1.6f, 1.6f}, 0.36f);
    return b.take();
}

Mesh truck() {
    Builder b;
    b.box({-1.2f, 1.0f, -1.6f}, {1.2f, 3.4f, 4});
    b.frustum({-1.15f, 0.5f, -3.7f}, {1.15f, 2.7f, -1.8f}, 0.95f, 0.85f);
    b.box({-0.5f, 0.5f, -3}, {0.5f, 1.05f, 3.9f});
    wheels(b, 1.0f, {-2.8f, 2.6f}, 0.5f);
    return b.take();
}

}  // namespace

std::vector<Mesh> proceduralMeshes() {
    std::vector<Mesh> meshes;
    meshes.reserve(kProceduralMeshCount);
    for (const auto make : {conifer, broadleaf, bush, boulder, rockSlab, house, cottage, shed, pole, wall,
                            fence, car, van, truck}) {
        meshes.push_back(make());
    }
    return meshes;
}

}  // namespace world
