// The named methods: all of them can work, and what cannot is refused by name.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <set>

#include "culling/shadow_views.h"

namespace {

TEST(ShadowMethods, AllThatHaveNamesCanWork) {
    std::set<std::string> names;
    for (const culling::ShadowMethod& method : culling::namedMethods()) {
        const auto fine = culling::requireMethod(method);
        EXPECT_TRUE(fine) << fine.error().what;
        EXPECT_TRUE(names.insert(method.name).second) << method.name;
        const auto found = culling::methodNamed(method.name);
        ASSERT_TRUE(found);
        EXPECT_EQ(found.value().name, method.name);
        // What is compared has as many texels as the rest.
        EXPECT_EQ(method.side * method.side * method.splits.count, 4 * 1024 * 1024) << method.name;
    }
    EXPECT_EQ(names.size(), 19u);
}

TEST(ShadowMethods, AWrongNameIsToldTheNearest) {
    for (const auto& [wrong, right] : {std::pair{"practicl", "practical"},
                                       {"faceted-5", "facetted-5"},
                                       {"", "engel"},
                                       {"Gnomon", "gnomon"},
                                       {"scroll-litera1", "scroll-literal"}}) {
        const auto found = culling::methodNamed(wrong);
        ASSERT_FALSE(found);
        EXPECT_EQ(found.error().code, world::ErrorCode::kUsage);
        EXPECT_TRUE(found.error().what.ends_with(std::string("nearest is ") + right)) << found.error().what;
    }
}

TEST(ShadowMethods, WhatCannotWorkIsRefused) {
    using culling::ShadowMethod;
    const double nan = std::nan("");
    const std::pair<const char*, std::function<void(ShadowMethod&)>> cases[] = {
        {"cascades: 0", [](ShadowMethod& m) { m.splits.count = 0; }},
        {"cascades: 9", [](ShadowMethod& m) { m.splits.count = 9; }},
        {"cascades: 8", [](ShadowMethod& m) { m.splits.count = 8, m.staticMap = true; }},
        {"split ratio", [](ShadowMethod& m) { m.splits.ratio = 1; }},
        {"split ratio", [=](ShadowMethod& m) { m.splits.ratio = nan; }},
        {"blend of splits", [](ShadowMethod& m) { m.splits.blend = 1.5; }},
        {"side", [](ShadowMethod& m) { m.side = 63; }},
        {"bits of depth", [](ShadowMethod& m) { m.depthBits = 24; }},
        {"guard band", [](ShadowMethod& m) { m.guardBand = 0; }},
        {"error of levels", [=](ShadowMethod& m) { m.levelError = nan; }},
        {"bias", [](ShadowMethod& m) { m.bias.normalOffset = -1; }},
        {"bias", [=](ShadowMethod& m) { m.bias.slope = nan; }},
        {"blend: ", [](ShadowMethod& m) { m.blend = 1; }},
        {"fade: ", [=](ShadowMethod& m) { m.fade = nan; }},
        {"facets: 6", [](ShadowMethod& m) { m.fit = culling::Fit::kFacets, m.facets = 6; }},
        {"facet detail", [](ShadowMethod& m) { m.facetDetail = 0; }},
        {"radii",
         [](ShadowMethod& m) {
             m.radii = {1, 2, 3, 4};
         }},
        {"radii",
         [](ShadowMethod& m) {
             m.fit = culling::Fit::kPushedSphere, m.radii = {1, 2, 3};
         }},
        {"radius",
         [](ShadowMethod& m) {
             m.fit = culling::Fit::kPushedSphere, m.radii = {1, 3, 2, 4};
         }},
        {"several cascades", [](ShadowMethod& m) { m.fit = culling::Fit::kWarped, m.snapped = false; }},
        {"depths of a warped",
         [](ShadowMethod& m) {
             m.fit = culling::Fit::kFacets, m.splits.count = 1, m.snapped = false,
             m.depth = culling::DepthFit::kClipped;
         }},
        {"static map beside",
         [](ShadowMethod& m) {
             m.fit = culling::Fit::kFacets, m.splits.count = 1, m.snapped = false, m.staticMap = true;
         }},
        {"snapped", [](ShadowMethod& m) { m.fit = culling::Fit::kSliceBox; }},
        {"not snapped", [](ShadowMethod& m) { m.keep = culling::Keep::kScrolled, m.snapped = false; }},
        {"follow each move",
         [](ShadowMethod& m) { m.keep = culling::Keep::kCached, m.depth = culling::DepthFit::kClipped; }},
        {"depths move",
         [](ShadowMethod& m) { m.keep = culling::Keep::kCached, m.depth = culling::DepthFit::kMoving; }},
    };
    for (const auto& [text, spoil] : cases) {
        ShadowMethod method{.name = "spoilt"};
        ASSERT_TRUE(culling::requireMethod(method));
        spoil(method);
        const auto refused = culling::requireMethod(method);
        ASSERT_FALSE(refused) << text;
        EXPECT_EQ(refused.error().code, world::ErrorCode::kUsage);
        EXPECT_NE(refused.error().what.find(text), std::string::npos) << refused.error().what;
        EXPECT_NE(refused.error().what.find("; give "), std::string::npos) << refused.error().what;
    }
}

}  // namespace
