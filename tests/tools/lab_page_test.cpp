// tests/tools/lab_page_test.cpp — the lab's page holds what it shows, whatever the text, and asks for nothing.
#include "tools/lab/page.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "tests/tools/lab_records.h"
#include "tests/tools/page_data.h"

namespace {

using tests::someMethod;
using tests::someRun;

size_t count(const std::string& text, const std::string& word) {
    size_t found = 0;
    for (size_t at = text.find(word); at != std::string::npos; at = text.find(word, at + 1)) ++found;
    return found;
}

/// What a browser takes for the data: up to the first end of its element.
TEST(LabPage, HoldsEveryFigureOfEveryMethod) {
    const std::vector<tools::lab::MethodRecord> methods{someMethod("one", 1), someMethod("two", 2)};
    const auto data = tools_test::dataOf(tools::lab::labPage(someRun(), methods));
    ASSERT_TRUE(data.is_object());
    EXPECT_EQ(data["run"]["world"], "town.world");
    EXPECT_EQ(data["run"]["sun"], (std::vector<double>{0.6, -0.8, 0}));
    EXPECT_EQ(data["run"]["threads"], 2);
    ASSERT_EQ(data["methods"].size(), 2u);
    for (size_t k = 0; k < 2; ++k) {
        const tools::lab::MethodRecord& r = methods[k];
        const auto& shown = data["methods"][k];
        EXPECT_EQ(shown["name"], r.name);
        EXPECT_EQ(shown["fields"].size(), r.fields.size());
        EXPECT_EQ(shown["triangles"].get<double>(), double(r.cost.triangles) / 60);
        EXPECT_EQ(shown["texels"].get<double>(), double(r.cost.texels) / 60);
        EXPECT_EQ(shown["draws"].get<double>(), double(r.cost.draws) / 60);
        EXPECT_EQ(shown["ms"].get<double>(), r.ms);
        EXPECT_EQ(shown["shadingMs"].get<double>(), r.shadingMs);
        EXPECT_EQ(shown["lit"].get<double>(), 100 * double(r.falseLit.all()) / double(r.pixels));
        EXPECT_EQ(shown["litEdges"].get<double>(), 100 * double(r.falseLit.atEdges) / double(r.pixels));
        EXPECT_EQ(shown["shadow"].get<double>(), 100 * double(r.falseShadow.all()) / double(r.pixels));
        EXPECT_EQ(shown["shadowEdges"].get<double>(), 100 * double(r.falseShadow.atEdges) / double(r.pixels));
        EXPECT_EQ(shown["wrong"].get<double>(), 100 * double(r.falseLit.all() + r.falseShadow.all()) / double(r.pixels));
        EXPECT_EQ(shown["off"].get<double>(), r.difference / double(r.pixels));
        EXPECT_EQ(shown["soft"].get<double>(), r.softDifference / double(r.pixels));
        EXPECT_EQ(shown["flips"].get<double>(), 1e6 * double(r.flips) / double(r.points));
        EXPECT_EQ(shown["used"].get<double>(), 100 * r.usedShare / 4);
        EXPECT_EQ(shown["unanswered"].get<double>(), 100 * double(r.unanswered) / double(r.pixels));
        ASSERT_EQ(shown["series"].size(), 60u);
        EXPECT_EQ(shown["series"][5], nlohmann::json({5, r.series[5].triangles, r.series[5].ms}));
        EXPECT_EQ(shown["series"][31][5], r.series[31].judged->falseShadow);
        EXPECT_EQ(shown["picture"].get<std::string>().size(), 400u);  // 300 bytes in base64
    }
}

TEST(LabPage, HoldsEveryClaimOfTheSuite) {
    const auto records = tests::someClaims(1);
    EXPECT_EQ(tools_test::dataOf(tools::lab::labPage(someRun(), {}))["claims"], nlohmann::json::array());
    const auto shown = tools_test::dataOf(tools::lab::labPage(someRun(), {}, {}, records))["claims"];
    ASSERT_EQ(shown.size(), records.size());
    for (size_t k = 0; k < records.size(); ++k) {
        const tools::lab::ClaimRecord& r = records[k];
        EXPECT_EQ(shown[k], (nlohmann::json{{"situation", r.situation}, {"what", r.what}, {"method", r.method}, {"measure", r.measure},
                                            {"why", r.why}, {"verdict", r.verdict}, {"value", r.value}, {"limit", r.limit},
                                            {"fails", r.fails}, {"wrong", r.wrong}}));
    }
}

TEST(LabPage, HoldsEveryFigureOfOcclusion) {
    const auto records = tests::someOcclusion(1);
    EXPECT_EQ(tools_test::dataOf(tools::lab::labPage(someRun(), {}))["occlusion"], nlohmann::json::array());
    const auto shown = tools_test::dataOf(tools::lab::labPage(someRun(), {}, records))["occlusion"];
    ASSERT_EQ(shown.size(), records.size());
    for (size_t k = 0; k < records.size(); ++k) {
        const tools::lab::OcclusionRecord &r = records[k], &drawn = records[0];
        const double lit = 100 * double(r.falseLit) / double(r.pixels);
        const nlohmann::json expected{{"name", r.way}, {"asked", double(r.asked) / 4}, {"hidden", double(r.hidden) / 4},
                                      {"wrongly", double(r.wronglyHidden) / 4}, {"texels", double(r.texelsWrong) / 4}, {"deepest", r.deepest},
                                      {"lit", lit}, {"added", lit - 100 * double(drawn.falseLit) / double(drawn.pixels)},
                                      {"triangles", double(r.triangles) / 4}, {"rays", double(r.rays) / 4}, {"prepareMs", r.prepareMs / 4}, {"ms", r.ms / 4}};
        EXPECT_EQ(shown[k], expected);
    }
}

TEST(LabPage, NoTextCanEndItsScript) {
    auto run = someRun();
    run.world = "</script><script>alert(1)</script><!--";
    run.path = "@DATA@ @CHART@ @LICENCE@ \xff\xfe \\ \" \xe2\x80\xa8";
    const std::string plain = tools::lab::labPage(someRun(), {});
    const std::string name = "</SCRIPT ><img src=x onerror=alert(1)>";
    const std::string page = tools::lab::labPage(run, std::vector{someMethod(name, 1)});
    EXPECT_EQ(count(page, "</script"), count(plain, "</script"));
    EXPECT_EQ(count(page, "<script"), count(plain, "<script"));
    EXPECT_EQ(count(page, "</SCRIPT"), 0u);
    EXPECT_EQ(count(page, "<!--"), count(plain, "<!--"));
    EXPECT_EQ(count(page, "@DATA@"), 1u) << "a mark within the data is no mark";
    const auto data = tools_test::dataOf(page);
    ASSERT_TRUE(data.is_object());
    EXPECT_EQ(data["run"]["world"], run.world);
    EXPECT_EQ(data["methods"][0]["name"], name);
}

TEST(LabPage, IsWholeInItselfWithItsLicence) {
    const std::string page = tools::lab::labPage(someRun(), std::vector{someMethod("one", 1)});
    EXPECT_NE(page.find("Chart.js v3.9.1"), std::string::npos);
    EXPECT_NE(page.find("Permission is hereby granted, free of charge"), std::string::npos);
    EXPECT_NE(page.find("default-src 'none'"), std::string::npos);  // browsers see to it that nothing is asked for
    // Attributes and style sheets that would ask all the same.
    for (const char* word : {" src=\"http", "href=\"http", "url(", "@import", "<link", "<iframe"}) EXPECT_EQ(count(page, word), 0u) << word;
    EXPECT_EQ(page, tools::lab::labPage(someRun(), std::vector{someMethod("one", 1)}));
}

}  // namespace
