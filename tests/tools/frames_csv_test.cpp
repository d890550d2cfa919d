// tests/tools/frames_csv_test.cpp — the CSV says what the reports say, its causes add up, its times stand
// apart.
#include "tools/frames_csv.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <map>
#include <sstream>

#include "tests/tools/synthetic_frames.h"

namespace {

using tools::FrameColumn;
using tools::ReplayFrame;
using Row = std::map<std::string, std::string>;

std::vector<std::string> split(const std::string& line) {
    std::vector<std::string> cells(1);
    for (char c : line) {
        if (c == ',')
            cells.emplace_back();
        else
            cells.back() += c;
    }
    return cells;
}

/// The text read back by a parser of a few lines: cells by column name.
std::vector<Row> parse(const std::string& csv) {
    std::istringstream lines(csv);
    std::string line;
    std::getline(lines, line);
    const std::vector<std::string> names = split(line);
    std::vector<Row> rows;
    while (std::getline(lines, line)) {
        const std::vector<std::string> cells = split(line);
        EXPECT_EQ(cells.size(), names.size());
        Row row;
        for (size_t k = 0; k < std::min(cells.size(), names.size()); ++k) row[names[k]] = cells[k];
        rows.push_back(row);
    }
    return rows;
}

std::string csvOf(const std::vector<ReplayFrame>& frames) {
    const std::vector<FrameColumn> columns = tools::frameColumns();
    std::string csv = tools::csvHeader(columns);
    for (const ReplayFrame& frame : frames) csv += tools::csvRows(columns, frame);
    return csv;
}

std::vector<ReplayFrame> frames(uint32_t seed, uint32_t noiseSeed, size_t count, int cascades) {
    std::mt19937 rng(seed), noise(noiseSeed);
    std::vector<ReplayFrame> list;
    for (size_t k = 0; k < count; ++k) list.push_back(tools_test::randomFrame(rng, noise, k, cascades));
    return list;
}

TEST(FramesCsv, CausesSumToTheTotals) {
    const std::vector<ReplayFrame> list = frames(1, 2, 50, 4);
    const std::vector<Row> rows = parse(csvOf(list));
    ASSERT_EQ(rows.size(), 200u);
    for (const Row& row : rows) {
        for (const std::string part : {"_texels", "_casters", "_triangles", "_draws"}) {
            uint64_t sum = 0;
            for (int cause = 0; cause < cache::kCauses; ++cause)
                sum += std::stoull(row.at(cache::toString(static_cast<cache::Cause>(cause)) + part));
            EXPECT_EQ(sum, std::stoull(row.at("static" + part))) << "frame " << row.at("frame") << part;
        }
    }
}

TEST(FramesCsv, CellsAreTheReportsOwn) {
    const std::vector<ReplayFrame> list = frames(3, 4, 20, 3);
    const std::vector<Row> rows = parse(csvOf(list));
    ASSERT_EQ(rows.size(), 60u);
    for (size_t i = 0; i < rows.size(); ++i) {
        const ReplayFrame& f = list[i / 3];
        const size_t c = i % 3;
        const cache::CascadeStatistics& s = f.report.cascades[c];
        const Row& row = rows[i];
        EXPECT_EQ(row.at("frame"), std::to_string(f.number));
        EXPECT_EQ(std::stod(row.at("time")), f.report.time);  // shortest text reads back exactly
        EXPECT_EQ(row.at("cascade"), std::to_string(c));
        EXPECT_EQ(row.at("window_x"), std::to_string(s.window.x));
        EXPECT_EQ(row.at("move_y"), std::to_string(s.move.y));
        EXPECT_EQ(row.at("scroll_triangles"),
                  std::to_string(s.byCause[size_t(cache::Cause::kScroll)].triangles));
        EXPECT_EQ(row.at("promotion_draws"),
                  std::to_string(s.byCause[size_t(cache::Cause::kPromotion)].draws));
        EXPECT_EQ(row.at("active_texels"), std::to_string(s.active.texels));
        EXPECT_EQ(row.at("redraw_casters"), std::to_string(f.redraw[c].casters));
        EXPECT_EQ(row.at("clusters_hidden"), std::to_string(s.clustersHidden));
        EXPECT_EQ(row.at("triangles_hidden"), std::to_string(s.trianglesHidden));
        EXPECT_EQ(row.at("asleep"), s.asleep ? "1" : "0");
        EXPECT_EQ(row.at("unknown_texels"), std::to_string(s.unknownTexels));
        EXPECT_EQ(row.at("oldest_debt"), std::to_string(s.oldestDebt));
        EXPECT_EQ(row.at("frame_limit_texels"), "") << "no limit";
        EXPECT_EQ(row.at("frame_chunk_arrivals"), std::to_string(f.report.chunkArrivals));
        EXPECT_EQ(std::stoull(row.at("plan_hash"), nullptr, 16), f.report.planHash);
        EXPECT_EQ(row.at("cache_hash").empty(), f.hashes.empty());
        if (!f.hashes.empty()) {
            EXPECT_EQ(std::stoull(row.at("working_hash"), nullptr, 16), f.hashes[c].working);
        }
        EXPECT_EQ(row.at("frame_verified_texels").empty(), !f.verify.has_value());
        EXPECT_EQ(row.at("t_redraw_static_ms").empty(), !f.verify.has_value());
        if (!f.report.submitted) {
            EXPECT_EQ(row.at("t_gpu_static_ms"), "0.0000");
        }
    }
}

TEST(FramesCsv, OnlyTimesDifferBetweenRuns) {
    const std::vector<Row> one = parse(csvOf(frames(5, 6, 30, 2)));
    const std::vector<Row> two = parse(csvOf(frames(5, 7, 30, 2)));
    ASSERT_EQ(one.size(), two.size());
    bool timesDiffer = false;
    for (size_t i = 0; i < one.size(); ++i) {
        for (const auto& [name, cell] : one[i]) {
            if (name.starts_with("t_"))
                timesDiffer |= cell != two[i].at(name);
            else
                EXPECT_EQ(cell, two[i].at(name)) << name;
        }
    }
    EXPECT_TRUE(timesDiffer);
    EXPECT_EQ(csvOf(frames(5, 6, 30, 2)), csvOf(frames(5, 6, 30, 2)));
}

TEST(FramesCsv, TimesComeLastAndNamesAreUnique) {
    const std::vector<FrameColumn> columns = tools::frameColumns();
    const auto isTime = [](const FrameColumn& c) { return c.name.starts_with("t_"); };
    EXPECT_TRUE(std::is_partitioned(columns.begin(), columns.end(), std::not_fn(isTime)));
    std::map<std::string, int> seen;
    for (const FrameColumn& column : columns) EXPECT_EQ(seen[column.name]++, 0) << column.name;
}

TEST(FramesCsv, NoFramesAndNoCascadesGiveNoRows) {
    EXPECT_EQ(csvOf({}), tools::csvHeader(tools::frameColumns()));
    EXPECT_EQ(csvOf(frames(8, 9, 3, 0)), tools::csvHeader(tools::frameColumns()));
}

// The documented list: the first cell of every table row of docs/columns.md that is a `name`.
TEST(FramesCsv, DocumentListsTheColumnsInOrder) {
    std::ifstream file(GNOMON_SOURCE_DIR "/docs/columns.md");
    ASSERT_TRUE(file) << "docs/columns.md";
    std::vector<std::string> documented, real;
    for (std::string line; std::getline(file, line);) {
        if (!line.starts_with("| `")) continue;
        documented.push_back(line.substr(3, line.find('`', 3) - 3));
    }
    for (const FrameColumn& column : tools::frameColumns()) real.push_back(column.name);
    EXPECT_EQ(documented, real);
}

}  // namespace
