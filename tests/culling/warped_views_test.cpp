// Warped maps: facets that meet, and a perspective that is none when the view is along the light.
#include "culling/warped_views.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

namespace {

constexpr double kFront = 0.2, kBack = 300;
/// All there is around an eye.
world::Box sceneAt(glm::dvec3 eye) { return {eye - glm::dvec3(900, 70, 900), eye + glm::dvec3(900, 50, 900)}; }

culling::LightSpace lightAt(double azimuth, double elevation) {
    return culling::makeLightSpace(culling::sunFromAngles(azimuth, elevation)).value();
}

/// Clip coordinates of a point of light space.
glm::dvec4 clip(const culling::ShadowView& view, glm::dvec3 pLight) {
    return view.clipFromLight * glm::dvec4(pLight - view.origin, 1);
}

std::vector<culling::ShadowView> facetsOf(int facets, const culling::LightSpace& light, glm::dvec3 eye) {
    culling::ShadowMethod method = culling::methodNamed("facetted-" + std::to_string(facets)).value();
    culling::View camera;
    camera.eye = eye;
    return culling::viewsOf(method, light, camera, kFront, kBack, sceneAt(camera.eye));
}

TEST(Facets, WarpTheirEdgeToTheMaps) {
    const culling::LightSpace light = lightAt(0.4, 0.8);
    const glm::dvec3 eye(3, 4, 5), eyeLight = light.toLight(eye);
    for (const int count : {4, 5, 8}) {
        const auto views = facetsOf(count, light, eye);
        ASSERT_EQ(views.size(), size_t(count));
        // The first facet's middle is light space's x, and its rectangle ends at D.
        const double edge = views[0].high.x - eyeLight.x;
        EXPECT_GT(edge, kBack);
        const double scale = count == 5 ? std::cos(std::numbers::pi / 5) : 1;  // a pentagon's corner reaches farther
        double reach = 0;
        for (int i = 0; i < count; ++i) {
            const double angle = 2 * std::numbers::pi * i / count;
            const glm::dvec2 middle(std::cos(angle), std::sin(angle));
            const auto at = [&](glm::dvec2 p) {
                const glm::dvec4 c = clip(views[size_t(i)], eyeLight + glm::dvec3(p, 0));
                return glm::dvec2(c) / c.w;
            };
            EXPECT_NEAR(glm::length(at(middle * edge) - middle * scale), 0, 1e-12);
            // The whole border of a facet, not its middle alone, falls on the polygon's edge.
            const double half = std::tan(std::numbers::pi / count);
            for (const double along : {-1.0, -0.3, 0.7, 1.0}) {
                const glm::dvec2 p = at((middle + glm::dvec2(-middle.y, middle.x) * along * half) * edge);
                EXPECT_NEAR(glm::dot(p, middle), scale, 1e-12);
                reach = std::max({reach, std::abs(p.x), std::abs(p.y)});
            }
            // A point in the middle is S / D of what it is at the edge: d / S against 1 / D.
            const double inside = glm::dot(at(middle * 1e-6), middle) / 1e-6;
            EXPECT_NEAR(inside * edge, scale * 1.05 / 0.05, 1e-3);
        }
        EXPECT_NEAR(reach, 1, 1e-12) << "the polygon touches the map's border";
    }
}

TEST(Facets, AgreeWithTheirNeighboursWhereTheyMeet) {
    std::mt19937 rng(3);
    std::uniform_real_distribution<double> unit(-1, 1);
    const culling::LightSpace light = lightAt(-2, 0.3);
    for (const double far : {0.0, 1e7}) {
        const glm::dvec3 eye = glm::dvec3(far) + glm::dvec3(1, 2, 3), eyeLight = light.toLight(eye);
        // Double precision leaves 2e-9 m at 1e7 m; a map's half edge is 17 m in the middle, S / d.
        const double slack = far > 0 ? 1e-9 : 1e-12;
        for (const int count : {4, 5, 8}) {
            const auto views = facetsOf(count, light, eye);
            for (int i = 0; i < count; ++i) {
                const double border = 2 * std::numbers::pi * (i + 0.5) / count;
                for (int n = 0; n < 20; ++n) {
                    const double away = kBack * std::abs(unit(rng));
                    const glm::dvec3 p =
                        eyeLight + glm::dvec3(std::cos(border) * away, std::sin(border) * away, 40 * unit(rng));
                    const glm::dvec4 a = clip(views[size_t(i)], p), b = clip(views[size_t((i + 1) % count)], p);
                    EXPECT_NEAR(glm::length(glm::dvec3(a) / a.w - glm::dvec3(b) / b.w), 0, slack);
                }
            }
        }
    }
}

TEST(Facets, CoverThePlaneOnce) {
    std::mt19937 rng(4);
    std::uniform_real_distribution<double> unit(-1, 1);
    const culling::LightSpace light = lightAt(1, 1);
    const glm::dvec3 eye(0), eyeLight = light.toLight(eye);
    for (const int count : {4, 5, 8}) {
        const auto views = facetsOf(count, light, eye);
        for (int n = 0; n < 5000; ++n) {
            const glm::dvec3 p = eyeLight + glm::dvec3(unit(rng), unit(rng), 0) * kBack;
            // Nearest middle: the article's own choice.
            int nearest = 0;
            double most = -1e30;
            for (int i = 0; i < count; ++i) {
                const double angle = 2 * std::numbers::pi * i / count;
                const double along = glm::dot(glm::dvec2(p - eyeLight), glm::dvec2(std::cos(angle), std::sin(angle)));
                if (along > most) most = along, nearest = i;
            }
            for (int i = 0; i < count; ++i) {
                const glm::dvec4 c = clip(views[size_t(i)], p);
                const glm::dvec3 xyw(c.x, c.y, c.w);
                const bool inside =
                    glm::dot(views[size_t(i)].wedge[0], xyw) >= 0 && glm::dot(views[size_t(i)].wedge[1], xyw) >= 0;
                ASSERT_EQ(inside, i == nearest) << count << " facets, facet " << i;
                if (inside) {
                    ASSERT_GT(c.w, 0);
                }
            }
        }
        // Neighbours share one border, bit for bit: nothing falls between them.
        for (int i = 0; i < count; ++i) {
            EXPECT_EQ(views[size_t(i)].wedge[1], -views[size_t((i + 1) % count)].wedge[0]);
            EXPECT_EQ(views[size_t(i)].map, 0);
        }
    }
}

/// A camera that looks along the light but for `angle`.
culling::View looking(const culling::LightSpace& light, double angle) {
    culling::View camera;
    camera.eye = {10, 20, 30};
    camera.verticalFov = 1;
    camera.aspect = 1.5;
    const glm::dvec3 up = light.toWorld({0, 1, 0}), right = light.toWorld({1, 0, 0});
    const glm::dvec3 forward = std::cos(angle) * light.sun + std::sin(angle) * right;
    camera.orientation = glm::quat_cast(glm::dmat3(glm::cross(forward, up), up, -forward));
    return camera;
}

TEST(Lispsm, IsThePlainMapWhenTheViewIsAlongTheLight) {
    const culling::LightSpace light = lightAt(0.7, 0.6);
    culling::ShadowMethod plain{.name = "plain"};
    plain.fit = culling::Fit::kSliceBox;
    plain.splits.count = 1;
    plain.snapped = false;
    plain.side = 8192;  // its margin of 4 texels is a thousandth
    culling::ShadowMethod warped = culling::methodNamed("lispsm").value();
    const culling::View camera = looking(light, 0);
    const auto flat = culling::viewsOf(plain, light, camera, kFront, kBack, sceneAt(camera.eye));
    const auto bent = culling::viewsOf(warped, light, camera, kFront, kBack, sceneAt(camera.eye));
    std::mt19937 rng(9);
    std::uniform_real_distribution<double> unit(-1, 1);
    for (int n = 0; n < 100; ++n) {
        const glm::dvec3 p = light.toLight(camera.eye) + glm::dvec3(unit(rng), unit(rng), unit(rng)) * 100.0;
        const glm::dvec4 a = clip(flat[0], p), b = clip(bent[0], p);
        EXPECT_NEAR(glm::length(glm::dvec3(a) / a.w - glm::dvec3(b) / b.w), 0, 2e-3) << "the margin, and no more";
    }
    EXPECT_NEAR(bent[0].texel * warped.side, flat[0].texel * plain.side, 2e-3 * flat[0].texel * plain.side);
}

TEST(Lispsm, WarpsByItsFormula) {
    const culling::LightSpace light = lightAt(0.7, 0.6);
    const culling::ShadowMethod method = culling::methodNamed("lispsm").value();
    double previous = 1;
    for (const double angle : {0.05, 0.3, 0.8, std::numbers::pi / 2}) {
        const culling::View camera = looking(light, angle);
        const auto views = culling::viewsOf(method, light, camera, kFront, kBack, sceneAt(camera.eye));
        ASSERT_EQ(views.size(), 1u);
        double first = 1e30, last = -1e30;  // along light space's x, which is where the view goes
        for (const glm::dvec3& corner : culling::cornersOf(culling::pyramidOf(light, camera), kFront, kBack)) {
            first = std::min(first, corner.x);
            last = std::max(last, corner.x);
        }
        const double n = (kFront + std::sqrt(kFront * kBack)) / std::sin(angle);
        const double y = light.toLight(camera.eye).y;
        EXPECT_NEAR(clip(views[0], {first, y, 0}).w, 1, 1e-9);
        EXPECT_NEAR(clip(views[0], {last, y, 0}).w, (n + last - first) / n, 1e-9 * last / n + 1e-9);
        EXPECT_NEAR(clip(views[0], {first, y, 0}).x, -1, 1e-9);
        const glm::dvec4 end = clip(views[0], {last, y, 0});
        EXPECT_NEAR(end.x / end.w, 1, 1e-9);
        EXPECT_GT(end.w, previous) << "the more across the light, the more warp";
        previous = end.w;
    }
}

}  // namespace
