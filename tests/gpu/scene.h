// tests/gpu/scene.h — random scenes on a map, plans that draw them, and a device that must stay silent.
#pragma once

#include <gtest/gtest.h>

#include <cstring>
#include <memory>
#include <random>
#include <vector>

#include "cache/frame_plan.h"
#include "gpu/device.h"
#include "gpu/shadow_maps.h"
#include "world/mesh.h"

namespace gpu::test {

/// A validated device and maps on it. Any message of the validation layer fails the test.
class MapsTest : public testing::Test {
protected:
    void SetUp() override {
        auto made = Device::create({.validation = true, .nameContains = {}});
        ASSERT_TRUE(made) << made.error().what;
        device = std::move(made.value());
    }
    void TearDown() override {
        maps.reset();
        if (device)
            for (const std::string& message : device->validationMessages()) ADD_FAILURE() << message;
    }
    void makeMaps(int side, int cascades = 1, uint64_t geometryBytes = 16 << 20) {
        config.cascades = cascades;
        config.side = side;
        config.geometryBytes = geometryBytes;
        auto made = ShadowMaps::create(*device, config);
        ASSERT_TRUE(made) << made.error().what;
        maps = std::move(made.value());
    }
    cache::GeometryId upload(const world::MeshLevel& level) {
        auto id = maps->upload(level);
        EXPECT_TRUE(id) << id.error().what;
        return id ? id.value() : 0;
    }
    GpuTimes execute(const cache::FramePlan& plan) {
        auto times = maps->execute(plan);
        EXPECT_TRUE(times) << times.error().what;
        return times ? times.value() : GpuTimes{};
    }
    GpuTimes redraw(const cache::FramePlan& plan) {
        auto times = maps->redraw(plan);
        EXPECT_TRUE(times) << times.error().what;
        return times ? times.value() : GpuTimes{};
    }
    std::vector<float> read(MapKind kind, int cascade = 0) {
        auto depths = maps->read(cascade, kind);
        EXPECT_TRUE(depths) << depths.error().what;
        return depths ? depths.value() : std::vector<float>{};
    }

    ShadowMapsConfig config;  ///< of `makeMaps`
    std::unique_ptr<Device> device;
    std::unique_ptr<ShadowMaps> maps;
};

inline std::string nameOf(DepthFormat format) { return format == DepthFormat::kD16 ? "D16" : "D32"; }

/// Texels whose bits differ.
inline size_t differing(const std::vector<float>& a, const std::vector<float>& b) {
    EXPECT_EQ(a.size(), b.size());
    size_t count = 0;
    for (size_t i = 0; i < std::min(a.size(), b.size()); ++i)
        count += std::memcmp(&a[i], &b[i], sizeof(float)) != 0;
    return count;
}

/// Share of texels that something was drawn to.
inline double covered(const std::vector<float>& depths) {
    size_t count = 0;
    for (const float d : depths) count += d < 1;
    return static_cast<double>(count) / static_cast<double>(std::max<size_t>(1, depths.size()));
}

/// Affine map from a mesh's own frame to stored texels (x, y) and depth: rows, as a plan has them.
struct ToTexels {
    glm::dvec4 x{1, 0, 0, 0}, y{0, 1, 0, 0}, depth{0, 0, 1, 0};

    glm::dvec3 operator()(glm::vec3 v) const {
        const glm::dvec4 v1(v, 1);
        return {glm::dot(x, v1), glm::dot(y, v1), glm::dot(depth, v1)};
    }
    /// Texel 0 begins at clip -1, texel `side` would at 1.
    glm::mat3x4 toClip(int side) const {
        const glm::dvec4 minusOne(0, 0, 0, -1);
        return {glm::vec4(x * (2.0 / side) + minusOne), glm::vec4(y * (2.0 / side) + minusOne),
                glm::vec4(depth)};
    }
};

inline world::MeshLevel triangleSoup(std::mt19937& rng, int triangles) {
    std::uniform_real_distribution<float> unit(-1, 1);
    world::MeshLevel level;
    for (int i = 0; i < 3 * triangles; ++i) {
        level.positions.emplace_back(unit(rng), unit(rng), unit(rng));
        level.indices.push_back(static_cast<uint32_t>(i));
    }
    return level;
}

/// The box [-1, 1]^3.
inline world::MeshLevel box() {
    world::MeshLevel level;
    for (int i = 0; i < 8; ++i) level.positions.emplace_back(i & 1 ? 1 : -1, i & 2 ? 1 : -1, i & 4 ? 1 : -1);
    level.indices = {0, 1, 3, 0, 3, 2, 4, 5, 7, 4, 7, 6, 0, 1, 5, 0, 5, 4,
                     2, 3, 7, 2, 7, 6, 0, 2, 6, 0, 6, 4, 1, 3, 7, 1, 7, 5};
    return level;
}

/// Items over a map, each with the texels that it may touch.
struct Scene {
    int side = 0;
    std::vector<glm::mat3x4> transforms;
    std::vector<cache::DrawItem> items;
    std::vector<cache::StoreRect> bounds;  ///< by item, grown by a texel; not clipped to the map

    /// All items in one pass over the whole, cleared map.
    cache::FramePlan whole() const {
        const cache::StoreRect map{glm::ivec2(0), glm::ivec2(side)};
        cache::FramePlan plan;
        plan.transforms = transforms;
        plan.items = items;
        plan.cascades.resize(1);
        plan.cascades[0].clears = {map};
        plan.cascades[0].staticPasses = {{map, 0, static_cast<uint32_t>(items.size())}};
        return plan;
    }
};

/// Whole or partial meshes of `levels`, uploaded as `ids`: from `least` to `most` texels large, placed so
/// that they overlap the map more often than not, at depths from about -0.2 to 1.2.
inline Scene randomScene(std::mt19937& rng, int side, int count, double least, double most,
                         const std::vector<world::MeshLevel>& levels,
                         const std::vector<cache::GeometryId>& ids) {
    Scene scene;
    scene.side = side;
    std::uniform_real_distribution<double> unit(-1, 1);
    const auto below = [&rng](size_t n) { return std::uniform_int_distribution<size_t>(0, n - 1)(rng); };
    for (int i = 0; i < count; ++i) {
        const size_t mesh = below(levels.size());
        const world::MeshLevel& level = levels[mesh];
        const double size = least * std::pow(most / least, 0.5 + 0.5 * unit(rng));
        const double depthSize = 0.1 * (0.5 + 0.5 * unit(rng));
        const auto row = [&](double scale, double centre) {
            return glm::dvec4(scale * unit(rng), scale * unit(rng), scale * unit(rng), centre);
        };
        const double middle = 0.5 * side, away = middle + size;
        const ToTexels m{row(size, middle + away * unit(rng)), row(size, middle + away * unit(rng)),
                         row(depthSize, 0.5 + 0.7 * unit(rng))};
        const auto triangles = level.indices.size() / 3;
        const size_t first = below(2) ? below(triangles) : 0;
        const size_t runLength = first > 0 ? 1 + below(triangles - first) : triangles;
        scene.items.push_back({ids[mesh], static_cast<uint32_t>(3 * first),
                               static_cast<uint32_t>(3 * runLength), static_cast<uint32_t>(i)});
        scene.transforms.push_back(m.toClip(side));

        glm::dvec2 low(1e9), high(-1e9);
        for (size_t k = 3 * first; k < 3 * (first + runLength); ++k) {
            const glm::dvec2 p(m(level.positions[level.indices[k]]));
            low = glm::min(low, p);
            high = glm::max(high, p);
        }
        scene.bounds.push_back({glm::ivec2(glm::floor(low)) - 1, glm::ivec2(glm::ceil(high)) + 1});
    }
    return scene;
}

inline bool overlap(const cache::StoreRect& a, const cache::StoreRect& b) {
    return a.min.x < b.max.x && b.min.x < a.max.x && a.min.y < b.max.y && b.min.y < a.max.y;
}

/// Cuts `rect` at random into disjoint pieces that cover it.
inline void shatter(std::mt19937& rng, cache::StoreRect rect, int cuts, std::vector<cache::StoreRect>& out) {
    const glm::ivec2 size = rect.max - rect.min;
    const int axis = std::uniform_int_distribution<int>(0, 1)(rng);
    if (cuts == 0 || size[axis] < 2) {
        out.push_back(rect);
        return;
    }
    const int at = rect.min[axis] + std::uniform_int_distribution<int>(1, size[axis] - 1)(rng);
    cache::StoreRect low = rect, high = rect;
    low.max[axis] = at;
    high.min[axis] = at;
    shatter(rng, low, (cuts - 1) / 2, out);
    shatter(rng, high, cuts - 1 - (cuts - 1) / 2, out);
}

}  // namespace gpu::test
