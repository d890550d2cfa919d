// tests/tools/chart_test.cpp — a chart is well-formed, and every point is where its values say.
#include "tools/chart.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <regex>

#include "tools/stress.h"

namespace {

using tools::Chart;

/// Tags are closed in order, attributes quoted, and no bare & or < is in a text: what an XML reader insists on.
bool wellFormed(const std::string& xml) {
    static const std::regex tag("<(/?)([a-z]+)((?: [a-zA-Z0-9:-]+=\"[^\"<&]*\")*)(/?)>"), entity("&(amp|lt|gt|quot);");
    std::vector<std::string> open;
    size_t roots = 0;
    for (size_t at = 0; at < xml.size();) {
        std::smatch found;
        const auto from = xml.begin() + std::ptrdiff_t(at);
        if (xml[at] == '<') {
            if (!std::regex_search(from, xml.end(), found, tag, std::regex_constants::match_continuous)) return false;
            if (found[1].length() > 0) {
                if (open.empty() || open.back() != found[2]) return false;
                open.pop_back();
            } else if (found[4].length() == 0) {
                roots += open.empty() ? 1 : 0;
                open.push_back(found[2]);
            }
            at += size_t(found.length());
        } else if (xml[at] == '&') {
            if (!std::regex_search(from, xml.end(), found, entity, std::regex_constants::match_continuous)) return false;
            at += size_t(found.length());
        } else {
            ++at;
        }
    }
    return open.empty() && roots == 1;
}

struct Spot {
    double x, y;
};

/// The circles, in their order [pixels].
std::vector<Spot> circles(const std::string& svg) {
    static const std::regex circle("<circle cx=\"([0-9.]+)\" cy=\"([0-9.]+)\"");
    std::vector<Spot> spots;
    for (std::sregex_iterator at(svg.begin(), svg.end(), circle), end; at != end; ++at)
        spots.push_back({std::stod((*at)[1]), std::stod((*at)[2])});
    return spots;
}

TEST(Chart, HasEveryPointInItsPlace) {
    std::mt19937 rng(5);
    for (int round = 0; round < 50; ++round) {
        Chart chart{"title", "read [MB]", "wrong [%]", {}};
        std::vector<tools::ChartPoint> all;
        const size_t lines = rng() % 4, points = rng() % 5;
        for (size_t line = 0; line < lines; ++line) {
            chart.lines.push_back({"line " + std::to_string(line), {}});
            for (size_t k = 0; k < points; ++k) {
                const double y = rng() % 4 == 0 ? 0 : std::pow(10, double(rng() % 1000) / 125 - 6);
                all.push_back({double(rng() % 100000) / 7, y, "point " + std::to_string(all.size())});
                chart.lines.back().points.push_back(all.back());
            }
        }
        const std::string svg = tools::toSvg(chart);
        ASSERT_TRUE(wellFormed(svg)) << svg;
        const std::vector<Spot> spots = circles(svg);
        ASSERT_EQ(spots.size(), all.size());
        for (size_t a = 0; a < all.size(); ++a) {
            EXPECT_NE(svg.find(", point " + std::to_string(a) + "<"), std::string::npos);
            EXPECT_TRUE(spots[a].x >= 0 && spots[a].x <= 800 && spots[a].y >= 0 && spots[a].y <= 500);
            for (size_t b = 0; b < all.size(); ++b) {  // pixels are written to a tenth
                if (all[a].x < all[b].x) {
                    EXPECT_LE(spots[a].x, spots[b].x);
                }
                if (all[a].y < all[b].y) {
                    EXPECT_GE(spots[a].y, spots[b].y);
                }
                if (all[a].y == 0 && all[b].y > 0) {
                    EXPECT_GT(spots[a].y, spots[b].y) << "nothing is not a little";
                }
            }
        }
    }
}

TEST(Chart, IsLinearInXAndLogarithmicInY) {
    const std::vector<Spot> at =
        circles(tools::toSvg({"", "", "", {{"a", {{0, 1e-4, ""}, {10, 1e-2, ""}, {20, 1, ""}, {40, 0, ""}}}}}));
    ASSERT_EQ(at.size(), 4u);
    EXPECT_NEAR(at[1].x - at[0].x, at[2].x - at[1].x, 0.2) << "rounded to tenths of a pixel";
    EXPECT_NEAR(at[3].x - at[0].x, 4 * (at[1].x - at[0].x), 0.5) << "likewise, four times";
    EXPECT_NEAR(at[0].y - at[1].y, at[1].y - at[2].y, 0.2);
    EXPECT_GT(at[3].y, at[0].y);
}

TEST(Chart, TextsAreEscaped) {
    const std::string svg = tools::toSvg({"a < b & \"c\"", "<x>", "&", {{"l<", {{1, 1, "&p"}}}}});
    EXPECT_TRUE(wellFormed(svg)) << svg;
    EXPECT_NE(svg.find("a &lt; b &amp; &quot;c&quot;"), std::string::npos);
    EXPECT_FALSE(wellFormed("<svg><text>a & b</text></svg>")) << "or the test sees nothing";
    EXPECT_FALSE(wellFormed("<svg><text></svg></text>"));
}

TEST(Chart, OfPrefetchHasALineForEachSpeed) {
    std::vector<tools::StressResult> results;
    for (const char* name : {"prefetch-50-none", "prefetch-50-path", "prefetch-200-none"}) {
        tools::StressResult r;
        r.name = name;
        r.summary.bytesRead = results.size() * 1'000'000;
        r.comparedTexels = 1000;
        r.holes = results.size();
        results.push_back(r);
    }
    const std::string svg = tools::prefetchChart(results);
    EXPECT_TRUE(wellFormed(svg));
    EXPECT_EQ(circles(svg).size(), 3u);
    for (const char* label : {"50 m/s, none", "50 m/s, path", "200 m/s, none", "[MB", "[%"})
        EXPECT_NE(svg.find(label), std::string::npos) << label;
    size_t lines = 0;
    for (size_t at = 0; (at = svg.find("<polyline", at)) != std::string::npos; ++at) ++lines;
    EXPECT_EQ(lines, 2u);
}

}  // namespace
