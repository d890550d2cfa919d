// tests/tools/report_test.cpp — planted regressions are found with their cause, caster and place; a run against itself has
// none; rules, exports and pages say what the frames say.
#include <gtest/gtest.h>
#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>

#include "tests/server/worlds.h"
#include "tests/tools/page_data.h"
#include "tests/tools/synthetic_frames.h"
#include "tests/world/random_world.h"
#include "tools/input_hash.h"
#include "tools/report/apng.h"
#include "tools/report/difference.h"
#include "tools/report/exports.h"
#include "tools/report/gate.h"
#include "tools/report/overview.h"
#include "tools/report/page.h"
#include "tools/results_store.h"

namespace {

using tools::ReplayFrame;
using tools::report::Difference;
using tools::report::RunFile;

const auto kQuiet = [](size_t, size_t) {};

/// A walk of 120 m along x; maps reach 40 m, so what stands ahead comes by scrolling.
std::vector<world::Pose> walk() {
    std::vector<world::Pose> poses;
    for (int k = 0; k < 120; ++k) poses.push_back({double(k) / 30, {-70.0 + k, 2, 4}, {1, 0, 0, 0}});
    return poses;
}

struct Played {
    std::string csv;
    std::vector<ReplayFrame> frames;
};

server::ShadowConfig small() {
    server::ShadowConfig config;
    config.cascades = 3;
    config.side = 256;
    config.farDistance = 40;
    config.geometryBytes = 64 << 20;
    return config;
}

/// Plays the poses and adds the run to the file.
Played play(const world::WorldStore& store, const std::string& file, const std::vector<world::Pose>& poses,
            const server::ShadowConfig& config = small()) {
    auto system = server::ShadowSystem::create(tests::validatedDevice(), store, config);
    EXPECT_TRUE(system);
    auto record = tools::beginRecord("replay", store, "streets.world", tests::validatedDevice());
    record.value().pathHash = tools::hexOf(tools::hashPoses(poses, 0));
    auto results = tools::ResultsStore::open(file);
    EXPECT_TRUE(results) << results.error().what;
    tools::ReplayInput input;
    input.poses = poses;
    input.verifyEvery = 40;
    input.dearest = true;
    Played played;
    const auto columns = tools::frameColumns();
    played.csv = tools::csvHeader(columns);
    tools::Summary summary;
    const auto done = tools::replay(*system.value(), input, nullptr, nullptr, [&](const ReplayFrame& frame) {
        summary.add(frame);
        played.csv += tools::csvRows(columns, frame);
        played.frames.push_back(frame);
        return results.value().add(frame);
    });
    EXPECT_TRUE(done) << done.error().what;
    tools::ReplayHead head;
    head.config = system.value()->config();
    for (int c = 0; c < system.value()->cascades(); ++c) {
        head.texels.push_back(system.value()->view(c).texel);
        head.splits.push_back(system.value()->view(c).split);
    }
    tools::endRecord(record.value(), head, summary);
    EXPECT_TRUE(results.value().commit(record.value()));
    return played;
}

const world::WorldStore& streets() {
    static const world::WorldStore store = tests::baked(tests::streets(glm::dvec3(0)), "streets.world");
    return store;
}

/// One run of the streets, for all that only read it.
struct Base {
    std::string file = tests::temporary("base.sqlite");
    Played played = play(streets(), file, walk());
};
const Base& base() {
    static const Base made;
    return made;
}

RunFile open(const std::string& word) {
    auto run = RunFile::open(word);
    EXPECT_TRUE(run) << run.error().what;
    return std::move(run.value());
}

Difference differenceOf(const std::string& a, const std::string& b) {
    RunFile before = open(a), after = open(b);
    auto difference = tools::report::compare(before, after, kQuiet);
    EXPECT_TRUE(difference) << difference.error().what;
    return std::move(difference.value());
}

TEST(ReportDifference, ARunAgainstItselfHasNone) {
    const Difference d = differenceOf(base().file, base().file);
    EXPECT_EQ(d.frames, 120u);
    EXPECT_EQ(d.differing, 0u);
    EXPECT_TRUE(d.inputs.empty() && d.counters.empty() && d.causes.empty() && d.places.empty() && d.casters.empty() && d.look.empty());
    EXPECT_NE(tools::report::toText(d).find("Nothing differs"), std::string::npos);
}

TEST(ReportDifference, AnotherRunOfTheSameHasNoneButTimesWithAnInterval) {
    const std::string file = tests::temporary("again.sqlite");
    for (int k = 0; k < 3; ++k) play(streets(), file, walk());
    const Difference d = differenceOf(file + "#1", file + "#3");
    EXPECT_EQ(d.differing, 0u);
    EXPECT_TRUE(d.inputs.empty());
    ASSERT_FALSE(d.times.empty());
    for (const auto& time : d.times) {
        EXPECT_EQ(time.runsA, 3u);
        ASSERT_TRUE(time.half) << time.name;
        EXPECT_LE(std::abs(time.mean.change()), *time.half) << time.name;
    }
}

TEST(ReportDifference, FindsTheCasterThatGrewAndWhereItCosts) {
    world::BakeSource source = tests::streets(glm::dvec3(0));
    world::Mesh heavy = tests::sheetMesh(2, 25);  // 1,250 triangles instead of a box's 12
    for (world::MeshLevel& level : heavy.levels) level.clusters.clear();
    source.meshes.push_back(std::move(heavy));
    const auto make = source.make;
    source.make = [make](world::ChunkKey key) {
        auto chunk = make(key);
        if (key == world::ChunkKey{2, 0, 0}) chunk.value().instances[4].mesh = 4;
        return chunk;
    };
    source.contents = 1;
    const std::string file = tests::temporary("heavy.sqlite");
    const Played played = play(tests::baked(source, "heavy.world"), file, walk());
    const Difference d = differenceOf(base().file, file);
    ASSERT_EQ(d.inputs.size(), 1u);
    EXPECT_EQ(d.inputs[0].name, "world's content");
    ASSERT_FALSE(d.causes.empty());
    EXPECT_EQ(d.causes[0].name, "scroll");
    EXPECT_GT(d.causes[0].triangles.change(), 1000);
    ASSERT_FALSE(d.casters.empty());
    EXPECT_TRUE(d.casters[0].name.starts_with("instance 4 of chunk (2,0,0) at (")) << d.casters[0].name;
    double byCaster = 0, byCause = 0;
    for (const auto& change : d.casters) byCaster += change.triangles.change();
    for (const auto& change : d.causes) byCause += change.triangles.change();
    EXPECT_EQ(byCaster, byCause) << "no caster is missing";
    ASSERT_FALSE(d.look.empty());
    // The frames to look at are those that drew it, and the place is where the eye was then.
    const ReplayFrame& dear = played.frames[d.look[0]];
    EXPECT_EQ(dear.dearest[0].name, "instance 4 of chunk (2,0,0)");
    ASSERT_FALSE(d.places.empty());
    char place[64];
    std::snprintf(place, sizeof place, "around (%.0f, 16)", std::floor(dear.eye.x / 32) * 32 + 16);
    EXPECT_TRUE(std::any_of(d.places.begin(), d.places.begin() + 1, [&](const auto& p) { return p.name == place; })) << d.places[0].name << " " << place;
    EXPECT_NE(std::find(d.places[0].frames.begin(), d.places[0].frames.end(), d.look[0]), d.places[0].frames.end());
    EXPECT_NE(tools::report::toText(d).find("instance 4 of chunk (2,0,0)"), std::string::npos);
}

TEST(ReportDifference, TellsThatOcclusionIsOff) {
    server::ShadowConfig config = small();
    config.occlusion = false;
    const std::string file = tests::temporary("open.sqlite");
    play(streets(), file, walk(), config);
    const Difference d = differenceOf(base().file, file);
    ASSERT_EQ(d.inputs.size(), 1u);
    EXPECT_EQ(d.inputs[0].name, "occlusion");
    EXPECT_EQ(d.inputs[0].b, "\"off\"");
    const auto hidden = std::find_if(d.counters.begin(), d.counters.end(), [](const auto& c) { return c.first == "triangles_hidden"; });
    ASSERT_NE(hidden, d.counters.end());
    EXPECT_GT(hidden->second.a, 0);
    EXPECT_EQ(hidden->second.b, 0);
    ASSERT_FALSE(d.causes.empty());
    EXPECT_GT(d.causes[0].triangles.change(), 0);
    EXPECT_FALSE(d.places.empty());
}

TEST(ReportDifference, TellsThatChunksAreOfAnotherSize) {
    world::BakeSource source = tests::streets(glm::dvec3(0));
    source.header.chunkSize = 32;
    source.contents = 2;
    source.chunks.clear();
    for (int x = -3; x < 3; ++x)
        for (int z = -3; z < 3; ++z) source.chunks.push_back({x, 0, z});
    const auto make = source.make;
    source.make = [make](world::ChunkKey key) -> world::Result<world::SourceChunk> {
        world::SourceChunk all;
        for (int k = 0; k < 4; ++k) {
            auto chunk = make({key.x * 2 + k / 2, 0, key.z * 2 + k % 2});
            std::move(chunk.value().instances.begin(), chunk.value().instances.end(), std::back_inserter(all.instances));
            std::move(chunk.value().names.begin(), chunk.value().names.end(), std::back_inserter(all.names));
        }
        return all;
    };
    const std::string file = tests::temporary("large.sqlite");
    play(tests::baked(source, "large.world"), file, walk());
    const Difference d = differenceOf(base().file, file);
    const auto size = std::find_if(d.inputs.begin(), d.inputs.end(), [](const auto& i) { return i.name == "chunk size"; });
    ASSERT_NE(size, d.inputs.end());
    EXPECT_EQ(size->a + " " + size->b, "16 m 32 m");
    EXPECT_TRUE(std::any_of(d.counters.begin(), d.counters.end(), [](const auto& c) { return c.first == "frame_chunk_arrivals"; }));
    EXPECT_GT(d.differing, 0u);
}

TEST(ReportDifference, SaysWhyRunsCannotBeCompared) {
    const std::string file = tests::temporary("other.sqlite");
    std::vector<world::Pose> poses = walk();
    poses[50].position.x += 1;
    play(streets(), file, poses);
    poses.pop_back();
    play(streets(), file, poses);
    for (const auto& [word, why] : {std::pair(file + "#1", "other paths"), std::pair(file + "#2", "119")}) {
        RunFile before = open(base().file), after = open(word);
        const auto difference = tools::report::compare(before, after, kQuiet);
        ASSERT_FALSE(difference);
        EXPECT_EQ(difference.error().code, world::ErrorCode::kUsage);
        EXPECT_NE(difference.error().what.find(why), std::string::npos) << difference.error().what;
    }
}

TEST(ReportGate, JudgesStatisticsAgainstNumbersAndTheRunBefore) {
    RunFile run = open(base().file);
    const auto rules = tools::report::readRules("triangles.sum <= 1.0x ; redraw_triangles.max > 10\n# a remark\nscroll_texels.p50 < 0;ms.mean>=0", run.columns());
    ASSERT_TRUE(rules) << rules.error().what;
    RunFile before = open(base().file);
    const auto verdicts = tools::report::judge(rules.value(), run, &before);
    ASSERT_TRUE(verdicts) << verdicts.error().what;
    ASSERT_EQ(verdicts.value().size(), 4u);
    double triangles = 0;
    for (const ReplayFrame& frame : base().played.frames)
        for (const auto& cascade : frame.report.cascades) triangles += double(cascade.total.triangles);
    EXPECT_EQ(verdicts.value()[0].value, triangles);
    EXPECT_EQ(verdicts.value()[0].limit, triangles);
    EXPECT_TRUE(verdicts.value()[0].kept);
    EXPECT_TRUE(verdicts.value()[1].kept);
    EXPECT_FALSE(verdicts.value()[2].kept);
    EXPECT_TRUE(verdicts.value()[3].kept);
    EXPECT_EQ(tools::report::judge(rules.value(), run, nullptr).error().code, world::ErrorCode::kUsage);
}

TEST(ReportGate, NamesWhatIsWrongWithARule) {
    const auto columns = tools::resultColumns();
    const world_tests::TempFolder folder;
    const std::string file = folder.file("rules.txt");
    world_tests::writeFile(file, "triangles.p99 <= 5\n\ntriangels.p99 <= 5\n");
    for (const auto& [text, word] : std::vector<std::pair<std::string, std::string>>{
             {"triangels.p99 <= 5", "nearest is triangles"}, {"scrol_texels.p99 <= 5", "nearest is scroll_texels"}, {"triangles.p98 <= 5", "nearest is p9"},
             {"triangles <= 5", "no rule"}, {"triangles.p99 <= five", "five is no number"}, {"triangles.p99 <= 5y", "no number"},
             {"triangles.p99 = 5", "no rule"}, {"plan_hash.max == 5", "no column plan_hash"}, {std::string(1000000, 'x') + ".max == 5", "no rule"}, {"", "holds no rule"}, {file, "rules.txt:3"}}) {
        const auto rules = tools::report::readRules(text, columns);
        ASSERT_FALSE(rules) << text;
        EXPECT_EQ(rules.error().code, world::ErrorCode::kUsage);
        EXPECT_NE(rules.error().what.find(word), std::string::npos) << rules.error().what;
    }
}

TEST(ReportMetric, QuantilesAreNearestRanks) {
    tools::report::Distribution d;
    EXPECT_EQ(d.quantile(0.5), 0);
    for (int k = 100; k >= 1; --k) d.add(k);
    d.add(std::nan(""));
    EXPECT_EQ(d.count(), 100u);
    EXPECT_EQ(d.quantile(0), 1);
    EXPECT_EQ(d.quantile(0.5), 50);
    EXPECT_EQ(d.quantile(0.99), 99);
    EXPECT_EQ(d.quantile(1), 100);
}

TEST(ReportExport, CsvIsTheReplaysOwn) {
    RunFile run = open(base().file);
    std::ostringstream out;
    ASSERT_TRUE(tools::report::writeCsv(run, out, kQuiet));
    EXPECT_EQ(out.str(), base().played.csv);
}

TEST(ReportExport, BenchmarkJsonHoldsTimesAndCounts) {
    RunFile run = open(base().file);
    const auto text = tools::report::benchmarkJson(run, kQuiet);
    ASSERT_TRUE(text);
    const auto json = nlohmann::json::parse(text.value());
    ASSERT_TRUE(json["benchmarks"].is_array());
    const auto frame = std::find_if(json["benchmarks"].begin(), json["benchmarks"].end(), [](const auto& b) { return b["name"] == "replay/t_frame_ms"; });
    ASSERT_NE(frame, json["benchmarks"].end());
    EXPECT_EQ((*frame)["iterations"], 120);
    EXPECT_EQ((*frame)["time_unit"], "ms");
    double triangles = 0;
    for (const ReplayFrame& f : base().played.frames)
        for (const auto& cascade : f.report.cascades) triangles += double(cascade.total.triangles);
    EXPECT_DOUBLE_EQ((*frame)["static_triangles"].get<double>(), triangles / 120);
}

TEST(ReportExport, SlicesOfTheTimelineNestStrictly) {
    RunFile run = open(base().file);
    const std::string path = tests::temporary("timeline.json.gz");
    ASSERT_TRUE(tools::report::writeTimeline(run, path, kQuiet));
    gzFile file = gzopen(path.c_str(), "rb");
    ASSERT_TRUE(file);
    std::string text(64 << 20, '\0');
    text.resize(size_t(gzread(file, text.data(), unsigned(text.size()))));
    gzclose(file);
    const auto json = nlohmann::json::parse(text, nullptr, false);
    ASSERT_TRUE(json.is_object());
    std::map<int, std::vector<std::pair<double, double>>> slices;  // begin and end, by track
    size_t frames = 0, deep = 0, reads = 0, readsInFrames = 0;
    std::vector<std::pair<double, double>> ofFrames;
    for (const auto& event : json["traceEvents"]) {
        if (event["ph"] != "X") continue;
        const double begin = event["ts"], end = begin + event["dur"].get<double>();
        slices[event["tid"]].emplace_back(begin, end);
        const std::string name = event["name"];
        if (event["tid"] == 1 && name.starts_with("frame ")) {
            ++frames;
            ofFrames.emplace_back(begin, end);
        }
        if (event["tid"] < 3) continue;
        ++reads;
        EXPECT_TRUE(name.starts_with("chunk (") || name.starts_with("mesh ")) << name;
        // In lock-step they lie within their frame, whose begin is rounded to 0.1 microseconds.
        readsInFrames += begin >= ofFrames.back().first - 0.1 && end <= ofFrames.back().second + 0.1 ? 1 : 0;
    }
    for (auto& [track, list] : slices) {
        std::sort(list.begin(), list.end(), [](const auto& a, const auto& b) { return std::pair(a.first, -a.second) < std::pair(b.first, -b.second); });
        std::vector<std::pair<double, double>> open;
        for (const auto& [begin, end] : list) {
            // A nanosecond: sums of times are rounded.
            while (!open.empty() && open.back().second <= begin + 1e-3) open.pop_back();
            if (!open.empty()) {
                ASSERT_LE(end, open.back().second + 1e-3) << "track " << track;
                ++deep;
            }
            open.emplace_back(begin, end);
        }
    }
    EXPECT_EQ(frames, 120u);
    size_t read = 0;
    for (const ReplayFrame& f : base().played.frames) read += f.report.reads.size();
    EXPECT_GT(read, 0u);
    EXPECT_EQ(reads, read);
    EXPECT_EQ(readsInFrames, read);
    EXPECT_GT(deep, 200u);
    EXPECT_FALSE(tools::report::writeTimeline(run, tests::temporary("no/such.json.gz"), kQuiet));
}

TEST(ReportExport, AnAnimationHoldsEachPicture) {
    std::vector<std::vector<std::byte>> pngs;
    std::vector<tools::RgbImage> images;
    for (uint8_t k = 0; k < 3; ++k) {
        images.push_back({4, 2, std::vector<uint8_t>(24, uint8_t(40 * k))});
        pngs.push_back(tools::pngOf(images.back()).value());
    }
    const auto bytes = tools::report::animated(pngs, 0.5);
    ASSERT_TRUE(bytes);
    // Any program shows the first picture.
    EXPECT_EQ(tools::imageOf(bytes.value()).value().pixels, images[0].pixels);
    std::vector<std::string> types;
    std::vector<std::byte> last{pngs[2].begin(), pngs[2].begin() + 33};  // signature and head
    uint32_t sequence = 0;
    for (size_t at = 8; at < bytes.value().size();) {
        const auto* p = reinterpret_cast<const unsigned char*>(bytes.value().data()) + at;
        const auto number = [&](size_t k) { return uint32_t(p[k]) << 24 | uint32_t(p[k + 1]) << 16 | uint32_t(p[k + 2]) << 8 | p[k + 3]; };
        const uint32_t size = number(0);
        types.emplace_back(reinterpret_cast<const char*>(p + 4), 4);
        ASSERT_EQ(number(8 + size), uint32_t(crc32(0, p + 4, 4 + size))) << types.back();
        if (types.back() == "acTL") { EXPECT_EQ(number(8), 3u); }
        if (types.back() == "fcTL" || types.back() == "fdAT") { EXPECT_EQ(number(8), sequence++); }
        at += 12 + size;
    }
    EXPECT_EQ(types, (std::vector<std::string>{"IHDR", "acTL", "fcTL", "IDAT", "fcTL", "fdAT", "fcTL", "fdAT", "IEND"}));
    EXPECT_FALSE(tools::report::animated({}, 0.5));
    EXPECT_FALSE(tools::report::animated({pngs[0], tools::pngOf({2, 4, std::vector<uint8_t>(24, 1)}).value()}, 0.5));
    for (size_t size = 0; size < pngs[0].size(); ++size)
        EXPECT_FALSE(tools::report::animated({{pngs[0].begin(), pngs[0].begin() + ptrdiff_t(size)}}, 0.5)) << size;
}

TEST(ReportPage, ShowsWhatTheFramesSay) {
    std::vector<RunFile> runs;
    runs.push_back(open(base().file));
    const auto page = tools::report::reportPage(runs, kQuiet);
    ASSERT_TRUE(page) << page.error().what;
    const auto run = tools_test::dataOf(page.value().html)["runs"][0];
    ASSERT_TRUE(run.is_object());
    EXPECT_EQ(run["series"]["share"], 1);
    ASSERT_EQ(run["series"]["first"].size(), 120u);
    double scroll = 0, all = 0, redraw = 0;
    uint64_t most = 0;
    for (size_t k = 0; k < 120; ++k) {
        const ReplayFrame& f = base().played.frames[k];
        uint64_t ofScroll = 0, ofFrame = 0;
        for (size_t c = 0; c < 3; ++c) {
            ofScroll += f.report.cascades[c].byCause[size_t(cache::Cause::kScroll)].triangles;
            ofFrame += f.report.cascades[c].total.triangles;
            redraw += double(f.redraw[c].triangles);
        }
        EXPECT_EQ(run["series"]["triangles"]["scroll"][k], ofScroll);
        EXPECT_EQ(run["series"]["most"][k], ofFrame);
        EXPECT_EQ(run["series"]["frames"][k]["n"], k);
        EXPECT_NEAR(run["series"]["frames"][k]["eye"][0].get<double>(), f.eye.x, 1e-3);
        scroll += double(ofScroll);
        all += double(ofFrame);
        most = std::max(most, ofFrame);
    }
    EXPECT_GT(scroll, 0);
    EXPECT_EQ(run["sums"]["static_triangles"].get<double>(), all);
    EXPECT_EQ(run["sums"]["redraw_triangles"].get<double>(), redraw);
    ASSERT_EQ(page.value().unpictured.size(), 1u);
    EXPECT_EQ(page.value().unpictured[0].second.size(), run["dearest"].size());
    double ofDearest = 0;
    for (const auto& [cause, cost] : run["dearest"][0]["causes"].items()) ofDearest += cost[2].get<double>();
    EXPECT_EQ(ofDearest, double(most));
    for (size_t a = 0; a < run["dearest"].size(); ++a)
        for (size_t b = 0; b < a; ++b)
            EXPECT_GE(std::abs(run["dearest"][a]["t"].get<double>() - run["dearest"][b]["t"].get<double>()), tools::report::kApart - 1e-9);
    // Again the same, and nothing is asked for from anywhere.
    EXPECT_EQ(tools::report::reportPage(runs, kQuiet).value().html, page.value().html);
    EXPECT_EQ(page.value().html.find("src=\"http"), std::string::npos);
    EXPECT_NE(page.value().html.find("default-src 'none'"), std::string::npos);
}

TEST(ReportPage, LongRunsShareTheirPoints) {
    const world_tests::TempFolder folder;
    const std::string file = folder.file("long.sqlite");
    constexpr uint64_t kFrames = 9001;
    uint64_t triangles = 0;
    {
        auto store = tools::ResultsStore::open(file);
        std::mt19937 rng(1), noise(2);
        for (uint64_t k = 0; k < kFrames; ++k) {
            const ReplayFrame frame = tools_test::randomFrame(rng, noise, k, 2);
            for (const auto& c : frame.report.cascades) triangles += c.total.triangles;
            ASSERT_TRUE(store.value().add(frame));
        }
        tools::RunRecord record;
        record.kind = "replay";
        record.world = "</script><b>\xff";  // may be any bytes
        record.settings = "{}";
        record.summary = "not json";
        record.frames = kFrames;
        ASSERT_TRUE(store.value().commit(record));
    }
    std::vector<RunFile> runs;
    runs.push_back(open(file));
    const auto page = tools::report::reportPage(runs, kQuiet);
    ASSERT_TRUE(page);
    const auto run = tools_test::dataOf(page.value().html)["runs"][0];
    ASSERT_TRUE(run.is_object());
    const auto share = run["series"]["share"].get<uint64_t>();
    EXPECT_EQ(share, 5u);
    const size_t points = (kFrames + share - 1) / share;
    EXPECT_LE(points, tools::report::kPoints);
    ASSERT_EQ(run["series"]["first"].size(), points);
    EXPECT_EQ(run["series"]["first"][1], share);
    // Means stand for all frames, but for their rounding to whole triangles.
    double sum = 0;
    for (const auto& [cause, values] : run["series"]["triangles"].items())
        for (size_t k = 0; k < points; ++k) sum += values[k].get<double>() * double(std::min(share, kFrames - k * share));
    EXPECT_NEAR(sum, double(triangles), 0.5 * double(kFrames) * cache::kCauses);
    EXPECT_LT(page.value().html.size(), 8u << 20);
}

}  // namespace
