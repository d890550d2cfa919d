// tests/server/screen_pass_test.cpp — the GPU's deferred pass against the same shading in doubles, from noise and from a
// world; atlas against array.
#include "server/screen_pass.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <optional>
#include <random>

#include "cache/frame_plan.h"
#include "server/filter_taps.h"
#include "tests/server/worlds.h"
#include "tests/world/random_world.h"
#include "tools/lab/run.h"

namespace {

using culling::Filter;
using culling::ShadowMethod;
using culling::ShadowView;
using server::Receiver;
using server::ReceiverLight;

/// One rounding to a float, relative.
constexpr double kRounding = 1.0 / (1 << 24);

/// All that shading asks for.
struct Question {
    ShadowMethod method{};
    std::vector<ShadowView> views{};
    culling::LightSpace light{};
    culling::View camera{};
    std::vector<std::vector<float>> images{};
    std::vector<Receiver> receivers{};

    std::vector<ReceiverLight> byCpu(std::span<const Receiver> some) const {
        const std::vector<std::span<const float>> spans(images.begin(), images.end());
        return server::shade(method, views, light, camera, spans, some);
    }
    std::vector<gpu::PassAnswer> byGpu(bool atlas) const {
        gpu::ShadowPassConfig config = server::passConfig(method, int(images.size()), receivers.size());
        config.atlas = atlas;
        auto pass = gpu::ShadowPass::create(tests::validatedDevice(), config);
        EXPECT_TRUE(pass) << pass.error().what;
        const std::vector<std::span<const float>> spans(images.begin(), images.end());
        pass.value()->load(spans);
        std::vector<gpu::PassReceiver> asked;
        for (const Receiver& r : receivers) asked.push_back(server::passReceiver(camera, r));
        const auto shaded = pass.value()->shade(server::passScene(method, views, light, camera), asked);
        EXPECT_TRUE(shaded) << shaded.error().what;
        const auto answers = pass.value()->answers();
        return {answers.begin(), answers.end()};
    }
    /// How far a tap may land from where doubles put it [texels]: its place is a sum of terms as large as the map, or as the
    /// way from the eye, with some sixteen roundings. GLSL's sine and cosine are good to 2^-11.
    double tapError(const Receiver& receiver, const ReceiverLight& answer) const {
        const ShadowView& view = views[size_t(std::max<int>(0, answer.view))];
        const glm::dvec3 p = light.toLight(receiver.point);
        const glm::dmat2 edges = culling::texelEdges(view, method.side, glm::dvec2(p - view.origin));
        const double away = glm::length(receiver.point - camera.eye) / std::min(glm::length(edges[0]), glm::length(edges[1]));
        return 16 * kRounding * std::max(double(method.side), away) +
               (server::tapsOf(method.filter).turned ? server::kDiskRadius / 2048 : 0);
    }
    /// How far depths may be off [m]: terms as large as the range of depths and the way from the eye. Where a map is warped,
    /// a texel's depth is multiplied by what w is there: at most what its edge has grown by.
    double depthError(const ReceiverLight& answer) const {
        double range = 0;
        for (const ShadowView& view : views) range = std::max({range, view.depthRange, view.end});
        return 16 * kRounding * range * std::max(1.0, double(answer.texel) / views[size_t(std::max<int>(0, answer.view))].texel);
    }
};

/// What came of a comparison. Light differs by rounding, or since a tap fell to the other side of a border.
struct Comparison {
    size_t points = 0, answered = 0;
    size_t tapsLeft = 0;     ///< points with a tap beside the map
    size_t flipped = 0;      ///< answered by another view, or with light that rounding does not explain
    size_t unexplained = 0;  ///< of these, what doubles answer nowhere within the errors of places and depths
    double expected = 0;     ///< at most to be flipped, if points lie anywhere
    double off = 0;          ///< summed over the others: difference of light

    Comparison& operator+=(const Comparison& o) {
        points += o.points;
        answered += o.answered;
        tapsLeft += o.tapsLeft;
        flipped += o.flipped;
        unexplained += o.unexplained;
        expected += o.expected;
        off += o.off;
        return *this;
    }
};
std::ostream& operator<<(std::ostream& out, const Comparison& c) {
    return out << c.points << " points, " << c.answered << " answered, " << c.tapsLeft << " with taps beside the map, "
               << c.flipped << " flipped, at most " << c.expected << " expected, " << c.unexplained
               << " unexplained, the others off by " << c.off / double(c.points) << " in the mean";
}

/// Places around a point within the errors of floats, as each view has them.
std::vector<Receiver> around(const Question& q, const Receiver& r, const ReceiverLight& answer) {
    std::vector<Receiver> places;
    const glm::dvec3 p = q.light.toLight(r.point);
    for (const ShadowView& view : q.views) {
        const glm::dmat2 edges =
            culling::texelEdges(view, q.method.side, glm::dvec2(p - view.origin)) * q.tapError(r, answer);
        for (int i = 0; i < 81; ++i) {
            // Near by as well: farther off more than one tap may lie across a border.
            const double share = i < 27 ? 1 : i < 54 ? 1.0 / 16 : 1.0 / 256;
            const glm::dvec3 way = (glm::dvec3(i % 3, i / 3 % 3, i / 9 % 3) - 1.0) * share;
            places.push_back({q.light.toWorld(p + glm::dvec3(edges * glm::dvec2(way), way.z * q.depthError(answer))),
                              r.normal, r.pixel});
        }
    }
    return places;
}

/// CHECKs bits of the atlas's answers against the array's, and counts how these differ from those of doubles.
Comparison compare(const Question& q) {
    const std::vector<gpu::PassAnswer> gpu = q.byGpu(false), atlas = q.byGpu(true);
    const std::vector<ReceiverLight> cpu = q.byCpu(q.receivers);
    EXPECT_EQ(gpu.size(), cpu.size());
    EXPECT_EQ(atlas.size(), cpu.size());
    EXPECT_EQ(std::memcmp(gpu.data(), atlas.data(), gpu.size() * sizeof(gpu::PassAnswer)), 0)
        << q.method.name << ": an atlas and an array of the same maps answer apart";
    // Through a blend or a fade light changes so many times as fast as places do.
    const double ramp = std::max({1.0, q.method.blend > 0 ? 1 / q.method.blend : 0, q.method.fade > 0 ? 1 / q.method.fade : 0});
    Comparison c;
    c.points = cpu.size();
    for (size_t i = 0; i < cpu.size(); ++i) {
        const Receiver& receiver = q.receivers[i];
        const double tapError = q.tapError(receiver, cpu[i]);
        c.answered += cpu[i].view >= 0;
        c.tapsLeft += cpu[i].tapLeft;
        // A tap changes its texel if it lies nearer than that to one of the borders on both sides, along either axis.
        c.expected += 4 * tapError * double(server::tapsOf(q.method.filter).count);
        // Weights of a box are products of two places between texels; each tap is a rounding more.
        const double rounding = 16 * kRounding * ramp;
        const double lightError = rounding + (server::tapsOf(q.method.filter).between ? 2 * tapError : 0);
        const double light(gpu[i].light), off = std::abs(light - double(cpu[i].light));
        if (off <= lightError && gpu[i].view == cpu[i].view) {
            c.off += off;
            continue;
        }
        ++c.flipped;
        double low = 1, high = 0;
        bool seen = false;
        for (const ReceiverLight& near : q.byCpu(around(q, receiver, cpu[i]))) {
            low = std::min(low, double(near.light));
            high = std::max(high, double(near.light));
            seen |= near.view == gpu[i].view;
        }
        c.unexplained += !seen || light < low - lightError || light > high + lightError;
    }
    return c;
}

/// The bound takes the worst of all roundings, and texels that all differ from their neighbours. Measured are some ten
/// flips in a million points in noise and six in streets, all others being off by less than 5e-7 in the mean.
void expectRounding(const Comparison& c) {
    EXPECT_LT(double(c.flipped), c.expected) << c;
    EXPECT_LT(c.flipped, c.points / 20000) << c;
    EXPECT_LT(c.off / double(c.points), 5e-6) << c;
}

/// Maps of noise around an eye: in every second texel a caster, some texels unknown. Points all over them, many at
/// their rims.
Question noise(const ShadowMethod& method, uint32_t seed, glm::dvec3 eye = glm::dvec3(0)) {
    Question q{.method = method, .light = culling::makeLightSpace({0.3, -1, 0.2}).value()};
    q.camera.eye = eye;
    q.camera.orientation = glm::angleAxis(-0.8, glm::normalize(glm::dvec3(1, 0.3, 0)));
    q.camera.verticalFov = 1;
    q.camera.aspect = 1.5;
    q.views = culling::viewsOf(method, q.light, q.camera, 0.5, 100, {eye - 120.0, eye + 120.0});
    std::mt19937 rng(seed);
    std::uniform_real_distribution<double> unit(0, 1);
    for (int m = 0; m <= q.views.back().map; ++m) {
        q.images.emplace_back(size_t(method.side) * size_t(method.side));
        for (float& depth : q.images.back()) {
            const double kind = unit(rng);
            depth = kind < 0.002 ? cache::kUnknownDepth : kind < 0.5 ? cache::kEmptyDepth : float(unit(rng));
            if (method.depthBits == 16) depth = float(std::lround(depth * 65535)) / 65535.0f;
        }
    }
    for (uint32_t n = 0; n < 15000; ++n) {
        const ShadowView& view = q.views[rng() % q.views.size()];
        glm::dvec2 at(unit(rng), unit(rng));
        if (n % 2)  // at a rim, up to three texels to either side
            at[int(rng() % 2)] = double(rng() % 2) + (unit(rng) - 0.5) * 6 / method.side;
        const glm::dvec4 back = glm::inverse(view.clipFromLight) * glm::dvec4(2.0 * at - 1.0, 0.2 + 0.6 * unit(rng), 1);
        const glm::dvec3 normal(unit(rng) - 0.5, unit(rng) - 0.5, -unit(rng));
        q.receivers.push_back({q.light.toWorld(glm::dvec3(back) / back.w + view.origin),
                               glm::vec3(q.light.toWorld(glm::normalize(normal))), uint32_t(rng())});
    }
    return q;
}

constexpr Filter kFilters[] = {Filter::kNone,    Filter::kBox2,           Filter::kBox3,
                               Filter::kPoisson, Filter::kPoissonRotated, Filter::kDiskRotated};

/// Methods that take all ways through a pass, but for filters.
std::vector<ShadowMethod> allWays() {
    using culling::Fit, culling::Selection;
    ShadowMethod plain{.name = "by map"};
    plain.splits.count = 3;
    plain.side = 256;
    ShadowMethod interval = plain, moved = plain, many = plain, facets = plain, warped = plain;
    plain.bias = {.receiver = 0.5, .gradient = 1};
    plain.blend = 0.3;
    interval.name = "by interval";
    interval.selection = Selection::kInterval;
    interval.fade = 0.3;
    interval.blend = 0.2;
    moved.name = "moved along normals";
    moved.bias.normalOffset = 2;
    moved.depthBits = 16;
    moved.staticMap = true;
    many.name = "many maps";
    many.splits.count = 6;
    many.selection = Selection::kInterval;
    facets.name = "facets";
    facets.fit = Fit::kFacets;
    facets.facets = 5;
    facets.bias = {.gradient = 2, .gradientMost = 3, .normalOffset = 1};
    warped.name = "warped";
    warped.fit = Fit::kWarped;
    warped.selection = Selection::kInterval;
    for (ShadowMethod* one : {&facets, &warped}) {
        one->splits.count = 1;
        one->snapped = false;
    }
    return {plain, interval, moved, many, facets, warped};
}

TEST(ScreenPass, AnswersFromNoiseAsDoublesDo) {
    uint32_t seed = 0;
    Comparison all;
    for (const Filter filter : kFilters)
        for (ShadowMethod method : allWays()) {
            method.filter = filter;
            ASSERT_TRUE(culling::requireMethod(method));
            const double far = seed % 2 ? 1e6 : 0;
            const Comparison c = compare(noise(method, ++seed, {far, 30, -far}));
            EXPECT_EQ(c.unexplained, 0u) << method.name << ", filter " << int(filter) << ": " << c;
            EXPECT_GT(c.answered, c.points / 3) << method.name;
            all += c;
        }
    expectRounding(all);
    EXPECT_GT(all.tapsLeft, all.points / 50) << all;
    tests::expectSilence();
}

// Places and weights that are small multiples of a power of two are rounded by neither: taps between texels, points on
// borders of texels and maps, all are answered alike.
TEST(ScreenPass, WhatFloatsHoldExactlyIsAnsweredExactly) {
    constexpr int kSide = 64;
    Question q{.light = culling::makeLightSpace({0, -1, 0}).value()};
    std::mt19937 rng(3);
    for (int m = 0; m < 3; ++m) {
        ShadowView view;
        const double edge = 32 << m;
        view.clipFromLight = {{2 / edge, 0, 0, 0}, {0, 2 / edge, 0, 0}, {0, 0, 1.0 / 128, 0}, {-1, -1, 0, 1}};
        view.low = glm::dvec2(-edge / 2);
        view.high = glm::dvec2(edge / 2);
        view.origin = {view.low, -64};
        view.end = edge / 2;
        view.texel = edge / kSide;
        view.depthRange = 128;
        view.map = m;
        q.views.push_back(view);
        q.images.emplace_back(kSide * kSide);
        for (float& depth : q.images.back()) depth = rng() % 97 ? rng() % 2 ? 0.25f : cache::kEmptyDepth : cache::kUnknownDepth;
    }
    // Casters are at -32 m, to the precision of a depth; no point is nearer to that than a metre.
    for (uint32_t n = 0; n < 20000; ++n) {
        const glm::ivec2 place(int(rng() % 4200) - 2100, int(rng() % 4200) - 2100);
        q.receivers.push_back({q.light.toWorld({glm::dvec2(place) / 32.0, rng() % 4 ? 8.0 : -40.0}), {0, 1, 0}, n});
    }
    for (const Filter filter : {Filter::kNone, Filter::kBox2, Filter::kPoisson})
        for (const auto selection : {culling::Selection::kMap, culling::Selection::kInterval}) {
            q.method = {.name = "exact", .selection = selection, .side = kSide, .bias = {.receiver = 0.5}, .filter = filter};
            const std::vector<gpu::PassAnswer> gpu = q.byGpu(true);
            const std::vector<ReceiverLight> cpu = q.byCpu(q.receivers);
            size_t shadowed = 0, views[4] = {};
            for (size_t i = 0; i < cpu.size(); ++i) {
                ASSERT_EQ(gpu[i].light, cpu[i].light) << i << ", filter " << int(filter);
                ASSERT_EQ(gpu[i].view, cpu[i].view) << i << ", filter " << int(filter);
                shadowed += cpu[i].light < 1;
                ++views[cpu[i].view + 1];
            }
            EXPECT_GT(shadowed, 5000u);
            for (const size_t count : views) EXPECT_GT(count, selection == culling::Selection::kMap ? 100u : 0u);
        }
    tests::expectSilence();
}

/// Receivers and maps of a method in a frame of the lab: streets of boxes around a place.
class ScreenPassOfTheLab : public testing::Test {
protected:
    explicit ScreenPassOfTheLab(glm::dvec3 origin = glm::dvec3(0))
        : store(tests::baked(tests::streets(origin), "screen pass.world")),
          light(culling::makeLightSpace(store.header().sun).value()) {
        for (size_t k = 0; k < 2; ++k)
            path.push_back({double(k) / 10, origin + glm::dvec3(-6 + 0.8 * double(k), 4, 20), glm::angleAxis(-0.3, glm::dvec3(1, 0, 0))});
        auto loaded = tools::lab::Scene::load(store, path, 120, light, none);
        if (!loaded) throw std::runtime_error(loaded.error().what);
        scene.emplace(std::move(loaded.value()));
        setting.emplace(tools::lab::Setting{tests::validatedDevice(), store, *scene, none, light, 120, glm::radians(60.0)});
        tools::lab::RunConfig config;
        const world_tests::TempFolder folder;
        auto kept = tools::TruthStore::open(folder.file("truth"));
        auto truth = tools::lab::traceTruth(*setting, path, tools::lab::judgedFrames(path.size(), 0), config, kept.value(),
                                            [](size_t, size_t) {});
        if (!truth) throw std::runtime_error(truth.error().what);
        receivers = truth.value().front().askedFirst.receivers;
    }
    ~ScreenPassOfTheLab() override { tests::expectSilence(); }

    Question questionOf(const ShadowMethod& method) {
        auto engine = tools::lab::makeEngine(*setting, method, path.front());
        if (!engine) throw std::runtime_error(engine.error().what);
        if (const auto drawn = engine.value()->advance(path.front()); !drawn) throw std::runtime_error(drawn.error().what);
        auto images = engine.value()->images();
        if (!images) throw std::runtime_error(images.error().what);
        const auto views = engine.value()->views();
        return {method, {views.begin(), views.end()}, engine.value()->light(), tools::lab::viewAt(*setting, path.front()),
                std::move(images.value()), receivers};
    }
    void compareAll() {
        std::mt19937 rng(9);
        Comparison all;
        for (const ShadowMethod& method : culling::namedMethods()) {
            Question q = questionOf(method);
            const Comparison whole = compare(q);
            EXPECT_EQ(whole.unexplained, 0u) << method.name << ": " << whole;
            EXPECT_GT(whole.answered, whole.points / 2) << method.name;
            for (std::vector<float>& image : q.images)
                for (float& depth : image)
                    if (rng() % 50 == 0) depth = cache::kUnknownDepth;
            const Comparison holes = compare(q);
            EXPECT_EQ(holes.unexplained, 0u) << method.name << ", with unknown texels: " << holes;
            all += whole;
            all += holes;
        }
        EXPECT_GT(all.points, 1000000u) << all;
        expectRounding(all);
    }

    world::WorldStore store;
    culling::LightSpace light;
    std::vector<world::Pose> path;
    std::vector<world::MoverTrack> none;
    std::optional<tools::lab::Scene> scene;
    std::optional<tools::lab::Setting> setting;
    std::vector<Receiver> receivers;
};

class ScreenPassFarOut : public ScreenPassOfTheLab {
protected:
    ScreenPassFarOut() : ScreenPassOfTheLab({1e6, 0, -1e6}) {}
};

TEST_F(ScreenPassOfTheLab, EveryNamedMethodIsShadedAsDoublesDo) { compareAll(); }
TEST_F(ScreenPassFarOut, EveryNamedMethodIsShadedAsDoublesDo) { compareAll(); }

TEST(ScreenPass, NewMapsComeWithTheNextPass) {
    Question q = noise(allWays()[0], 1);
    auto pass = gpu::ShadowPass::create(tests::validatedDevice(), server::passConfig(q.method, 3, q.receivers.size()));
    ASSERT_TRUE(pass) << pass.error().what;
    std::vector<gpu::PassReceiver> asked;
    for (const Receiver& r : q.receivers) asked.push_back(server::passReceiver(q.camera, r));
    const gpu::PassScene scene = server::passScene(q.method, q.views, q.light, q.camera);
    for (const float depth : {cache::kNearestDepth, cache::kEmptyDepth, cache::kUnknownDepth, cache::kNearestDepth}) {
        const std::vector<float> image(256 * 256, depth);
        const std::vector<std::span<const float>> spans(3, image);
        pass.value()->load(spans);
        for (int again = 0; again < 2; ++again) {
            ASSERT_TRUE(pass.value()->shade(scene, asked));
            size_t answered = 0;
            for (const gpu::PassAnswer& answer : pass.value()->answers()) {
                answered += answer.view >= 0;
                ASSERT_EQ(answer.light, answer.view >= 0 && depth == cache::kNearestDepth ? 0 : 1);
            }
            EXPECT_EQ(answered > asked.size() / 2, depth != cache::kUnknownDepth);
            EXPECT_EQ(answered == 0, depth == cache::kUnknownDepth);
        }
    }
    ASSERT_TRUE(pass.value()->shade(scene, {}));
    EXPECT_TRUE(pass.value()->answers().empty());
    ASSERT_TRUE(pass.value()->shade(scene, std::span(asked).first(1)));
    EXPECT_EQ(pass.value()->answers().size(), 1u);
    tests::expectSilence();
}

TEST(ScreenPass, WhatNoDeviceHoldsIsRefused) {
    gpu::ShadowPassConfig config{.side = 1 << 20};
    EXPECT_EQ(gpu::ShadowPass::create(tests::validatedDevice(), config).error().code, world::ErrorCode::kLimit);
    config = {.receivers = 0xffffffff};
    EXPECT_EQ(gpu::ShadowPass::create(tests::validatedDevice(), config).error().code, world::ErrorCode::kLimit);
    tests::expectSilence();
}

}  // namespace
