// tests/tools/results_store_test.cpp — runs come back as they were added, whole or not at all, in bounded memory; files that
// are something else are refused and left alone.
#include "tools/results_store.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <unistd.h>

#include "tests/tools/lab_records.h"
#include "tests/tools/synthetic_frames.h"
#include "tests/world/random_world.h"
#include "tools/database_row.h"
#include "tools/report/metric.h"
#include "tools/report/run_file.h"
#include "tools/sweep/merge.h"

namespace {

using tools::ReplayFrame;
using tools::ResultsStore;
using tools::RunRecord;
using tools::report::FrameRow;
using tools::report::RunFile;

RunRecord madeUpRun(const std::string& name = "") {
    RunRecord run;
    run.kind = "replay";
    run.name = name;
    run.world = "made up \xff.world";
    run.worldHash = "0123456789abcdef";
    run.source = "procedural:7";
    run.chunkSize = 64;
    run.path = "walk.tum";
    run.pathHash = "fedcba9876543210";
    run.settings = R"({"cascades":3})";
    run.frames = 40;
    run.device = "a device";
    run.threads = 2;
    run.summary = "{}";
    run.started = "2026-01-31T12:00:00Z";
    run.wallSeconds = 1.5;
    return run;
}

ReplayFrame frameOf(std::mt19937& rng, std::mt19937& noise, uint64_t number, int cascades) {
    ReplayFrame frame = tools_test::randomFrame(rng, noise, number, cascades);
    frame.eye = {double(number), 2, -3.5};
    for (const server::SpotId light : {1, 2})
        frame.report.spots.push_back({light, {cache::Cause::kArrival, tools_test::randomCost(rng), tools_test::randomCost(rng)}});
    if (cascades > 0) frame.report.cascades[0].byCause[0] = {7, 0, 0, 0};  // cleared, and nothing drawn
    frame.dearest = {{"instance 3 of chunk (1,0,2)", {1, 2, 3}, 500, 4}, {"terrain of chunk (0,0,0)", {4, 5, 6}, 20, 1}};
    return frame;
}

std::vector<ReplayFrame> addFrames(ResultsStore& store, uint32_t noiseSeed, size_t count, int cascades) {
    std::mt19937 rng(1), noise(noiseSeed);
    std::vector<ReplayFrame> frames;
    for (size_t k = 0; k < count; ++k) {
        frames.push_back(frameOf(rng, noise, 10 + k, cascades));
        EXPECT_TRUE(store.add(frames.back()));
    }
    return frames;
}

std::vector<FrameRow> framesOf(const std::string& word) {
    auto run = RunFile::open(word);
    EXPECT_TRUE(run) << (run ? "" : run.error().what);
    std::vector<FrameRow> rows;
    if (!run) return rows;
    auto cursor = run.value().frames();
    EXPECT_TRUE(cursor);
    for (FrameRow row; cursor.value().next(row).value();) rows.push_back(row);
    return rows;
}

/// The cells of frames.csv by column, as numbers or texts; empty: none.
std::string cell(const tools::ResultColumn& column, const ReplayFrame& frame, size_t cascade) {
    std::string text;
    column.column.value(frame, cascade, text);
    return text;
}

void expectCells(const std::vector<tools::ResultColumn>& columns, const std::vector<double>& values,
                 const std::vector<std::string>& texts, const ReplayFrame& frame, size_t cascade) {
    ASSERT_EQ(values.size(), columns.size());
    size_t text = 0;
    for (size_t k = 0; k < columns.size(); ++k) {
        const std::string expected = cell(columns[k], frame, cascade);
        if (columns[k].text) {
            EXPECT_EQ(texts[text++], expected) << columns[k].column.name;
        } else if (expected.empty()) {
            EXPECT_TRUE(std::isnan(values[k])) << columns[k].column.name;
        } else {
            EXPECT_EQ(values[k], std::stod(expected)) << columns[k].column.name;
        }
    }
}

TEST(ResultsStore, FramesComeBackAsTheyWereAdded) {
    const world_tests::TempFolder folder;
    const std::string file = folder.file("r.sqlite");
    std::vector<ReplayFrame> frames;
    {
        auto store = ResultsStore::open(file);
        ASSERT_TRUE(store) << store.error().what;
        frames = addFrames(store.value(), 2, 600, 3);  // more than are kept before a commit of the temporary tables
        ASSERT_TRUE(store.value().add(tools::DumpedPicture{12, 1, {std::byte{1}, std::byte{2}}}));
        ASSERT_TRUE(store.value().add(tests::someMethod("one", 1)));
        ASSERT_TRUE(store.value().add(tests::someMethod("one", 1))) << "names may come twice";
        const auto number = store.value().commit(madeUpRun());
        ASSERT_TRUE(number) << number.error().what;
        EXPECT_EQ(number.value(), 1);
    }
    auto run = RunFile::open(file);
    ASSERT_TRUE(run) << run.error().what;
    EXPECT_EQ(run.value().name(), file + "#1");
    EXPECT_EQ(run.value().record().world, madeUpRun().world);
    EXPECT_EQ(run.value().record().wallSeconds, 1.5);
    EXPECT_EQ(run.value().record().key(), madeUpRun().key());
    const tools::ResultColumns columns = tools::resultColumns();
    const std::vector<FrameRow> rows = framesOf(file);
    ASSERT_EQ(rows.size(), frames.size());
    for (size_t k = 0; k < rows.size(); ++k) {
        EXPECT_EQ(rows[k].number, frames[k].number);
        EXPECT_EQ(rows[k].eye, frames[k].eye);
        const auto& spots = frames[k].report.spots;
        EXPECT_EQ(tools::report::metricOf("frame_spot_triangles", columns)(rows[k]), double(spots[0].cost.statics.triangles + spots[1].cost.statics.triangles));
        EXPECT_EQ(tools::report::metricOf("frame_spot_active_triangles", columns)(rows[k]), double(spots[0].cost.active.triangles + spots[1].cost.active.triangles));
        expectCells(columns.frame, rows[k].values, rows[k].texts, frames[k], 0);
        ASSERT_EQ(rows[k].cascades.size(), 3u);
        for (size_t c = 0; c < 3; ++c) {
            expectCells(columns.cascade, rows[k].cascades[c].values, rows[k].cascades[c].texts, frames[k], c);
            EXPECT_EQ(rows[k].cascades[c].byCause, frames[k].report.cascades[c].byCause);
        }
        ASSERT_EQ(rows[k].dearest.size(), 2u);
        EXPECT_EQ(rows[k].dearest[0].name, "instance 3 of chunk (1,0,2)");
        EXPECT_EQ(rows[k].dearest[1].pWorld, glm::dvec3(4, 5, 6));
        EXPECT_EQ(rows[k].dearest[0].triangles, 500u);
        const auto& reads = frames[k].report.reads;
        ASSERT_EQ(rows[k].reads.size(), reads.size());
        for (size_t i = 0; i < reads.size(); ++i) {
            EXPECT_EQ(rows[k].reads[i].name, reads[i].mesh ? "mesh " + std::to_string(*reads[i].mesh) : "chunk " + world::toString(reads[i].chunk));
            EXPECT_EQ(rows[k].reads[i].bytes, reads[i].bytes);
            EXPECT_EQ(rows[k].reads[i].thread, uint64_t(reads[i].times.thread));
            EXPECT_EQ(rows[k].reads[i].beginMs, tools::clockMs(reads[i].times.begin));
            EXPECT_NEAR(rows[k].reads[i].ms, tools::clockMs(reads[i].times.end) - tools::clockMs(reads[i].times.begin), 1e-9) << "sums are rounded";
        }
    }
    const auto sums = run.value().casterSums();
    ASSERT_TRUE(sums);
    ASSERT_EQ(sums.value().size(), 2u);
    EXPECT_EQ(sums.value()[0].name, "instance 3 of chunk (1,0,2)");
    EXPECT_EQ(sums.value()[0].triangles, 600u * 500);
    EXPECT_EQ(sums.value()[1].draws, 600u);
    EXPECT_EQ(run.value().pictures().value().size(), 1u);
    EXPECT_EQ(run.value().pictures().value()[0].png.size(), 2u);
    ASSERT_EQ(run.value().methods().value().size(), 2u);
    EXPECT_EQ(run.value().methods().value()[0].falseLit, tests::someMethod("one", 1).percent(tests::someMethod("one", 1).falseLit.all()));
}

TEST(ResultsStore, ARunThatDidNotEndIsNotThere) {
    const world_tests::TempFolder folder;
    const std::string file = folder.file("r.sqlite");
    {
        auto store = ResultsStore::open(file);
        ASSERT_TRUE(store);
        addFrames(store.value(), 2, 300, 2);
    }
    const auto none = RunFile::open(file);
    ASSERT_FALSE(none);
    EXPECT_EQ(none.error().code, world::ErrorCode::kNotFound);
    EXPECT_NE(none.error().what.find(file), std::string::npos);
    // Neither are its rows in the next one.
    auto store = ResultsStore::open(file);
    addFrames(store.value(), 2, 5, 2);
    ASSERT_TRUE(store.value().commit(madeUpRun("first")));
    addFrames(store.value(), 3, 7, 2);
    ASSERT_EQ(store.value().commit(madeUpRun("second")).value(), 2);
    EXPECT_EQ(framesOf(file + "#1").size(), 5u);
    EXPECT_EQ(framesOf(file).size(), 7u);
    EXPECT_EQ(folder.list(), std::vector<std::string>{"r.sqlite"}) << "one file, even while it is open";
}

TEST(ResultsStore, RunsUnderWaySideBySideDoNotWaitForEachOther) {
    const world_tests::TempFolder folder;
    const std::string file = folder.file("r.sqlite");
    auto one = ResultsStore::open(file), two = ResultsStore::open(file);
    ASSERT_TRUE(one && two);
    addFrames(one.value(), 2, 10, 2);
    addFrames(two.value(), 3, 20, 2);
    EXPECT_EQ(two.value().commit(madeUpRun()).value(), 1);
    EXPECT_EQ(one.value().commit(madeUpRun()).value(), 2);
    EXPECT_EQ(framesOf(file + "#1").size(), 20u);
    EXPECT_EQ(framesOf(file + "#2").size(), 10u);
    // Equal input: repetitions, whatever was measured.
    EXPECT_EQ(RunFile::open(file).value().repetitions().value(), (std::vector<std::string>{file + "#1", file + "#2"}));
    EXPECT_EQ(RunFile::open(file + "#7").error().code, world::ErrorCode::kNotFound);
}

TEST(ResultsStore, OnlyMeasuredColumnsDifferBetweenEqualRuns) {
    const world_tests::TempFolder folder;
    auto store = ResultsStore::open(folder.file("r.sqlite"));
    ASSERT_TRUE(store);
    for (const uint32_t noise : {5u, 6u}) {
        addFrames(store.value(), noise, 20, 2);
        ASSERT_TRUE(store.value().commit(madeUpRun()));
    }
    auto database = tools::openResults(folder.file("r.sqlite"));
    for (const std::string table : {"frame", "cascade", "cause", "caster"}) {
        auto columns = database.value().prepare(("SELECT name FROM pragma_table_info('" + table + "')").c_str());
        ASSERT_TRUE(columns);
        size_t measured = 0;
        while (columns.value().step().value()) {
            const std::string name = columns.value().text(0);
            if (name == "run") continue;
            const std::string key = table == "frame" ? "frame" : table == "caster" ? "frame, number" : table == "cause" ? "frame, cascade, cause" : "frame, cascade";
            const std::string sql = "SELECT count(*) FROM " + table + " a JOIN " + table + " b USING (" + key +
                                    ") WHERE a.run = 1 AND b.run = 2 AND " +
                                    (key.find(name) == std::string::npos ? "a." + name + " IS NOT b." + name : "0");
            const int64_t differ = tools::numberFrom(database.value(), sql.c_str()).value();
            if (name.starts_with("t_")) {
                measured += differ > 0 ? 1 : 0;
            } else {
                EXPECT_EQ(differ, 0) << table << "." << name;
            }
        }
        EXPECT_EQ(measured > 0, table == "frame" || table == "cascade") << table;
    }
}

TEST(ResultsStore, LongRunsTakeNoMoreMemory) {
    const auto resident = [] {
        std::ifstream statm("/proc/self/statm");
        size_t pages = 0, inMemory = 0;
        statm >> pages >> inMemory;
        return inMemory * size_t(getpagesize());
    };
    const world_tests::TempFolder folder;
    auto store = ResultsStore::open(folder.file("r.sqlite"));
    ASSERT_TRUE(store);
    std::mt19937 rng(1), noise(2);
    uint64_t number = 0;
    const auto add = [&](size_t count) {
        for (size_t k = 0; k < count; ++k) ASSERT_TRUE(store.value().add(frameOf(rng, noise, number++, 4)));
    };
    add(1000);
    const size_t before = resident();
    add(12000);
    ASSERT_TRUE(store.value().commit(madeUpRun()));
    EXPECT_GT(std::filesystem::file_size(folder.file("r.sqlite")), 12'000'000u);
    // Caches of pages of both databases are 2 MB each; the allocator may hold as much again.
    EXPECT_LT(resident(), before + (8u << 20));
}

TEST(ResultsStore, WhatIsNoResultsFileIsRefusedAndLeftAlone) {
    const world_tests::TempFolder folder;
    const std::string file = folder.file("r.sqlite");
    const auto refused = [&](const std::string& word) {
        const std::string before = world_tests::readFile(file);
        const auto store = ResultsStore::open(file);
        const auto run = RunFile::open(file);
        for (const world::Error* error : {store ? nullptr : &store.error(), run ? nullptr : &run.error()}) {
            ASSERT_NE(error, nullptr);
            EXPECT_EQ(error->code, world::ErrorCode::kBadData) << error->what;
            EXPECT_NE(error->what.find(file), std::string::npos) << error->what;
            EXPECT_NE(error->what.find(word), std::string::npos) << error->what;
        }
        EXPECT_EQ(world_tests::readFile(file), before);
    };
    world_tests::writeFile(file, std::string(4096, 'x'));
    refused("holds no results");
    std::filesystem::remove(file);
    world_tests::writeFile(file, "");
    ASSERT_TRUE(world::Database::openEmpty(file).value().run("CREATE TABLE mine(a)"));
    refused("holds no results");
    std::filesystem::remove(file);
    {
        auto store = ResultsStore::open(file);
        addFrames(store.value(), 1, 50, 2);
        ASSERT_TRUE(store.value().commit(madeUpRun()));
    }
    const std::string whole = world_tests::readFile(file);
    ASSERT_TRUE(world::Database::openEmpty(file).value().run("PRAGMA user_version=9"));
    refused("version 9, this program reads 2");
    EXPECT_EQ(ResultsStore::open(folder.file("")).error().code, world::ErrorCode::kIo);
    EXPECT_EQ(ResultsStore::open(folder.file("none/r.sqlite")).error().code, world::ErrorCode::kIo);
    EXPECT_EQ(RunFile::open(folder.file("none.sqlite")).error().code, world::ErrorCode::kNotFound);
    // Cut short anywhere, frames end in an error or the file is refused; nothing crashes.
    for (const size_t size : {size_t(1), size_t(100), size_t(4096), size_t(8192), whole.size() / 2, whole.size() - 4096}) {
        world_tests::writeFile(file, whole.substr(0, size));
        auto run = RunFile::open(file);
        if (!run) continue;
        auto cursor = run.value().frames();
        if (!cursor) continue;
        size_t rows = 0;
        FrameRow row;
        bool failed = false;
        for (;; ++rows) {
            const auto more = cursor.value().next(row);
            failed = !more;
            if (failed || !more.value()) break;
        }
        EXPECT_TRUE(failed) << size << " of " << whole.size() << " bytes gave " << rows << " frames";
    }
}

TEST(ResultsStore, SaysThatAFileIsLocked) {
    const world_tests::TempFolder folder;
    const std::string file = folder.file("r.sqlite");
    auto store = ResultsStore::open(file);
    ASSERT_TRUE(store);
    addFrames(store.value(), 1, 5, 2);
    auto other = world::Database::openEmpty(file);
    ASSERT_TRUE(other.value().run("BEGIN IMMEDIATE"));
    store.value().waitAtMost(100);
    const auto committed = store.value().commit(madeUpRun());
    ASSERT_FALSE(committed);
    EXPECT_EQ(committed.error().code, world::ErrorCode::kIo);
    EXPECT_NE(committed.error().what.find(file), std::string::npos);
    EXPECT_NE(committed.error().what.find("locked"), std::string::npos) << committed.error().what;
    ASSERT_TRUE(other.value().run("ROLLBACK"));
    EXPECT_EQ(store.value().commit(madeUpRun()).value(), 1) << "the rows are still there";
    EXPECT_EQ(framesOf(file).size(), 5u);
}

// docs/results.md: the columns of each table, in order; those of frames.csv stand in docs/columns.md.
TEST(ResultsStore, DocumentListsTablesAndColumns) {
    std::ifstream text(GNOMON_SOURCE_DIR "/docs/results.md");
    ASSERT_TRUE(text);
    std::map<std::string, std::vector<std::string>> documented;
    std::string table;
    for (std::string line; std::getline(text, line);) {
        if (line.starts_with("## ")) table = line.substr(3);
        if (line.starts_with("| `")) documented[table].push_back(line.substr(3, line.find('`', 3) - 3));
    }
    documented["cascade"] = {"run", "frame", "cascade"};
    const tools::ResultColumns columns = tools::resultColumns();
    for (const auto& c : columns.frame) documented["frame"].push_back(c.column.name);
    for (const auto& c : columns.cascade) documented["cascade"].push_back(c.column.name);
    const world_tests::TempFolder folder;
    ASSERT_TRUE(tools::sweep::merge({}, folder.file("r.sqlite"), [](size_t, size_t) {}));  // of no shards: all tables that there are
    auto database = tools::openResults(folder.file("r.sqlite"));
    ASSERT_TRUE(database);
    std::map<std::string, std::vector<std::string>> real;
    auto names = database.value().prepare("SELECT m.name, c.name FROM sqlite_schema m JOIN pragma_table_info(m.name) c WHERE m.type = 'table' ORDER BY m.name, c.cid");
    while (names.value().step().value()) real[names.value().text(0)].push_back(names.value().text(1));
    EXPECT_EQ(documented, real);
}

}  // namespace
