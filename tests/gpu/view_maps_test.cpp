// Maps of any view: depths and edges against planes seen through warps, half planes, scissors, biases, what stays, and
// where moves put it.
#include "gpu/view_maps.h"

#include <algorithm>
#include <cmath>

#include "tests/gpu/scene.h"

namespace {

using gpu::DepthFormat;
using gpu::ViewPass;
using gpu::ViewPlan;

/// A float depth of an interpolated triangle of this size [of the range].
constexpr double kDepthError = 2e-5;

class ViewMapsTest : public testing::Test {
protected:
    void SetUp() override {
        auto made = gpu::Device::create({.validation = true, .nameContains = {}});
        ASSERT_TRUE(made) << made.error().what;
        device = std::move(made.value());
    }
    void TearDown() override {
        maps.reset();
        if (device)
            for (const std::string& message : device->validationMessages()) ADD_FAILURE() << message;
    }
    void makeMaps(int count, DepthFormat format = DepthFormat::kD32) {
        auto made = gpu::ViewMaps::create(
            *device, {.maps = count, .side = kSide, .format = format, .geometryBytes = 1 << 20});
        ASSERT_TRUE(made) << made.error().what;
        maps = std::move(made.value());
    }
    /// The quad |x|, |y| <= half with z = middle + slope . (x, y); its only item is the plan's first.
    ViewPlan planOf(double half, double middle, glm::dvec2 slope) {
        world::MeshLevel level;
        for (const glm::dvec2 p : {glm::dvec2(-half, -half), {half, -half}, {half, half}, {-half, half}})
            level.positions.emplace_back(glm::vec3(p, middle + glm::dot(slope, p)));
        level.indices = {0, 1, 2, 0, 2, 3};
        const auto id = maps->upload(level);
        EXPECT_TRUE(id) << id.error().what;
        ViewPlan plan;
        plan.transforms = {{glm::vec4(1, 0, 0, 0), glm::vec4(0, 1, 0, 0), glm::vec4(0, 0, 1, 0)}};
        plan.items = {{id.value(), 0, 6, 0}};
        plan.passes = {ViewPass{.map = 0, .itemCount = 1}};
        return plan;
    }
    std::vector<float> draw(const ViewPlan& plan, int map = 0) {
        const auto times = maps->draw(plan);
        EXPECT_TRUE(times) << times.error().what;
        auto depths = maps->read(map);
        EXPECT_TRUE(depths) << depths.error().what;
        return depths.value();
    }
    /// All over map 0: triangles at all depths, and gaps between them.
    std::vector<float> drawTriangles(std::mt19937& rng) {
        const auto id = maps->upload(gpu::test::triangleSoup(rng, 12));
        EXPECT_TRUE(id) << id.error().what;
        ViewPlan plan;
        plan.transforms = {{glm::vec4(1, 0, 0, 0), glm::vec4(0, 1, 0, 0), glm::vec4(0, 0, 1.2f, 0.5f)}};
        plan.items = {{id.value(), 0, 36, 0}};
        plan.clears = {0};
        plan.passes = {ViewPass{.map = 0, .itemCount = 1}};
        std::vector<float> depths = draw(plan);
        const auto near = std::count(depths.begin(), depths.end(), cache::kNearestDepth);
        const auto empty = std::count(depths.begin(), depths.end(), cache::kEmptyDepth);
        const auto between = std::ptrdiff_t(depths.size()) - near - empty;
        EXPECT_TRUE(near > 20 && empty > 100 && between > 400) << near << ", " << empty << ", " << between;
        return depths;
    }
    static constexpr int kSide = 64;
    std::unique_ptr<gpu::Device> device;
    std::unique_ptr<gpu::ViewMaps> maps;
};

/// What a depth becomes, one by one: as whole numbers of units, or as floats.
float movedDepth(float depth, int units, DepthFormat format) {
    if (depth == cache::kEmptyDepth) return depth;
    if (format == DepthFormat::kD32)
        return std::clamp(depth + float(units / 65535.0), cache::kNearestDepth, cache::kEmptyDepth);
    return float(std::clamp(std::lround(depth * 65535.0) + units, 1l, 65535l)) / 65535.0f;
}

std::vector<float> movedMap(const std::vector<float>& from, const gpu::MapMove& move, int side, DepthFormat format) {
    std::vector<float> to(from.size(), cache::kEmptyDepth);
    for (int y = 0; y < side; ++y)
        for (int x = 0; x < side; ++x) {
            const glm::ivec2 t = glm::ivec2(x, y) - move.by;
            if (t.x >= 0 && t.y >= 0 && t.x < side && t.y < side)
                to[size_t(y * side + x)] = movedDepth(from[size_t(t.y * side + t.x)], move.units, format);
        }
    return to;
}

double stored(double depth) { return cache::kNearestDepth + (1 - cache::kNearestDepth) * std::clamp(depth, 0.0, 1.0); }

/// Clip coordinates, x and y over w, of a texel's middle.
glm::dvec2 middleOf(size_t texel) {
    return glm::dvec2(double(texel % 64) + 0.5, double(texel / 64) + 0.5) * (2.0 / 64) - 1.0;
}

/// w = F . (x, y) + S, x and y scaled by d: the warp of a facet.
struct Warp {
    glm::dvec2 f{1, 0};
    double s = 0.5, d = 1.5;
    glm::mat4 clip() const {
        glm::dmat4 m(0);
        m[0] = {d, 0, 0, f.x};
        m[1] = {0, d, 0, f.y};
        m[2] = {0, 0, 0.2, 0};
        m[3] = {0, 0, 0.1, s};
        return glm::mat4(m);
    }
    /// w at a texel's middle, 0 where no point of w > 0 falls.
    double w(glm::dvec2 clip) const {
        const double rest = 1 - glm::dot(f, clip) / d;
        return rest > 0 ? s / rest : 0;
    }
};

TEST_F(ViewMapsTest, DepthsAreThoseOfAPlaneSeenThroughAWarp) {
    makeMaps(1);
    for (const Warp& warp : {Warp{}, Warp{.f = {0.6, 0.8}, .s = 0.3, .d = 1.3}, Warp{.f = {0, 0}, .s = 1, .d = 1}}) {
        const glm::dvec2 slope(0.1, -0.05);
        ViewPlan plan = planOf(0.4, 0.5, slope);
        plan.clears = {0};
        plan.passes[0].clipFromView = warp.clip();
        const std::vector<float> depths = draw(plan);
        size_t inside = 0, outside = 0;
        for (size_t i = 0; i < depths.size(); ++i) {
            const glm::dvec2 at = middleOf(i);
            const double w = warp.w(at);
            const glm::dvec2 p = at * (w / warp.d);
            const double edge = 0.4 - std::max(std::abs(p.x), std::abs(p.y));
            const double texel = 2.0 / 64 * w / warp.d;
            if (w > 0 && edge > texel) {
                ASSERT_NEAR(depths[i], stored((0.1 + 0.2 * (0.5 + glm::dot(slope, p))) / w), kDepthError) << i;
                ++inside;
            } else if (w == 0 || edge < -texel) {
                ASSERT_EQ(depths[i], cache::kEmptyDepth) << i;
                ++outside;
            }
        }
        EXPECT_GT(inside, 500u);
        EXPECT_GT(outside, 200u);
    }
}

TEST_F(ViewMapsTest, DepthsOutOfRangeAreClamped) {
    makeMaps(1);
    for (const auto& [middle, depth] : {std::pair(-3.0, stored(0)), std::pair(4.0, 1.0)}) {
        ViewPlan plan = planOf(2, middle, glm::dvec2(0));
        plan.clears = {0};
        const std::vector<float> depths = draw(plan);
        for (const float d : depths) ASSERT_EQ(d, float(depth));
    }
}

TEST_F(ViewMapsTest, WedgesCutOffExactlyWhatIsOutsideThem) {
    makeMaps(1);
    ViewPlan plan = planOf(2, 0.5, glm::dvec2(0));
    plan.clears = {0};
    plan.passes[0].wedge = {glm::vec3(1, 0.25f, -0.1f), glm::vec3(-0.5f, 1, 0)};
    const std::vector<float> depths = draw(plan);
    size_t drawn = 0;
    for (size_t i = 0; i < depths.size(); ++i) {
        const glm::dvec3 at(middleOf(i), 1);
        const double a = glm::dot(glm::dvec3(plan.passes[0].wedge[0]), at), b = glm::dot(glm::dvec3(plan.passes[0].wedge[1]), at);
        if (std::min(std::abs(a), std::abs(b)) < 1e-4) continue;
        ASSERT_EQ(depths[i] < 1, a > 0 && b > 0) << i;
        drawn += depths[i] < 1;
    }
    EXPECT_GT(drawn, 400u);

    // Two facets of one map share a border: each texel is drawn by one of them.
    plan.passes = {plan.passes[0], plan.passes[0]};
    plan.passes[0].wedge = {glm::vec3(1, 0.3f, 0), glm::vec3(0)};
    plan.passes[1].wedge = {glm::vec3(-1, -0.3f, 0), glm::vec3(0)};
    for (const float d : draw(plan)) EXPECT_LT(d, 1);
}

TEST_F(ViewMapsTest, SlopeBiasFollowsTheSlopeOfATexel) {
    makeMaps(1);
    const glm::dvec2 slope(0.2, -0.1);
    ViewPlan plan = planOf(2, 0.5, slope);
    plan.clears = {0};
    const std::vector<float> plain = draw(plan);
    plan.passes[0].slopeBias = 3;
    const std::vector<float> biased = draw(plan);
    for (size_t i = 0; i < plain.size(); ++i)
        ASSERT_NEAR(biased[i] - plain[i], 3 * 0.2 * 2 / 64, kDepthError) << "the larger of both slopes";
}

TEST_F(ViewMapsTest, WhatIsNotClearedStays) {
    makeMaps(2, DepthFormat::kD16);
    ViewPlan plan = planOf(2, 0.75, glm::dvec2(0));
    plan.clears = {0, 1};
    plan.passes.push_back(plan.passes[0]);
    plan.passes[1].map = 1;
    const float first = draw(plan, 1).front();
    EXPECT_NEAR(first, stored(0.75), 1.0 / 65535);
    ViewPlan nearer = planOf(2, 0.25, glm::dvec2(0));
    ViewPlan farther = planOf(2, 0.875, glm::dvec2(0));
    farther.clears = {0};
    EXPECT_NEAR(draw(farther, 0).front(), stored(0.875), 1.0 / 65535);
    EXPECT_EQ(draw(nearer, 1).front(), first);
    EXPECT_NEAR(draw(nearer, 0).front(), stored(0.25), 1.0 / 65535);
}

TEST_F(ViewMapsTest, ScissorsKeepPassesInside) {
    makeMaps(1);
    ViewPlan plan = planOf(2, 0.5, glm::dvec2(0));
    plan.clears = {0};
    plan.passes[0].scissor = {{3, 10}, {17, 64}};
    const std::vector<float> depths = draw(plan);
    for (size_t i = 0; i < depths.size(); ++i)
        ASSERT_EQ(depths[i] < 1, i % 64 >= 3 && i % 64 < 17 && i / 64 >= 10) << i;
}

TEST_F(ViewMapsTest, MovesPutEveryDepthWhereItGoes) {
    for (const DepthFormat format : {DepthFormat::kD16, DepthFormat::kD32}) {
        std::mt19937 rng(11);
        makeMaps(2, format);
        const auto between = [&rng](int low, int high) { return std::uniform_int_distribution<int>(low, high)(rng); };
        for (int step = 0; step < 60; ++step) {
            std::vector<float> expected[2] = {drawTriangles(rng), maps->read(1).value()};
            ViewPlan plan;
            for (int moves = between(1, 3); moves > 0; --moves) {
                const int reach = step % 5 == 0 ? 70 : 6;
                gpu::MapMove move{.from = between(0, 1), .to = between(0, 1)};
                if (step % 3) move.by = {between(-reach, reach), between(-reach, reach)};
                if (step % 4) move.units = between(-20000, 20000);
                expected[move.to] = movedMap(expected[move.from], move, kSide, format);
                plan.moves.push_back(move);
            }
            EXPECT_EQ(gpu::test::differing(draw(plan, 0), expected[0]), 0u) << gpu::test::nameOf(format) << ", step " << step;
            EXPECT_EQ(gpu::test::differing(draw({}, 1), expected[1]), 0u) << gpu::test::nameOf(format) << ", step " << step;
        }
    }
}

TEST_F(ViewMapsTest, EmptyTexelsStayEmptyHoweverDepthsMove) {
    for (const DepthFormat format : {DepthFormat::kD16, DepthFormat::kD32}) {
        makeMaps(1, format);
        ViewPlan plan = planOf(0.5, 0.75, glm::dvec2(0));
        plan.clears = {0};
        const std::vector<float> before = draw(plan);
        for (const int units : {-1, -40000, 70000}) {
            ViewPlan move;
            move.moves = {{.units = units}};
            const std::vector<float> after = draw(move);
            for (size_t i = 0; i < after.size(); ++i)
                if (before[i] == cache::kEmptyDepth) { ASSERT_EQ(after[i], cache::kEmptyDepth) << units; }
        }
    }
}

TEST_F(ViewMapsTest, DepthsNeverComeNearerThanCastersLeaveThem) {
    for (const DepthFormat format : {DepthFormat::kD16, DepthFormat::kD32}) {
        makeMaps(1, format);
        ViewPlan plan = planOf(2, 0.25, glm::dvec2(0));
        plan.clears = {0};
        draw(plan);
        for (const int units : {-16400, -1}) {
            ViewPlan move;
            move.moves = {{.units = units}};
            const std::vector<float> after = draw(move);
            for (const float depth : after) ASSERT_EQ(depth, cache::kNearestDepth) << units;
        }
    }
}

}  // namespace
