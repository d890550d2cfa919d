// tests/tools/lab_results_test.cpp — results come back as they were kept, whole or not at all, and keys tell all
// that results follow from.
#include "tools/lab/results.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <set>

#include "culling/shadow_views.h"
#include "tests/tools/lab_records.h"
#include "tests/world/random_world.h"

namespace {

using culling::ShadowMethod;
using tests::someMethod;
using tests::someRun;
using tools::lab::MethodRecord;
using tools::lab::Results;

void expectEqual(const MethodRecord& a, const MethodRecord& b) {
    EXPECT_EQ(a.name, b.name);
    EXPECT_EQ(a.fields, b.fields);
    EXPECT_EQ(a.frames, b.frames);
    EXPECT_EQ(a.cost, b.cost);
    EXPECT_EQ(a.ms, b.ms);
    EXPECT_EQ(a.shadingMs, b.shadingMs);
    EXPECT_EQ(a.judged, b.judged);
    EXPECT_EQ(a.pixels, b.pixels);
    EXPECT_EQ(a.falseLit.atEdges, b.falseLit.atEdges);
    EXPECT_EQ(a.falseLit.elsewhere, b.falseLit.elsewhere);
    EXPECT_EQ(a.falseShadow.atEdges, b.falseShadow.atEdges);
    EXPECT_EQ(a.falseShadow.elsewhere, b.falseShadow.elsewhere);
    EXPECT_EQ(a.difference, b.difference);
    EXPECT_EQ(a.softDifference, b.softDifference);
    EXPECT_EQ(a.unanswered, b.unanswered);
    EXPECT_EQ(a.points, b.points);
    EXPECT_EQ(a.flips, b.flips);
    EXPECT_EQ(a.ratio50, b.ratio50);
    EXPECT_EQ(a.ratio99, b.ratio99);
    EXPECT_EQ(a.usedShare, b.usedShare);
    EXPECT_EQ(a.worstFrame, b.worstFrame);
    EXPECT_EQ(a.worstWrong, b.worstWrong);
    EXPECT_EQ(a.picture, b.picture);
    EXPECT_EQ(a.series, b.series);
}

TEST(LabResults, ComeBackInAnotherProcessAsTheyWereKept) {
    const world_tests::TempFolder folder;
    const std::string out = folder.file("a.lab");
    const uint64_t high = 0xfedcba9876543210;  // a key that is negative as SQLite has it
    {
        auto results = Results::open(out);
        ASSERT_TRUE(results);
        EXPECT_FALSE(std::filesystem::exists(out)) << "only results make the folder";
        EXPECT_FALSE(results.value().find(1).value());
        ASSERT_TRUE(results.value().save(someRun(), 1, someMethod("one", 1)));
        ASSERT_TRUE(results.value().save(someRun(), high, someMethod("'two'; DROP TABLE method", 2)));
        ASSERT_TRUE(results.value().save(someRun(8), 3, someMethod("of another run", 3)));
    }
    auto results = Results::open(out);
    ASSERT_TRUE(results) << results.error().what;
    const auto one = results.value().find(1), two = results.value().find(high);
    ASSERT_TRUE(one && one.value());
    ASSERT_TRUE(two && two.value());
    expectEqual(*one.value(), someMethod("one", 1));
    expectEqual(*two.value(), someMethod("'two'; DROP TABLE method", 2));
    EXPECT_FALSE(results.value().find(2).value());
    const auto all = results.value().methodsOf(someRun());
    ASSERT_TRUE(all);
    ASSERT_EQ(all.value().size(), 2u);
    expectEqual(all.value()[0], *two.value());  // by name
    expectEqual(all.value()[1], *one.value());
}

TEST(LabResults, ARowOfTheSameKeyIsReplacedWithItsFrames) {
    const world_tests::TempFolder folder;
    auto results = Results::open(folder.file("a.lab"));
    ASSERT_TRUE(results);
    ASSERT_TRUE(results.value().save(someRun(), 1, someMethod("one", 1)));
    MethodRecord shorter = someMethod("one", 2);
    shorter.series.resize(3);
    ASSERT_TRUE(results.value().save(someRun(), 1, shorter));
    const auto found = results.value().find(1);
    ASSERT_TRUE(found && found.value());
    expectEqual(*found.value(), shorter);
}

TEST(LabResults, ClaimsAreOfTheirRunAndReplacedWhole) {
    const world_tests::TempFolder folder;
    auto results = Results::open(folder.file("a.lab"));
    ASSERT_TRUE(results);
    EXPECT_TRUE(results.value().claimsOf(someRun()).value().empty());
    ASSERT_TRUE(results.value().saveClaims(someRun(), tests::someClaims(1)));
    ASSERT_TRUE(results.value().saveClaims(someRun(8), tests::someClaims(2)));
    EXPECT_EQ(results.value().claimsOf(someRun()).value(), tests::someClaims(1));
    EXPECT_EQ(results.value().claimsOf(someRun(8)).value(), tests::someClaims(2));
    auto fewer = tests::someClaims(3);
    fewer.resize(2);
    ASSERT_TRUE(results.value().saveClaims(someRun(), fewer));
    EXPECT_EQ(results.value().claimsOf(someRun()).value(), fewer);
}

TEST(LabResults, WhatOcclusionCameToIsOfItsRunAndReplacedWhole) {
    const world_tests::TempFolder folder;
    const std::string out = folder.file("a.lab");
    {
        auto results = Results::open(out);
        ASSERT_TRUE(results);
        EXPECT_TRUE(results.value().occlusionOf(someRun()).value().empty());
        ASSERT_TRUE(results.value().saveOcclusion(someRun(), tests::someOcclusion(1)));
        ASSERT_TRUE(results.value().saveOcclusion(someRun(8), tests::someOcclusion(2)));
    }
    auto results = Results::open(out);
    ASSERT_TRUE(results);
    EXPECT_EQ(results.value().occlusionOf(someRun()).value(), tests::someOcclusion(1));
    EXPECT_EQ(results.value().occlusionOf(someRun(8)).value(), tests::someOcclusion(2));
    EXPECT_TRUE(results.value().occlusionOf(someRun(9)).value().empty());
    auto fewer = tests::someOcclusion(3);
    fewer.pop_back();
    ASSERT_TRUE(results.value().saveOcclusion(someRun(), fewer));
    EXPECT_EQ(results.value().occlusionOf(someRun()).value(), fewer);
    const auto page = results.value().writePage(someRun());
    ASSERT_TRUE(page);
    EXPECT_NE(world_tests::readFile(page.value()).find("\"name\":\"way 4\""), std::string::npos);
    // A folder from before the table was there gets it.
    ASSERT_TRUE(world::Database::openEmpty(out + "/lab.sqlite").value().run("DROP TABLE occlusion"));
    auto old = Results::open(out);
    ASSERT_TRUE(old) << old.error().what;
    EXPECT_TRUE(old.value().occlusionOf(someRun()).value().empty());
    EXPECT_TRUE(old.value().saveOcclusion(someRun(), fewer));
}

TEST(LabResults, WhatIsNoLabIsRefusedAndLeftAlone) {
    const world_tests::TempFolder folder;
    const std::string out = folder.file("a.lab"), file = out + "/lab.sqlite";
    world_tests::writeFile(out, "a file");
    EXPECT_EQ(Results::open(out).error().code, world::ErrorCode::kIo);
    std::filesystem::remove(out);
    std::filesystem::create_directories(out);
    const std::string text(4096, 'x');
    world_tests::writeFile(file, text);
    const auto opened = Results::open(out);
    ASSERT_FALSE(opened);
    EXPECT_EQ(opened.error().code, world::ErrorCode::kBadData);
    EXPECT_NE(opened.error().what.find(file), std::string::npos);
    EXPECT_EQ(world_tests::readFile(file), text);

    world_tests::writeFile(file, "");
    const auto database = [&](const std::string& sql) { return bool(world::Database::openEmpty(file).value().run(sql)); };
    ASSERT_TRUE(database("CREATE TABLE other(x)"));
    EXPECT_EQ(Results::open(out).error().code, world::ErrorCode::kBadData);
    ASSERT_TRUE(database("DROP TABLE other"));
    ASSERT_TRUE(Results::open(out));
    ASSERT_TRUE(database("PRAGMA user_version=1000"));  // of a version to come
    EXPECT_EQ(Results::open(out).error().code, world::ErrorCode::kBadData);
}

TEST(LabResults, SettingsThatAreNotOursAreAnError) {
    const world_tests::TempFolder folder;
    const std::string out = folder.file("a.lab");
    ASSERT_TRUE(Results::open(out).value().save(someRun(), 1, someMethod("one", 1)));
    for (const char* settings : {"", "{", "7", "[7]", "[[1, 2, 3]]", "[[\"a\", \"b\"]]"}) {
        auto database = world::Database::openEmpty(out + "/lab.sqlite");
        ASSERT_TRUE(database.value().run(std::string("UPDATE method SET settings = '") + settings + "'"));
        const auto found = Results::open(out).value().find(1);
        ASSERT_FALSE(found) << settings;
        EXPECT_EQ(found.error().code, world::ErrorCode::kBadData);
    }
}

/// Every member of a method, changed on its own.
TEST(MethodKey, TellsEveryFieldAndTheRun) {
    const std::vector<std::function<void(ShadowMethod&)>> changes = {
        [](auto& m) { m.name = "b"; },
        [](auto& m) { m.splits.count = 3; },
        [](auto& m) { m.splits.ratio = 3.0000000000000004; },  // the next double
        [](auto& m) { m.splits.blend = 0.9; },
        [](auto& m) { m.fit = culling::Fit::kSliceBox; },
        [](auto& m) { m.snapped = false; },
        [](auto& m) { m.depth = culling::DepthFit::kMoving; },
        [](auto& m) { m.selection = culling::Selection::kInterval; },
        [](auto& m) { m.side = 512; },
        [](auto& m) { m.depthBits = 16; },
        [](auto& m) { m.atlas = true; },
        [](auto& m) { m.radii = {1, 2}; },
        [](auto& m) { m.radii = {12}; },
        [](auto& m) { m.facets = 4; },
        [](auto& m) { m.facetDetail = 0.1; },
        [](auto& m) { m.levelError = 1; },
        [](auto& m) { m.staticMap = true; },
        [](auto& m) { m.bias.constant = 1; },
        [](auto& m) { m.bias.slope = 1; },
        [](auto& m) { m.bias.receiver = 1; },
        [](auto& m) { m.bias.gradient = 1; },
        [](auto& m) { m.bias.gradientMost = 1; },
        [](auto& m) { m.bias.plane = true; },
        [](auto& m) { m.bias.normalOffset = 1; },
        [](auto& m) { m.filter = culling::Filter::kBox2; },
        [](auto& m) { m.blend = 0.1; },
        [](auto& m) { m.fade = 0.1; },
        [](auto& m) { m.keep = culling::Keep::kCached; },
        [](auto& m) { m.mendedScroll = false; },
        [](auto& m) { m.guardBand = 2; },
    };
    const ShadowMethod plain{.name = "a"};
    std::set<uint64_t> keys{tools::lab::methodKey(someRun(), plain), tools::lab::methodKey(someRun(8), plain)};
    EXPECT_EQ(tools::lab::methodKey(someRun(), plain), tools::lab::methodKey(someRun(), plain));
    for (const auto& change : changes) {
        ShadowMethod method = plain;
        change(method);
        keys.insert(tools::lab::methodKey(someRun(), method));
    }
    EXPECT_EQ(keys.size(), changes.size() + 2);
    // And every word of every enumeration is one of its own, or two methods would look the same.
    std::set<std::string> words;
    for (int k = 0; k < 8; ++k) words.insert(culling::settingsOf({.name = "", .fit = culling::Fit(k)})[3].value);
    EXPECT_EQ(words.size(), 8u);
    for (const ShadowMethod& method : culling::namedMethods())
        for (const auto& field : culling::settingsOf(method))
            EXPECT_EQ(field.value.empty(), field.name == "radii" && method.radii.empty()) << method.name << ": " << field.name;
}

}  // namespace
