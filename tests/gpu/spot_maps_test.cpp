// Spot lights' maps: depths against planes seen from the light, what is cut off, and how lights come and go.
#include <cmath>

#include "cache/spot_cache.h"
#include "gpu/device_impl.h"
#include "tests/gpu/scene.h"

namespace {

using gpu::MapKind;

constexpr double kNear = 0.1, kSlope = 0.8;

class SpotMaps : public gpu::test::MapsTest {
protected:
    void SetUp() override {
        MapsTest::SetUp();
        makeMaps(64);
    }
    /// A mesh in the light's frame [m].
    static glm::mat3x4 asItIs() {
        const glm::vec3 scale = glm::vec3(1 / kSlope, 1 / kSlope, 1) / float(kNear);
        return {{scale.x, 0, 0, 0}, {0, scale.y, 0, 0}, {0, 0, scale.z, 0}};
    }
    /// Each light's map drawn from one mesh, or left alone where there is none.
    static cache::FramePlan planFor(const std::vector<int>& sides, const std::vector<int>& meshes) {
        cache::FramePlan plan;
        plan.reset(sides.size());
        plan.transforms = {asItIs()};
        for (size_t i = 0; i < sides.size(); ++i) {
            if (meshes[i] < 0) continue;
            const cache::StoreRect whole{glm::ivec2(0), glm::ivec2(sides[i])};
            plan.cascades[i].clears = {whole};
            plan.cascades[i].staticPasses = {{whole, static_cast<uint32_t>(plan.items.size()), 1}};
            plan.cascades[i].restores = {whole};
            plan.items.push_back({static_cast<uint32_t>(meshes[i]), 0, 6, 0});
        }
        return plan;
    }
    std::vector<float> readSpot(size_t light, MapKind kind) {
        auto depths = maps->readSpot(light, kind);
        EXPECT_TRUE(depths) << depths.error().what;
        return depths ? depths.value() : std::vector<float>{};
    }
    /// A large quad through `p` with a normal n; n is not along y.
    static world::MeshLevel plane(glm::dvec3 p, glm::dvec3 n) {
        const glm::dvec3 u = glm::normalize(glm::cross(n, glm::dvec3(0, 1, 0))) * 50.0;
        const glm::dvec3 v = glm::normalize(glm::cross(n, u)) * 50.0;
        world::MeshLevel level;
        for (const glm::dvec3& corner : {p - u - v, p + u - v, p + u + v, p - u + v}) level.positions.emplace_back(corner);
        level.indices = {0, 1, 2, 0, 2, 3};
        return level;
    }
};

/// z of a plane along a texel's ray; behind the light or nearer than near: nothing, as 0.
double seen(glm::dvec3 p, glm::dvec3 n, int side, size_t texel) {
    const glm::dvec2 at(double(texel % size_t(side)) + 0.5, double(texel / size_t(side)) + 0.5);
    const glm::dvec3 ray((at * 2.0 / double(side) - 1.0) * kSlope, 1);
    const double z = glm::dot(n, p) / glm::dot(n, ray);
    return z >= kNear ? z : 0;
}

TEST_F(SpotMaps, DepthsAreThoseOfPlanesAndWhatIsNearIsCutOff) {
    const int side = 96;
    ASSERT_TRUE(maps->addSpot(side));
    int cut = 0, compared = 0;
    for (const auto& [p, n] : {std::pair(glm::dvec3(0, 0, 5), glm::dvec3(0, 0, 1)),
                               std::pair(glm::dvec3(0, 0, 3), glm::dvec3(0.5, 0.4, 1)),
                               std::pair(glm::dvec3(0.05, 0, 0), glm::dvec3(1, 0, 0.02)),
                               std::pair(glm::dvec3(0, 0, -4), glm::dvec3(0, 0, 1)),
                               std::pair(glm::dvec3(0, 0, 0.07), glm::dvec3(0.01, 0, 1))}) {
        const auto mesh = upload(plane(p, n));
        ASSERT_TRUE(maps->execute({}, planFor({side}, {int(mesh)})));
        const std::vector<float> depths = readSpot(0, MapKind::kCache);
        EXPECT_EQ(readSpot(0, MapKind::kWorking), depths);
        for (size_t i = 0; i < depths.size(); ++i) {
            const double z = seen(p, n, side, i);
            if (z == 0 || z > 20) {  // the quad has an end farther off
                if (z == 0) {
                    ASSERT_EQ(depths[i], cache::kEmptyDepth) << "texel " << i;
                    ++cut;
                }
                continue;
            }
            // Positions snap to 1/256 texel at most, which moves z by as much of the plane's slope; near the cut
            // a texel may fall on either side. Depths are rounded twice, by 2^-24.
            const double slope = z * z * (std::abs(n.x) + std::abs(n.y)) / std::abs(glm::dot(n, p));
            const double snap = slope * kSlope * 2 / side / 256;
            if (z - snap < kNear && depths[i] == cache::kEmptyDepth) continue;
            ASSERT_NEAR(cache::distanceOf(depths[i], kNear), z, snap + 2 * z * z / kNear * 6e-8) << "texel " << i;
            ++compared;
        }
    }
    EXPECT_GT(cut, 2 * side * side);
    EXPECT_GT(compared, 2 * side * side);
}

TEST_F(SpotMaps, LightsOfAnySizeComeAndGo) {
    const int near = int(upload(plane({0, 0, 2}, {0, 0, 1}))), far = int(upload(plane({0, 0, 8}, {0, 0, 1})));
    for (const int side : {64, 200, 64}) ASSERT_TRUE(maps->addSpot(side));
    const auto fresh = readSpot(1, MapKind::kWorking);
    EXPECT_EQ(fresh, std::vector<float>(200 * 200, cache::kEmptyDepth));
    EXPECT_FALSE(maps->execute({}, planFor({64, 200, 64}, {-1, -1, -1})).value().submitted);
    const auto times = maps->execute({}, planFor({64, 200, 64}, {near, far, -1})).value();
    EXPECT_TRUE(times.submitted);
    EXPECT_TRUE(times.spotsMs > 0 || device->impl().timestampMs == 0);
    const auto first = readSpot(0, MapKind::kCache), second = readSpot(1, MapKind::kWorking);
    EXPECT_LT(first[0], second[0]);
    EXPECT_EQ(readSpot(2, MapKind::kCache), std::vector<float>(64 * 64, cache::kEmptyDepth));

    ASSERT_TRUE(maps->removeSpot(0));
    EXPECT_EQ(readSpot(0, MapKind::kWorking), second);
    ASSERT_TRUE(maps->execute({}, planFor({200, 64}, {-1, near})));
    EXPECT_EQ(readSpot(1, MapKind::kCache), first);
    ASSERT_TRUE(maps->addSpot(64));
    // A redraw has maps of its own, also for a light that came later.
    ASSERT_TRUE(maps->redraw({}, planFor({200, 64, 64}, {far, far, near})));
    EXPECT_EQ(readSpot(0, MapKind::kScratchCache), second);
    EXPECT_EQ(readSpot(2, MapKind::kScratchWorking), first);
    EXPECT_EQ(readSpot(1, MapKind::kCache), first);
    EXPECT_EQ(readSpot(2, MapKind::kCache), std::vector<float>(64 * 64, cache::kEmptyDepth));

    const auto tooLarge = maps->addSpot(1 << 30);
    ASSERT_FALSE(tooLarge);
    EXPECT_EQ(tooLarge.error().code, world::ErrorCode::kLimit);
}

TEST_F(SpotMaps, LightsOfManySizesLeaveNothingBehind) {
    const std::atomic<uint64_t>& created = device->impl().owner.created;
    std::vector<uint64_t> made;  // for each light
    for (const int side : {64, 200, 96, 200, 64}) {
        const uint64_t before = created;
        ASSERT_TRUE(maps->addSpot(side));
        readSpot(0, MapKind::kCache);
        made.push_back(created - before);
        ASSERT_TRUE(maps->removeSpot(0));
    }
    // The first one makes the pipeline and the frame; each makes its maps, and what it is read with.
    EXPECT_GT(made[0], made[1]);
    for (size_t i = 2; i < made.size(); ++i) EXPECT_EQ(made[i], made[1]);
}

TEST_F(SpotMaps, ASteadyStateMakesNothing) {
    const int mesh = int(upload(plane({0, 0, 2}, {0, 0, 1})));
    ASSERT_TRUE(maps->addSpot(64));
    ASSERT_TRUE(maps->execute({}, planFor({64}, {mesh})));
    const uint64_t before = device->impl().owner.created;
    for (int i = 0; i < 20; ++i) ASSERT_TRUE(maps->execute({}, planFor({64}, {mesh})));
    EXPECT_EQ(device->impl().owner.created, before);
}

}  // namespace
