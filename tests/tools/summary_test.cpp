// tests/tools/summary_test.cpp — the summary is the sum of its frames, and only its times are noisy.
#include "tools/summary.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "tests/tools/synthetic_frames.h"

namespace {

using nlohmann::json;

std::vector<tools::ReplayFrame> frames(uint32_t seed, uint32_t noiseSeed, size_t count) {
    std::mt19937 rng(seed), noise(noiseSeed);
    std::vector<tools::ReplayFrame> list;
    for (size_t k = 0; k < count; ++k) list.push_back(tools_test::randomFrame(rng, noise, 100 + k, 3));
    return list;
}

tools::Summary summaryOf(const std::vector<tools::ReplayFrame>& list) {
    tools::Summary summary;
    for (const tools::ReplayFrame& frame : list) summary.add(frame);
    return summary;
}

tools::ReplayHead head() {
    tools::ReplayHead h;
    h.world = "made up \xff.world";  // not UTF-8, as file names may be
    h.texels = {0.1, 0.3, 0.9};
    h.splits = {20, 60, 180};
    return h;
}

TEST(Summary, IsTheSumOfItsFrames) {
    const std::vector<tools::ReplayFrame> list = frames(1, 2, 40);
    const json document = json::parse(tools::toJson(head(), summaryOf(list)));
    uint64_t arrivals = 0, verified = 0, idle = 0;
    for (const tools::ReplayFrame& f : list) {
        arrivals += f.report.chunkArrivals;
        verified += f.verify ? 1 : 0;
        idle += f.report.submitted ? 0 : 1;
    }
    EXPECT_EQ(document["frames"], 40);
    EXPECT_EQ(document["first_frame"], 100);
    EXPECT_EQ(document["chunk_arrivals"], arrivals);
    EXPECT_EQ(document["verified"]["frames"], verified);
    EXPECT_EQ(document["idle_frames"], idle);
    EXPECT_EQ(document["times"]["update"]["frames"], verified);
    ASSERT_EQ(document["cascades"].size(), 3u);
    for (size_t c = 0; c < 3; ++c) {
        cache::Cost total, redraw;
        uint64_t scrollFrames = 0;
        for (const tools::ReplayFrame& f : list) {
            total += f.report.cascades[c].total;
            redraw += f.redraw[c];
            scrollFrames +=
                f.report.cascades[c].byCause[size_t(cache::Cause::kScroll)] == cache::Cost{} ? 0 : 1;
        }
        const json& cascade = document["cascades"][c];
        EXPECT_EQ(cascade["static"]["triangles"], total.triangles);
        EXPECT_EQ(cascade["redraw"]["texels"], redraw.texels);
        EXPECT_EQ(cascade["causes"]["scroll"]["frames"], scrollFrames);
        uint64_t byCause = 0;
        for (const json& cause : cascade["causes"]) byCause += cause["triangles"].get<uint64_t>();
        EXPECT_EQ(byCause, total.triangles);
    }
}

TEST(Summary, SpotLightsAreSummedByCause) {
    std::vector<tools::ReplayFrame> list = frames(1, 2, 3);
    for (tools::ReplayFrame& f : list) f.report.spots = {{0, {}}, {1, {}}};
    using cache::Cause;
    list[0].report.spots[1].cost = {Cause::kStart, {100, 3, 50, 4}, {100, 1, 7, 1}};
    list[1].report.spots[1].cost = {Cause::kArrival, {100, 5, 70, 6}, {100, 2, 9, 2}};
    list[2].report.spots[1].cost = {Cause::kStart, {}, {100, 0, 0, 0}};
    tools::ReplayHead h = head();
    h.spots = {{{1, 2, 3}, {0, -1, 0}}, {{4, 5, 6}, {0, -1, 0}}};
    const json document = json::parse(tools::toJson(h, summaryOf(list)));
    ASSERT_EQ(document["spots"].size(), 2u);
    EXPECT_TRUE(document["spots"][0]["causes"].empty());
    EXPECT_EQ(document["spots"][0]["active"]["frames"], 0);
    const json& spot = document["spots"][1];
    EXPECT_EQ(spot["position_m"], json::parse("[4, 5, 6]"));
    EXPECT_EQ(spot["causes"].size(), 2u);
    EXPECT_EQ(spot["causes"]["start"], json::parse(R"({"texels": 100, "casters": 3, "triangles": 50, "draws": 4, "frames": 1})"));
    EXPECT_EQ(spot["causes"]["arrival"]["triangles"], 70);
    EXPECT_EQ(spot["active"], json::parse(R"({"texels": 300, "casters": 3, "triangles": 16, "draws": 3, "frames": 3})"));
    const std::string text = tools::toText(h, summaryOf(list));
    EXPECT_NE(text.find("redrawn 1 for start, 1 for arrival: 200 texels, 120 triangles"), std::string::npos) << text;
    EXPECT_NE(text.find("active casters in 3 frames: 300 texels, 16 triangles"), std::string::npos) << text;
}

TEST(Summary, OnlyTimesAndMachineDifferBetweenRuns) {
    json one = json::parse(tools::toJson(head(), summaryOf(frames(3, 4, 25))));
    tools::ReplayHead elsewhere = head();
    elsewhere.threads = 7;
    elsewhere.device = "another";
    json two = json::parse(tools::toJson(elsewhere, summaryOf(frames(3, 5, 25))));
    EXPECT_NE(one["times"], two["times"]);
    for (json* document : {&one, &two}) {
        document->erase("times");
        document->erase("machine");
    }
    EXPECT_EQ(one, two);
    EXPECT_EQ(tools::toJson(head(), summaryOf(frames(3, 4, 25))),
              tools::toJson(head(), summaryOf(frames(3, 4, 25))));
}

TEST(Summary, PlanHashFollowsEveryPlanAndTheirOrder) {
    std::vector<tools::ReplayFrame> list = frames(6, 7, 5);
    const uint64_t before = summaryOf(list).planHash;
    std::swap(list[1].report.planHash, list[3].report.planHash);
    EXPECT_NE(summaryOf(list).planHash, before);
}

TEST(Summary, NothingReplayedIsNoDivisionByZero) {
    const tools::Summary empty;
    EXPECT_TRUE(json::accept(tools::toJson(head(), empty)));
    EXPECT_FALSE(tools::toText(head(), empty).empty());
}

TEST(Summary, TextNamesWhatItCompares) {
    const std::string text = tools::toText(head(), summaryOf(frames(8, 9, 30)));
    for (const char* word :
         {"cascade", "redraw", "scroll", "promotion", "active", "Occlusion", "Streaming", "p95"})
        EXPECT_NE(text.find(word), std::string::npos) << word;
}

TEST(Quantile, IsTheNearestRank) {
    std::mt19937 rng(10);
    for (size_t size = 1; size < 60; ++size) {
        std::vector<double> values(size);
        for (double& v : values) v = rng() % 1000;
        std::vector<double> sorted = values;
        std::sort(sorted.begin(), sorted.end());
        for (double q : {0.0, 0.25, 0.5, 0.95, 1.0}) {
            // The smallest value that at least a share q of all does not exceed, found by looking at each.
            size_t k = 0;
            while (double(k + 1) < q * double(size)) ++k;
            EXPECT_EQ(tools::quantile(values, q), sorted[k]) << size << " values, q " << q;
        }
    }
    EXPECT_EQ(tools::quantile({}, 0.5), 0);
}

TEST(OcclusionValue, TakesAHiddenTriangleForADrawnOne) {
    tools::Summary summary;
    summary.cascades.resize(2);
    summary.cascades[0].clustersFound = 30;
    summary.cascades[0].clustersHidden = 10;
    summary.cascades[0].trianglesHidden = 1000;
    summary.cascades[0].total.triangles = 2000;
    summary.cascades[0].staticMs = 8;
    summary.cascades[1].clustersFound = 5;  // all hidden: nothing drawn to judge by
    summary.cascades[1].clustersHidden = 5;
    summary.cascades[1].trianglesHidden = 100;
    const tools::OcclusionValue value = tools::occlusionValue(summary);
    EXPECT_EQ(value.found, 35u);
    EXPECT_EQ(value.hidden, 15u);
    EXPECT_EQ(value.trianglesHidden, 1100u);
    EXPECT_EQ(value.msSaved, 4);
}

}  // namespace
