// Shading from made-up maps: what a filter, a bias, a blend or a border does to the answer, by formula.
#include "server/shading.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <numbers>
#include <random>

#include "cache/frame_plan.h"
#include "server/filter_taps.h"

namespace {

using culling::Filter;
using culling::ShadowMethod;
using culling::ShadowView;

constexpr double kNothing = std::numeric_limits<double>::infinity();
constexpr double kNear = 0.2, kFar = 100;

/// A sun, a camera, a method and its maps.
struct Stage {
    culling::LightSpace light = culling::makeLightSpace({0.3, -1, 0.2}).value();
    culling::View camera;
    ShadowMethod method;
    std::vector<ShadowView> views;
    std::vector<std::vector<float>> images;

    explicit Stage(ShadowMethod of, glm::dvec3 eye = glm::dvec3(0)) : method(std::move(of)) {
        camera.eye = eye;
        camera.verticalFov = 1;
        camera.aspect = 1.5;
        views = culling::viewsOf(method, light, camera, kNear, kFar, {eye - 200.0, eye + 200.0});
    }
    glm::dvec3 eyeLight() const { return light.toLight(camera.eye); }

    /// Draws what stands at `depth(x, y)` [m, light space from the eye on] into all maps.
    void draw(const std::function<double(glm::dvec2)>& depth) {
        std::vector<glm::dmat4> lightFromClip;
        for (const ShadowView& view : views) lightFromClip.push_back(glm::inverse(view.clipFromLight));
        images.assign(size_t(views.back().map) + 1, std::vector<float>(size_t(method.side * method.side)));
        for (int y = 0; y < method.side; ++y)
            for (int x = 0; x < method.side; ++x)
                for (size_t first = 0; first < views.size();) {
                    size_t end = first, v = first;
                    const glm::dvec2 at = (glm::dvec2(x, y) + 0.5) * (2.0 / method.side) - 1.0;
                    const auto inside = [&](size_t n) {
                        return std::min(glm::dot(views[n].wedge[0], {at, 1}), glm::dot(views[n].wedge[1], {at, 1}));
                    };
                    for (; end < views.size() && views[end].map == views[first].map; ++end)
                        if (inside(end) > inside(v)) v = end;
                    const glm::dvec4 back = lightFromClip[v] * glm::dvec4(at, 0, 1);
                    const glm::dvec2 onPlane = glm::dvec2(back) / back.w + glm::dvec2(views[v].origin);
                    const double z = depth(onPlane - glm::dvec2(eyeLight())) + eyeLight().z;
                    float stored = cache::kEmptyDepth;
                    if (z < kNothing) {
                        const glm::dvec4 clip =
                            views[v].clipFromLight * glm::dvec4(glm::dvec3(onPlane, z) - views[v].origin, 1);
                        stored = float(cache::kNearestDepth +
                                       (1.0 - cache::kNearestDepth) * std::clamp(clip.z / clip.w, 0.0, 1.0));
                    }
                    images[size_t(views[v].map)][size_t(y * method.side + x)] = stored;
                    first = end;
                }
    }
    /// Light at a point of light space from the eye on.
    server::Receiver at(glm::dvec3 pLight, glm::dvec3 normalLight = {0, 0, -1}, uint32_t pixel = 0) const {
        return {light.toWorld(pLight + eyeLight()), glm::vec3(light.toWorld(glm::normalize(normalLight))), pixel};
    }
    std::vector<server::ReceiverLight> shade(std::span<const server::Receiver> receivers) const {
        std::vector<std::span<const float>> spans(images.begin(), images.end());
        return server::shade(method, views, light, camera, spans, receivers);
    }
    server::ReceiverLight shade(const server::Receiver& receiver) const { return shade({&receiver, 1})[0]; }
};

/// One square map around the eye, texels of half a metre.
ShadowMethod oneSquare(Filter filter = Filter::kNone) {
    ShadowMethod method{.name = "square"};
    method.splits.count = 1;
    method.side = 408;
    method.filter = filter;
    return method;
}

/// Light along x, `texels` from a half plane of casters that ends on the border between two texels.
float besideEdge(const Stage& stage, double texels, uint32_t pixel = 0) {
    const double texel = stage.views[0].texel, border = std::round(stage.eyeLight().x / texel) * texel;
    return stage.shade(stage.at({border - stage.eyeLight().x + texels * texel, 3.3 * texel, 20}, {0, 0, -1}, pixel))
        .light;
}

Stage withEdge(Filter filter) {
    Stage stage(oneSquare(filter), {31, 7, -12});
    const double texel = stage.views[0].texel,
                 border = std::round(stage.eyeLight().x / texel) * texel - stage.eyeLight().x;
    stage.draw([=](glm::dvec2 p) { return p.x < border ? -10.0 : 20.5; });
    return stage;
}

TEST(Shading, AWallShadowsWhatIsBehindItToTheTexel) {
    for (const double far : {0.0, 1e7}) {
        Stage stage(oneSquare(), glm::dvec3(far, 30, -far));
        stage.draw([](glm::dvec2 p) { return p.x < 1.03 ? -10.0 : kNothing; });
        const double texel = stage.views[0].texel, eye = stage.eyeLight().x;
        EXPECT_NEAR(texel, 0.5, 1e-12);
        int shadowed = 0;
        for (double x = -5; x < 5; x += 0.0031) {
            const double centre = (std::floor((x + eye) / texel) + 0.5) * texel - eye;
            if (std::abs(centre - 1.03) < 1e-6 || std::abs(x + eye - std::round((x + eye) / texel) * texel) < 1e-6)
                continue;
            const server::ReceiverLight behind = stage.shade(stage.at({x, 2, 15}));
            ASSERT_EQ(behind.light, centre < 1.03 ? 0 : 1) << x;
            EXPECT_EQ(behind.view, 0);
            EXPECT_NEAR(behind.texel, texel, 1e-7);
            EXPECT_FALSE(behind.tapLeft);
            EXPECT_EQ(stage.shade(stage.at({x, 2, -15})).light, 1) << "before the wall";
            shadowed += behind.light == 0;
        }
        EXPECT_GT(shadowed, 1500);
    }
}

TEST(Shading, BoxesWeighTexelsAsTheyPromise) {
    const Stage none = withEdge(Filter::kNone), box2 = withEdge(Filter::kBox2), box3 = withEdge(Filter::kBox3);
    for (double t = -3.015; t < 3; t += 0.03) {
        EXPECT_EQ(besideEdge(none, t), t < 0 ? 0 : 1) << t;
        EXPECT_NEAR(besideEdge(box2, t), std::clamp(t + 0.5, 0.0, 1.0), 1e-6) << t;
        // Columns of three texels each.
        EXPECT_NEAR(besideEdge(box3, t), std::clamp((std::floor(t) + 2) / 3, 0.0, 1.0), 1e-6) << t;
    }
}

TEST(Shading, DisksAreDisks) {
    const Stage still = withEdge(Filter::kPoisson), poisson = withEdge(Filter::kPoissonRotated),
                disk = withEdge(Filter::kDiskRotated);
    // The mean of 4,000 answers, of which each tap is a coin: off by less than 4 * 0.5 / sqrt(4000) = 0.032.
    const int pixels = 4000;
    for (const double t : {-1.6, -1.2, -0.6, -0.2, 0.0, 0.3, 0.9, 1.3, 1.6}) {
        double meanPoisson = 0, meanDisk = 0, turned = 0;
        for (uint32_t pixel = 0; pixel < pixels; ++pixel) {
            const float one = besideEdge(poisson, t, pixel), other = besideEdge(disk, t, pixel);
            ASSERT_NEAR(one * 8, std::round(one * 8), 1e-6);
            ASSERT_NEAR(other * 4, std::round(other * 4), 1e-6);
            meanPoisson += double(one) / pixels;
            meanDisk += double(other) / pixels;
            ASSERT_EQ(besideEdge(still, t, pixel), besideEdge(still, t, 0));
            turned += one != besideEdge(still, t, 0);
        }
        // A tap at radius r is lit over the share of angles that keeps it right of the edge.
        double expected = 0;
        for (int i = 0; i < 4; ++i) {
            const double r = server::kDiskRadius * std::sqrt((i + 0.5) / 4);
            expected += (1 - std::acos(std::clamp(t / r, -1.0, 1.0)) / std::numbers::pi) / 4;
        }
        EXPECT_NEAR(meanDisk, expected, 0.032) << t;
        EXPECT_NEAR(besideEdge(still, t), meanPoisson, 0.3) << t;
        if (std::abs(t) > server::kDiskRadius) {
            EXPECT_NEAR(meanPoisson, t > 0 ? 1 : 0, 1e-9);
        } else {
            EXPECT_GT(turned, 0) << t;
        }
    }
    // Seven taps lie near the rim, at 0.92 radii, and one in the middle: half a radius from the edge that is 0.72.
    double half = 0;
    for (uint32_t pixel = 0; pixel < pixels; ++pixel)
        half += double(besideEdge(poisson, server::kDiskRadius / 2, pixel)) / pixels;
    EXPECT_NEAR(half, 0.72, 0.032);
}

/// Lit wherever the first map is asked, shadowed by every other.
void drawOnlyInLaterMaps(Stage& stage) {
    stage.draw([](glm::dvec2) { return -90.0; });
    std::ranges::fill(stage.images[0], cache::kEmptyDepth);
}

TEST(Shading, SlicesBlendWithoutAStep) {
    for (const auto selection : {culling::Selection::kInterval, culling::Selection::kMap}) {
        ShadowMethod method{.name = "blended"};
        method.splits.count = 2;
        method.side = 256;
        method.selection = selection;
        method.blend = 0.25;
        Stage stage(method);
        drawOnlyInLaterMaps(stage);
        const glm::dvec3 forward = selection == culling::Selection::kMap
                                       ? glm::dvec3(1, 0, 0)
                                       : stage.light.toLight(stage.camera.orientation * glm::dvec3(0, 0, -1));
        float before = 1, most = 0;
        for (double away = 1; away < 50; away += 0.01) {
            const server::ReceiverLight answer = stage.shade(stage.at(forward * away));
            EXPECT_LE(answer.light, before + 1e-6);
            most = std::max(most, before - answer.light);
            before = answer.light;
            const double end = stage.views[0].end;
            if (selection == culling::Selection::kInterval && away < end) {
                EXPECT_NEAR(answer.light, std::min(1.0, (end - away) / (0.25 * (end - kNear))), 1e-3) << away;
            }
            // A texel is 0.27 m: the ramp over a quarter of the map hardly changes in a centimetre.
            if (away < 0.7 * end) {
                EXPECT_EQ(answer.light, 1) << away;
            }
        }
        EXPECT_EQ(before, 0);
        EXPECT_LT(most, 0.01);

        stage.method.blend = 0;
        EXPECT_EQ(stage.shade(stage.at(forward * (stage.views[0].end - 1))).light, 1) << "a step, without blending";
        EXPECT_EQ(stage.shade(stage.at(forward * (stage.views[0].end + 3))).light, 0);
    }
}

TEST(Shading, ShadowsFadeToLight) {
    ShadowMethod method = oneSquare();
    method.fade = 0.25;
    Stage stage(method);
    stage.draw([](glm::dvec2) { return -90.0; });
    for (double away = 1; away < 120; away += 0.7) {
        const float light = stage.shade(stage.at({away, 0, 0})).light;
        EXPECT_NEAR(light, std::clamp((away - 75) / 25, 0.0, 1.0), 1e-5) << away;
    }
}

TEST(Shading, WhatIsUnknownIsAskedOfTheNextMap) {
    ShadowMethod method{.name = "two"};
    method.splits.count = 2;
    method.side = 256;
    method.filter = Filter::kBox3;
    Stage stage(method);
    stage.draw([](glm::dvec2) { return kNothing; });
    const server::Receiver near = stage.at({0.01, 0.01, 0}), beyond = stage.at({60, 0, 0}),
                           outside = stage.at({130, 0, 0});
    EXPECT_EQ(stage.shade(near).view, 0);
    EXPECT_EQ(stage.shade(beyond).view, 1);
    EXPECT_EQ(stage.shade(outside).view, -1);
    EXPECT_EQ(stage.shade(outside).light, 1);
    // One texel of the nine that the filter reads is enough.
    const double texel = stage.views[0].texel;
    const glm::dvec2 slot =
        glm::floor((glm::dvec2(0.01 + texel, 0.01) + glm::dvec2(stage.eyeLight() - stage.views[0].origin)) / texel);
    stage.images[0][size_t(slot.y) * 256 + size_t(slot.x)] = cache::kUnknownDepth;
    EXPECT_EQ(stage.shade(near).view, 1);
    EXPECT_EQ(stage.shade(stage.at({0.01 - 2 * texel, 0.01, 0})).view, 0);
    // Below all that the maps tell apart nobody answers.
    EXPECT_EQ(stage.shade(stage.at({0, 0, 1000})).view, -1);
}

TEST(Shading, ATapThatLeavesItsMapIsTold) {
    ShadowMethod method = oneSquare(Filter::kBox3);
    method.selection = culling::Selection::kInterval;
    Stage stage(method);
    stage.draw([](glm::dvec2) { return -90.0; });
    const double rim = stage.views[0].high.x - stage.eyeLight().x;
    const server::ReceiverLight inside = stage.shade(stage.at({rim - 1.5 * stage.views[0].texel, 0, 0}));
    EXPECT_FALSE(inside.tapLeft);
    EXPECT_EQ(inside.light, 0);
    const server::ReceiverLight onRim = stage.shade(stage.at({rim - 0.5 * stage.views[0].texel, 0, 0}));
    EXPECT_TRUE(onRim.tapLeft);
    EXPECT_NEAR(onRim.light, 1.0 / 3, 1e-6) << "what lies beside a map counts as lit";
    // Where the finest map that holds the filter answers, none does here.
    stage.method.selection = culling::Selection::kMap;
    EXPECT_EQ(stage.shade(stage.at({rim - 0.5 * stage.views[0].texel, 0, 0})).view, -1);
    EXPECT_EQ(stage.shade(stage.at({rim - 1.5 * stage.views[0].texel, 0, 0})).view, 0);
}

TEST(Shading, IntervalsAreCountedAlongTheView) {
    ShadowMethod method{.name = "interval"};
    method.splits.count = 2;
    method.side = 256;
    method.selection = culling::Selection::kInterval;
    Stage stage(method);
    stage.draw([](glm::dvec2) { return kNothing; });
    const double end = stage.views[0].end;
    const auto ahead = [&](double depth, double aside) {
        return server::Receiver{stage.camera.eye + glm::dvec3(aside, 0, -depth), {0, 1, 0}, 0};
    };
    EXPECT_EQ(stage.shade(ahead(end - 0.01, 0)).view, 0);
    EXPECT_EQ(stage.shade(ahead(end + 0.01, 0)).view, 1);
    EXPECT_EQ(stage.shade(ahead(end - 0.01, 1.2 * end)).view, 1) << "beside the first map, the next one answers";
    EXPECT_EQ(stage.shade(ahead(kFar + 0.01, 0)).view, -1);
    stage.method.selection = culling::Selection::kMap;
    EXPECT_EQ(stage.shade(ahead(end + 0.01, 0)).view, 0) << "its margin holds the point";
}

/// The least and the most depth under a surface, in texels, at which receivers are lit and shadowed.
struct Limits {
    double lit = 0, shadowed = 1e9;
};

Limits limitsUnder(const Stage& stage, glm::dvec2 slope, std::function<glm::dvec2(int)> place) {
    const double texel = stage.views[0].texel;
    Limits limits;
    for (int n = 0; n < 400; ++n) {
        const glm::dvec2 p = place(n);
        for (double under = 0.02; under < 12; under += 0.1) {
            const double z = glm::dot(slope, p) + 5 + under * texel;
            const float light = stage.shade(stage.at({p, z}, {slope, -1})).light;
            if (light == 1) {
                limits.lit = std::max(limits.lit, under);
            } else {
                limits.shadowed = std::min(limits.shadowed, under);
            }
        }
    }
    return limits;
}

TEST(Shading, BiasesAreInTexels) {
    const glm::dvec2 slope(1.5, 0.4);  // of the surface: metres along the light per metre across
    const auto staged = [&](culling::ShadowBias bias) {
        ShadowMethod method = oneSquare();
        method.bias = bias;
        Stage stage(method);
        stage.draw([=](glm::dvec2 p) { return glm::dot(slope, p) + 5; });
        return stage;
    };
    std::mt19937 rng(8);
    std::uniform_real_distribution<double> unit(-20, 20);
    const auto anywhere = [&](int) { return glm::dvec2(unit(rng), unit(rng)); };
    const double texel = staged({}).views[0].texel;
    const auto middles = [&](const Stage& stage) {
        return [&](int) {
            const glm::dvec2 eye(stage.eyeLight());
            return (glm::floor(glm::dvec2(unit(rng), unit(rng)) / texel) + 0.5) * texel +
                   glm::ceil(eye / texel) * texel - eye;
        };
    };
    // In the middle of a texel the drawn surface is the point's own, and the bias is all there is.
    for (const auto& [bias, texels] : {std::pair{culling::ShadowBias{.receiver = 1.5}, 1.5},
                                       {culling::ShadowBias{.gradient = 2}, 2 * 1.9},  // both axes
                                       {culling::ShadowBias{.gradient = 4, .gradientMost = 3}, 3.0},
                                       {culling::ShadowBias{.receiver = 1, .gradient = 1}, 2.9}}) {
        const Stage stage = staged(bias);
        const Limits limits = limitsUnder(stage, slope, middles(stage));
        EXPECT_NEAR(limits.lit, texels, 0.11) << "steps of a tenth";
        EXPECT_NEAR(limits.shadowed, texels, 0.11);
    }
    // Anywhere else the drawn surface is off by half a texel along both axes: 0.95 texels here.
    const Limits spread = limitsUnder(staged({.receiver = 1.5}), slope, anywhere);
    EXPECT_NEAR(spread.lit, 1.5 + 0.95, 0.15);
    EXPECT_NEAR(spread.shadowed, 1.5 - 0.95, 0.15);
    // Along the normal by n texels times the sine of its angle to the sun: n times the slope, along the light.
    const Limits offset = limitsUnder(staged({.normalOffset = 3}), slope, anywhere);
    EXPECT_NEAR(offset.lit, 3 * glm::length(slope) + 0.95, 0.15);
    EXPECT_NEAR(offset.shadowed, 3 * glm::length(slope) - 0.95, 0.15);
    // By its own plane at each texel's middle, the surface is where it is drawn, anywhere.
    const Limits plane = limitsUnder(staged({.receiver = 1.5, .plane = true}), slope, anywhere);
    EXPECT_NEAR(plane.lit, 1.5, 0.11) << "steps of a tenth";
    EXPECT_NEAR(plane.shadowed, 1.5, 0.11);
    // What acts on drawing changes nothing here.
    const Limits drawn = limitsUnder(staged({.constant = 5, .slope = 5}), slope, anywhere);
    EXPECT_LT(drawn.lit, 1);
}

// The same texels mean the same on both sides of a border, for whichever facet they are read.
TEST(Shading, FacetsHaveNoSeams) {
    std::mt19937 rng(12);
    std::uniform_real_distribution<double> unit(-1, 1);
    for (const int count : {4, 5, 8}) {
        ShadowMethod method = culling::methodNamed("facetted-" + std::to_string(count)).value();
        method.side = 512;
        Stage stage(method);
        const glm::dvec2 slope(0.3, -0.2);
        const auto ground = [=](glm::dvec2 p) { return glm::dot(slope, p) + 5; };
        stage.draw([=](glm::dvec2 p) { return std::sin((p.x - p.y * 0.3) * 2) > 0.3 ? -40.0 : ground(p); });
        int partly = 0;
        for (int n = 0; n < 3000; ++n) {
            const double border = 2 * std::numbers::pi * (n % count + 0.5) / count,
                         away = 1 + 60 * std::abs(unit(rng));
            const glm::dvec2 p = glm::dvec2(std::cos(border), std::sin(border)) * away;
            // A nanometre to either side of the border the same texels say the same.
            const glm::dvec2 aside = glm::dvec2(-std::sin(border), std::cos(border)) * 1e-9;
            const auto at = [&](glm::dvec2 q) { return stage.at({q, ground(q)}, {slope, -1}, uint32_t(n)); };
            const server::ReceiverLight left = stage.shade(at(p + aside)), right = stage.shade(at(p - aside));
            EXPECT_NE(left.view, right.view);
            EXPECT_NEAR(left.light, right.light, 1e-6) << count << " facets, " << n;
            partly += left.light > 0 && left.light < 1;
        }
        EXPECT_GT(partly, 300) << "edges of shadows cross the borders";
        // The ground does not shade itself, on borders or elsewhere.
        stage.draw(ground);
        for (int n = 0; n < 3000; ++n) {
            const double angle = 2 * std::numbers::pi * (n % count + 0.5) / count + 0.03 * unit(rng);
            const glm::dvec2 p = glm::dvec2(std::cos(angle), std::sin(angle)) * (1 + 90 * std::abs(unit(rng)));
            ASSERT_EQ(stage.shade(stage.at({p, ground(p)}, {slope, -1}, uint32_t(n))).light, 1)
                << count << " facets at " << p.x << ", " << p.y;
        }
    }
}

TEST(Shading, APointThatIsMovedIntoAnotherFacetAsksThatOne) {
    ShadowMethod method = culling::methodNamed("facetted-4").value();
    method.side = 512;
    method.bias = {};
    method.filter = Filter::kNone;
    Stage stage(method);
    stage.draw([](glm::dvec2 p) { return std::sin((p.x - p.y * 0.3) * 0.7) > 0.3 ? -60.0 : kNothing; });
    const glm::dvec3 normal = glm::normalize(glm::dvec3(-1, 1, -1));  // on, and away from the first facet
    int crossed = 0, shadowed = 0;
    for (int n = 0; n < 500; ++n) {
        const glm::dvec3 p(20 + 0.1 * n, 19 + 0.1 * n, 0);
        stage.method.bias.normalOffset = 6;
        const server::ReceiverLight moved = stage.shade(stage.at(p, normal));
        stage.method.bias.normalOffset = 0;
        const double offset = 6 * double(moved.texel) * std::sqrt(2.0 / 3);
        const server::ReceiverLight there = stage.shade(stage.at(p + normal * offset));
        ASSERT_EQ(moved.view, there.view);
        ASSERT_EQ(moved.light, there.light) << n;
        EXPECT_EQ(stage.shade(stage.at(p)).view, 0);
        crossed += moved.view == 1;
        shadowed += moved.light == 0;
    }
    EXPECT_GT(crossed, 300);
    EXPECT_GT(shadowed, 100);
}

// The map has corners beside an octagon, in which the warp would find room for all the world beyond it.
TEST(Shading, FacetsEndWhereTheyPromise) {
    ShadowMethod method = culling::methodNamed("facetted-8").value();
    method.side = 512;
    Stage stage(method);
    stage.draw([](glm::dvec2) { return -60.0; });
    const double edge = stage.views[0].high.x - stage.eyeLight().x;
    EXPECT_EQ(stage.shade(stage.at(glm::dvec3(1, 1, 0) * (0.99 * edge / std::numbers::sqrt2))).view, 1);
    EXPECT_EQ(stage.shade(stage.at(glm::dvec3(1, 1, 0) * (1.5 * edge / std::numbers::sqrt2))).view, -1);
}

TEST(Shading, WarpedTexelsAreMeasuredWhereTheyAre) {
    Stage stage(culling::methodNamed("lispsm").value());
    stage.draw([](glm::dvec2) { return kNothing; });
    const auto ahead = [&](double depth) {
        return stage.shade({stage.camera.eye + glm::dvec3(0, 0, -depth), {0, 1, 0}, 0});
    };
    EXPECT_GT(ahead(90).texel, 20 * ahead(1).texel);
    EXPECT_GE(ahead(1).texel, stage.views[0].texel);
    const glm::dvec2 p = glm::dvec2(stage.light.toLight(glm::dvec3(0, 0, -30)));
    const glm::dmat2 edges =
        culling::texelEdges(stage.views[0], stage.method.side, p - glm::dvec2(stage.views[0].origin));
    EXPECT_NEAR(ahead(30).texel, std::max(glm::length(edges[0]), glm::length(edges[1])), 1e-6);
}

TEST(Shading, AnswersDoNotDependOnThreads) {
    Stage stage(culling::methodNamed("practical").value());
    stage.draw([](glm::dvec2 p) { return std::sin(p.x) * std::cos(p.y * 1.3) > 0.4 ? -20.0 : 6.0; });
    std::mt19937 rng(5);
    std::uniform_real_distribution<double> unit(-90, 90);
    std::vector<server::Receiver> receivers;
    for (uint32_t n = 0; n < 20000; ++n) receivers.push_back(stage.at({unit(rng), unit(rng), 6}, {0.2, 0.1, -1}, n));
    std::vector<std::vector<server::ReceiverLight>> runs;
    for (const size_t threads : {1, 2, 7}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        runs.push_back(stage.shade(receivers));
    }
    int lit = 0, views = 0;
    for (size_t i = 0; i < receivers.size(); ++i) {
        for (size_t run = 1; run < runs.size(); ++run) {
            ASSERT_EQ(std::memcmp(&runs[0][i].light, &runs[run][i].light, sizeof(float)), 0);
            ASSERT_EQ(runs[0][i].view, runs[run][i].view);
        }
        lit += runs[0][i].light == 1;
        views |= 1 << runs[0][i].view;
    }
    EXPECT_GT(lit, 5000);
    EXPECT_LT(lit, 15000);
    EXPECT_GE(views, 0b1111) << "all maps had a say";
}

}  // namespace
