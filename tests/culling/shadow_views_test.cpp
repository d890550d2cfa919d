// Views: whatever a method promises to hold is on its maps, wherever the eye is and however it looks.
#include "culling/shadow_views.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <numbers>
#include <random>

#include "cache/lattice.h"
#include "culling/cascades.h"

namespace {

using culling::Fit;

constexpr double kNear = 0.2, kFar = 300;

double degrees(double angle) { return angle * 180 / std::numbers::pi; }

/// Random suns and cameras; the scene is a slab around the eye, up to 1e7 m from the origin.
struct Situations {
    std::mt19937 rng{2024};
    std::uniform_real_distribution<double> unit{-1, 1};
    culling::LightSpace light;
    culling::View camera;
    world::Box scene;

    glm::dvec3 vector() { return {unit(rng), unit(rng), unit(rng)}; }
    void turn() { camera.orientation = glm::normalize(glm::dquat(unit(rng), unit(rng), unit(rng), unit(rng))); }
    void next(int step) {
        const double elevation = 0.02 + 0.77 * (1 + unit(rng)), azimuth = unit(rng) * 3.1;
        light = culling::makeLightSpace(culling::sunFromAngles(azimuth, elevation)).value();
        camera.eye = vector() * std::pow(10.0, step % 8);
        camera.verticalFov = 0.9 + 0.6 * unit(rng);
        camera.aspect = 1.3 + 0.6 * unit(rng);
        turn();
        scene = {camera.eye - glm::dvec3(900, 70, 900), camera.eye + glm::dvec3(900, 50, 900)};
    }
    double tangent() const { return std::tan(camera.verticalFov / 2); }
    /// A point of the view at `depth` along it.
    glm::dvec3 seen(double depth) {
        return camera.eye +
               camera.orientation *
                   (glm::dvec3(unit(rng) * tangent() * camera.aspect, unit(rng) * tangent(), -1) * depth);
    }
};

glm::dvec3 onMap(const culling::ShadowView& view, const culling::LightSpace& light, glm::dvec3 pWorld) {
    const glm::dvec4 clip = view.clipFromLight * glm::dvec4(light.toLight(pWorld) - view.origin, 1);
    return glm::dvec3(clip) / clip.w;
}

/// Half an edge of what a view must hold, without the margin for snap and filter [m].
double halfOf(const culling::ShadowView& view, int side) { return view.texel * (side / 2 - culling::kWindowMargin); }

bool sameBits(double a, double b) { return std::memcmp(&a, &b, sizeof a) == 0; }

culling::ShadowMethod fitted(Fit fit) {
    culling::ShadowMethod method{.name = "fitted"};
    method.fit = fit;
    method.snapped = fit != Fit::kSliceBox;
    return method;
}

TEST(Splits, FollowTheirFormulas) {
    const auto byRatio = culling::splitsOf({.count = 4, .ratio = 3}, 0.1, 270);
    ASSERT_EQ(byRatio.size(), 4u);
    for (const auto& [i, end] : {std::pair{0u, 10.0}, {1u, 30.0}, {2u, 90.0}, {3u, 270.0}})
        EXPECT_NEAR(byRatio[i], end, 1e-12 * end);
    // Between 1 and 16: even 4.75, 8.5, 12.25; logarithmic 2, 4, 8.
    for (const double blend : {0.0, 0.25, 0.5, 1.0}) {
        const auto blended = culling::splitsOf({.count = 4, .ratio = 0, .blend = blend}, 1, 16);
        const double even[] = {4.75, 8.5, 12.25, 16}, logarithmic[] = {2, 4, 8, 16};
        for (size_t i = 0; i < 4; ++i) EXPECT_NEAR(blended[i], blend * logarithmic[i] + (1 - blend) * even[i], 1e-12);
        EXPECT_EQ(blended.back(), 16);
    }
    EXPECT_EQ(culling::splitsOf({.count = 1}, 0.1, 33.3), std::vector{33.3});
    for (const double end : culling::splitsOf({.count = 8, .ratio = 16}, 0.5, 300)) EXPECT_GE(end, 0.5);
}

TEST(ShadowViews, HoldAllThatTheirSliceHas) {
    Situations s;
    for (const Fit fit : {Fit::kSliceBox, Fit::kEyeBox, Fit::kSliceSphere, Fit::kSplitSphere, Fit::kSliceDiameter,
                          Fit::kPushedSphere, Fit::kFacets, Fit::kWarped}) {
        for (int step = 0; step < 240; ++step) {
            s.next(step);
            culling::ShadowMethod method = fitted(fit);
            const bool warped = fit == Fit::kFacets || fit == Fit::kWarped;
            if (warped) method.snapped = false, method.splits.count = 1;
            if (step % 2) method.splits.ratio = 0, method.splits.blend = 0.5;
            if (method.snapped && step % 3 == 0) method.guardBand = 4;
            if (step % 5 == 0 && fit != Fit::kEyeBox && !warped) method.blend = 0.2;
            if (!warped)
                method.depth = std::array{culling::DepthFit::kScene, culling::DepthFit::kClipped,
                                          culling::DepthFit::kMoving}[size_t(step / 2 % 3)];
            if (fit == Fit::kFacets) method.facets = std::array{4, 5, 8}[size_t(step % 3)];
            ASSERT_TRUE(culling::requireMethod(method));
            const auto views = culling::viewsOf(method, s.light, s.camera, kNear, kFar, s.scene);
            double previous = 0;
            for (size_t i = 0; i < views.size(); ++i) {
                const culling::ShadowView& view = views[i];
                // Filters have three texels; where depths are warped the rim of the map is left to those that have
                // to.
                const double inner = fit == Fit::kWarped ? 1 + 1e-9 : 1 - 6.0 / method.side;
                // Doubles at 1e7 m are 2e-9 m apart; half a dozen roundings, in units of the smallest map.
                const double slack = 1e-6;
                const double from = i == 0 ? view.begin : view.begin - method.blend * (view.begin - previous);
                int held = 0;
                for (int n = 0; n < 40; ++n) {
                    const double depth =
                        n < 8 ? (n < 4 ? from : view.end) : from + (view.end - from) * (0.5 + 0.5 * s.unit(s.rng));
                    glm::dvec3 p = s.seen(depth);
                    if (fit == Fit::kEyeBox || fit == Fit::kFacets)
                        p = s.camera.eye +
                            glm::normalize(s.vector()) * view.end * (n < 8 ? 1 : std::abs(s.unit(s.rng)));
                    if (fit == Fit::kSplitSphere) {
                        const double d = view.end - from;
                        p = s.camera.eye + s.camera.orientation * glm::dvec3(0, 0, -(from + d / 2)) +
                            glm::normalize(s.vector()) * d * (n < 8 ? std::sqrt(0.5) : 0.7 * s.unit(s.rng));
                    }
                    const glm::dvec3 at = onMap(view, s.light, p);
                    if (fit == Fit::kFacets) {
                        const glm::dvec3 clip(at.x, at.y, 1);
                        if (glm::dot(view.wedge[0], clip) < 0 || glm::dot(view.wedge[1], clip) < 0) continue;
                        const glm::dvec4 c = view.clipFromLight * glm::dvec4(s.light.toLight(p) - view.origin, 1);
                        if (c.w <= 0) continue;  // behind this facet: the wedge is meant in front
                    }
                    ++held;
                    ASSERT_LE(std::max(std::abs(at.x), std::abs(at.y)), inner + slack)
                        << "fit " << int(fit) << ", step " << step << ", view " << i;
                    const glm::dvec2 q(s.light.toLight(p));
                    ASSERT_TRUE(glm::all(glm::lessThanEqual(view.low, q + slack)) &&
                                glm::all(glm::lessThanEqual(q, view.high + slack)))
                        << "fit " << int(fit) << ", step " << step << ", view " << i;
                    const bool inScene =
                        glm::all(glm::lessThan(s.scene.min, p)) && glm::all(glm::lessThan(p, s.scene.max));
                    if (inScene) {
                        ASSERT_TRUE(at.z >= 0 && at.z <= 1)
                            << "fit " << int(fit) << ", step " << step << ": " << at.z;
                    }
                }
                EXPECT_TRUE(fit == Fit::kFacets || held == 40);
                previous = view.begin;
            }
            if (fit != Fit::kFacets) {
                ASSERT_EQ(views.size(), size_t(method.splits.count));
                EXPECT_NEAR(views.back().end, kFar, 1e-9 * kFar);
            }
        }
    }
}

TEST(ShadowViews, NeverBendARayOfLight) {
    Situations s;
    s.next(5);
    for (const culling::ShadowMethod& method : culling::namedMethods()) {
        for (const culling::ShadowView& view : culling::viewsOf(method, s.light, s.camera, kNear, kFar, s.scene)) {
            for (const int row : {0, 1, 3}) EXPECT_EQ(view.clipFromLight[2][row], 0) << method.name;
            // The texel it names is the finest, and depths span what it says.
            EXPECT_NEAR(view.clipFromLight[2][2] * view.depthRange, 1, 1e-12) << method.name;
            const glm::dvec2 middle = (view.low + view.high) * 0.5;
            const glm::dmat2 edges = culling::texelEdges(view, method.side, middle - glm::dvec2(view.origin));
            EXPECT_GE(std::max(glm::length(edges[0]), glm::length(edges[1])), view.texel * (1 - 1e-9)) << method.name;
        }
    }
}

TEST(ShadowViews, TexelEdgesAreWhatAStepOnTheMapIs) {
    Situations s;
    for (int step = 0; step < 60; ++step) {
        s.next(step);
        for (const char* name : {"engel", "gnomon", "facetted-5", "lispsm"}) {
            const culling::ShadowMethod method = culling::methodNamed(name).value();
            for (const culling::ShadowView& view :
                 culling::viewsOf(method, s.light, s.camera, kNear, kFar, s.scene)) {
                const glm::dvec2 p = glm::mix(view.low, view.high, glm::dvec2(0.5) + 0.3 * glm::dvec2(s.vector())) -
                                     glm::dvec2(view.origin);
                const auto place = [&](glm::dvec2 at) {
                    const glm::dvec4 clip = view.clipFromLight * glm::dvec4(at, 0, 1);
                    return glm::dvec2(clip) / clip.w * (method.side / 2.0);  // [texels]
                };
                if ((view.clipFromLight * glm::dvec4(p, 0, 1)).w < 0.01) continue;  // behind a facet
                const glm::dmat2 edges = culling::texelEdges(view, method.side, p);
                // A thousandth of a texel, both ways, since the map is curved: that leaves its square, 1e-6.
                for (int axis = 0; axis < 2; ++axis) {
                    const glm::dvec2 moved = (place(p + edges[axis] * 5e-4) - place(p - edges[axis] * 5e-4)) * 1e3;
                    EXPECT_NEAR(moved[axis], 1, 1e-4) << name;
                    EXPECT_NEAR(moved[1 - axis], 0, 1e-4) << name;
                }
            }
        }
    }
}

TEST(ShadowViews, SnappedMapsStayOnTheLatticeBitForBit) {
    Situations s;
    for (const char* name : {"doughnut", "practical", "valient", "pushed-spheres", "scroll", "gnomon"}) {
        const culling::ShadowMethod method = culling::methodNamed(name).value();
        for (const int place : {0, 4, 7}) {
            s.next(place);
            const auto first = culling::viewsOf(method, s.light, s.camera, kNear, kFar, s.scene);
            int moved = 0;
            for (int step = 0; step < 50; ++step) {
                s.camera.eye += s.vector() * 0.7;
                s.turn();
                const auto views = culling::viewsOf(method, s.light, s.camera, kNear, kFar, s.scene);
                ASSERT_EQ(views.size(), first.size());
                for (size_t i = 0; i < views.size(); ++i) {
                    if (views[i].statics) continue;
                    ASSERT_TRUE(sameBits(views[i].texel, first[i].texel)) << name;
                    for (int axis = 0; axis < 2; ++axis) {
                        const double index = std::round(views[i].origin[axis] / views[i].texel);
                        ASSERT_TRUE(sameBits(index * views[i].texel, views[i].origin[axis])) << name;
                        ASSERT_EQ(std::fmod(index, method.guardBand), 0) << name;
                        // A texel is one over side of the map, to the rounding of its far corner.
                        ASSERT_NEAR(views[i].clipFromLight[axis][axis] * views[i].texel * method.side, 2, 1e-6);
                    }
                    moved += views[i].origin.x != first[i].origin.x;
                }
            }
            EXPECT_GT(moved, 50) << name;
        }
    }
}

TEST(ShadowViews, AroundTheEyeAreTheWindowsOfTheCache) {
    Situations s;
    s.next(3);
    const culling::ShadowMethod method = culling::methodNamed("gnomon").value();
    const auto views = culling::viewsOf(method, s.light, s.camera, kNear, kFar, s.scene);
    const auto cascades =
        culling::makeCascades(method.splits.count, method.side, kFar, method.splits.ratio, method.guardBand);
    for (size_t c = 0; c < views.size(); ++c) {
        EXPECT_TRUE(sameBits(views[c].texel, cascades.value()[c].texel));
        const cache::Lattice lattice{views[c].texel, method.side, method.guardBand};
        const cache::Texel low = lattice.windowAt(glm::dvec2(s.light.toLight(s.camera.eye)));
        EXPECT_EQ(glm::dvec2(views[c].origin), glm::dvec2(low) * lattice.texel);
        EXPECT_EQ(views[c].low, glm::dvec2(low) * lattice.texel);
    }
}

TEST(ShadowViews, OnlyBoxesAroundSlicesChangeTheirSizeOnTurning) {
    Situations s;
    for (const Fit fit : {Fit::kSliceBox, Fit::kEyeBox, Fit::kSliceSphere, Fit::kSplitSphere, Fit::kSliceDiameter,
                          Fit::kPushedSphere}) {
        s.next(2);
        const culling::ShadowMethod method = fitted(fit);
        const auto first = culling::viewsOf(method, s.light, s.camera, kNear, kFar, s.scene);
        int changed = 0;
        for (int step = 0; step < 100; ++step) {
            s.turn();
            const auto views = culling::viewsOf(method, s.light, s.camera, kNear, kFar, s.scene);
            for (size_t i = 0; i < views.size(); ++i) {
                changed += !sameBits(views[i].texel, first[i].texel);
                // Where windows follow the eye alone, a turn moves nothing.
                if (fit == Fit::kEyeBox) {
                    EXPECT_EQ(views[i].origin, first[i].origin);
                }
            }
        }
        if (fit == Fit::kSliceBox) {
            EXPECT_EQ(changed, 400);
        } else {
            EXPECT_EQ(changed, 0) << int(fit);
        }
    }
}

TEST(ShadowViews, ClippedDepthsAreTightAndMissNothing) {
    Situations s;
    int shorter = 0;
    for (int step = 0; step < 60; ++step) {
        s.next(step);
        culling::ShadowMethod method = fitted(Fit::kEyeBox);
        const auto whole = culling::viewsOf(method, s.light, s.camera, kNear, kFar, s.scene);
        method.depth = culling::DepthFit::kClipped;
        const auto views = culling::viewsOf(method, s.light, s.camera, kNear, kFar, s.scene);
        for (size_t i = 0; i < views.size(); ++i) {
            // Rays through the map, against the slab of the scene: the deepest and the nearest point of each.
            double nearest = 1, deepest = 0;
            for (int x = 0; x <= 40; ++x) {
                for (int y = 0; y <= 40; ++y) {
                    const glm::dvec2 at = glm::mix(views[i].low, views[i].high, glm::dvec2(x, y) / 40.0);
                    const glm::dvec3 from = s.light.toWorld({at, views[i].origin.z});
                    double in = -1e30, out = 1e30;
                    for (int axis = 0; axis < 3; ++axis) {
                        const double a = (s.scene.min[axis] - from[axis]) / s.light.sun[axis];
                        const double b = (s.scene.max[axis] - from[axis]) / s.light.sun[axis];
                        in = std::max(in, std::min(a, b));
                        out = std::min(out, std::max(a, b));
                    }
                    if (in > out) continue;
                    nearest = std::min(nearest, in / views[i].depthRange);
                    deepest = std::max(deepest, out / views[i].depthRange);
                }
            }
            ASSERT_GE(nearest, 0) << "step " << step;
            ASSERT_LE(deepest, 1) << "step " << step;
            // The pad is 0.1 m; an extreme on an edge of the box is missed by up to a fortieth of the map, at a
            // grazing sun far along the light.
            const double miss = (views[i].high.x - views[i].low.x) / 40 / -s.light.sun.y / std::abs(s.light.sun.y);
            ASSERT_LE((1 - deepest + nearest) * views[i].depthRange, 0.2 + 4 * miss) << "step " << step;
            shorter += views[i].depthRange < 0.7 * whole[i].depthRange;
        }
    }
    EXPECT_GT(shorter, 60);
}

TEST(ShadowViews, MovingDepthsMoveByWholeUnits) {
    Situations s;
    s.next(3);
    const culling::ShadowMethod method = culling::methodNamed("scroll").value();
    const auto first = culling::viewsOf(method, s.light, s.camera, kNear, kFar, s.scene);
    int moved = 0;
    for (int step = 0; step < 100; ++step) {
        s.camera.eye += s.vector() * 2.0;
        const auto views = culling::viewsOf(method, s.light, s.camera, kNear, kFar, s.scene);
        for (size_t i = 0; i < views.size(); ++i) {
            ASSERT_TRUE(sameBits(views[i].depthRange, first[i].depthRange));
            const double unit = views[i].depthRange / 65534;
            const double index = std::round(views[i].origin.z / unit);
            ASSERT_TRUE(sameBits(index * unit, views[i].origin.z));
            moved += views[i].origin.z != first[i].origin.z;
            // Whatever may shade a point of the slice is in the range: as far toward the sun as the scene goes.
            for (int n = 0; n < 20; ++n) {
                const glm::dvec3 p = s.seen(glm::mix(views[i].begin, views[i].end, std::abs(s.unit(s.rng))));
                if (glm::any(glm::lessThan(p, s.scene.min)) || glm::any(glm::greaterThan(p, s.scene.max))) continue;
                double out = 1e30;
                for (int axis = 0; axis < 3; ++axis)
                    out = std::min(out, ((s.light.sun[axis] > 0 ? s.scene.min : s.scene.max)[axis] - p[axis]) /
                                            -s.light.sun[axis]);
                const double caster = onMap(views[i], s.light, p - s.light.sun * out).z;
                ASSERT_TRUE(caster >= 0 && caster <= 1);
            }
        }
    }
    EXPECT_GT(moved, 300);
    // And it is no longer than that asks: one unit, and the pad.
    double longest = 1e30;
    for (int axis = 0; axis < 3; ++axis)
        longest = std::min(longest, s.scene.extent()[axis] / std::abs(s.light.sun[axis]));
    for (const culling::ShadowView& view : first)
        EXPECT_NEAR(view.depthRange, longest + 2 * halfOf(view, method.side) + 0.2, 2e-5 * view.depthRange);
}

TEST(ShadowViews, TheStaticMapHoldsTheSceneAndNeverMoves) {
    Situations s;
    s.next(6);
    const culling::ShadowMethod method = culling::methodNamed("practical").value();
    culling::ShadowView first;
    for (int step = 0; step < 5; ++step) {
        const auto views = culling::viewsOf(method, s.light, s.camera, kNear, kFar, s.scene);
        ASSERT_EQ(views.size(), 5u);
        EXPECT_TRUE(views.back().statics);
        EXPECT_EQ(views.back().map, 4);
        EXPECT_FALSE(views.front().statics);
        if (step == 0) first = views.back();
        EXPECT_EQ(views.back().clipFromLight, first.clipFromLight);
        EXPECT_EQ(views.back().origin, first.origin);
        for (int corner = 0; corner < 8; ++corner) {
            const glm::dvec3 at =
                onMap(first, s.light,
                      glm::mix(s.scene.min, s.scene.max, glm::dvec3(corner & 1, corner >> 1 & 1, corner >> 2)));
            EXPECT_TRUE(glm::all(glm::lessThan(glm::abs(glm::dvec2(at)), glm::dvec2(1))));
            EXPECT_TRUE(at.z > 0 && at.z < 1);
        }
        s.camera.eye += s.vector() * 30.0;
        s.turn();
    }
}

/// Share of its square that a slice covers when its widest section, through opposite corners of the view, lies in the
/// map's plane.
double sectionShare(const culling::View& camera, double begin, double end, double half) {
    const double t = std::tan(camera.verticalFov / 2) * std::hypot(1, camera.aspect);
    return (end * end - begin * begin) * t / (4 * half * half);
}

// A view of 90 degrees across at 16:9 is 98 degrees wide from corner to corner. The sphere of each of its slices lies
// around the far plane's middle, and the slice takes about a fifth of its square. For a view of 30 degrees it takes
// two fifths, and whatever the view, less than half: a section on which the sphere's centre lies is inside a circle,
// the largest four-sided figure there is a square, and that has half the area of the square around the circle.
TEST(ShadowViews, WideViewsWasteMostOfASphere) {
    Situations s;
    s.next(1);
    s.camera.aspect = 16.0 / 9;
    s.camera.verticalFov = 2 * std::atan(1 / s.camera.aspect);
    EXPECT_NEAR(degrees(s.camera.verticalFov), 58.7, 0.05);
    EXPECT_NEAR(degrees(2 * std::atan(std::hypot(1, 1 / s.camera.aspect))), 97.9, 0.05);
    culling::ShadowMethod method = culling::methodNamed("valient").value();
    method.snapped = false;
    const auto wide = culling::viewsOf(method, s.light, s.camera, kNear, kFar, s.scene);
    for (const culling::ShadowView& view : wide) {
        const glm::dvec3 onFarPlane =
            s.light.toLight(s.camera.eye + s.camera.orientation * glm::dvec3(0, 0, -view.end));
        EXPECT_NEAR(glm::length((view.low + view.high) * 0.5 - glm::dvec2(onFarPlane)), 0, 1e-9 * view.end);
        EXPECT_NEAR(halfOf(view, method.side), view.end * std::hypot(1, 1 / s.camera.aspect), 1e-9 * view.end);
    }
    EXPECT_NEAR(sectionShare(s.camera, wide.back().begin, wide.back().end, halfOf(wide.back(), method.side)), 0.1937,
                5e-5);

    s.camera.verticalFov = 2 * std::atan(std::tan(15 * std::numbers::pi / 180) / std::hypot(1, s.camera.aspect));
    const auto narrow = culling::viewsOf(method, s.light, s.camera, kNear, kFar, s.scene);
    EXPECT_NEAR(sectionShare(s.camera, narrow.back().begin, narrow.back().end, halfOf(narrow.back(), method.side)),
                0.3884, 5e-5);

    double best = 0;
    for (double angle = 5; angle < 150; angle += 5) {
        s.camera.verticalFov =
            2 * std::atan(std::tan(angle / 2 * std::numbers::pi / 180) / std::hypot(1, s.camera.aspect));
        for (double ratio = 1.1; ratio < 16; ratio *= 1.2) {
            method.splits.ratio = ratio;
            const auto views = culling::viewsOf(method, s.light, s.camera, 1e-7, kFar, s.scene);
            best = std::max(best, sectionShare(s.camera, views.back().begin, views.back().end,
                                               halfOf(views.back(), method.side)));
        }
    }
    EXPECT_LT(best, 0.5);
    EXPECT_GT(best, 0.49);
}

// Spheres as wide as the square around their slice's length leave its corners to the next one, which is said to hold
// them. Where the view is wide and slices are about equally long it does not: seen along the light, nothing else
// helps.
TEST(ShadowViews, SplitSpheresLeaveHolesBetweenTheFirstTwo) {
    Situations s;
    s.next(0);
    const glm::dvec3 up = s.light.toWorld({0, 1, 0});
    s.camera.orientation = glm::quat_cast(glm::dmat3(glm::cross(s.light.sun, up), up, -s.light.sun));
    s.camera.aspect = 16.0 / 9;
    s.camera.verticalFov = 2 * std::atan(1 / s.camera.aspect);
    culling::ShadowMethod method = culling::methodNamed("practical").value();
    method.splits.count = 3;
    const auto holes = [&](double blend) {
        method.splits.blend = blend;
        const auto views = culling::viewsOf(method, s.light, s.camera, kNear, kFar, s.scene);
        int missed = 0;
        for (int n = 0; n < 20000; ++n) {
            const glm::dvec3 p = s.seen(glm::mix(views[0].begin, views[0].end, std::abs(s.unit(s.rng))));
            const auto beside = [&](const culling::ShadowView& view) {
                const glm::dvec3 at = onMap(view, s.light, p);
                return std::max(std::abs(at.x), std::abs(at.y)) > 1;
            };
            missed += beside(views[0]) && beside(views[1]);
        }
        return missed;
    };
    EXPECT_GT(holes(0.5), 20);
    EXPECT_EQ(holes(1), 0)
        << "each slice many times as long as the one before: the second sphere holds the first slice";
}

TEST(ShadowViews, PushedSpheresFollowEachOther) {
    Situations s;
    s.next(0);
    culling::ShadowMethod method = culling::methodNamed("pushed-spheres").value();
    method.snapped = false;
    method.radii = {10, 30, 90, 270};
    s.camera.aspect = 1.5;
    s.camera.verticalFov = 0.7;
    const double t = std::tan(0.35) * std::hypot(1, 1.5);
    const auto views = culling::viewsOf(method, s.light, s.camera, kNear, kFar, s.scene);
    double begin = kNear;
    for (size_t i = 0; i < 4; ++i) {
        EXPECT_NEAR(halfOf(views[i], method.side), method.radii[i], 1e-9 * method.radii[i]);
        EXPECT_DOUBLE_EQ(views[i].begin, begin);
        // Both rings, where the slice ends on the view's edges, lie on the sphere.
        const glm::dvec2 middle = (views[i].low + views[i].high) * 0.5 - glm::dvec2(s.light.toLight(s.camera.eye));
        const glm::dvec2 forward(s.light.toLight(s.camera.orientation * glm::dvec3(0, 0, -1)));
        const double centre = glm::dot(middle, forward) / glm::dot(forward, forward);
        for (const double ring : {views[i].begin, views[i].end})
            EXPECT_NEAR(std::hypot(centre - ring, ring * t), method.radii[i], 1e-6 * method.radii[i]);
        EXPECT_GT(views[i].end, begin);
        begin = views[i].end;
    }
    // A sphere that cannot hold what the one before left serves nothing, and says so.
    method.radii = {100, 100.1, 100.2, 100.3};
    const auto stuck = culling::viewsOf(method, s.light, s.camera, kNear, kFar, s.scene);
    EXPECT_LE(stuck[3].end - stuck[3].begin, 1);
    EXPECT_GE(stuck[3].end, stuck[3].begin);
}

}  // namespace
