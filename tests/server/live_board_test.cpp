// What sessions publish: seen by watchers once and whole, bounded, cheap where nobody looks, and safe while sessions and
// watchers come and go. And what monitors read of it.
#include "server/live_board.h"

#include <algorithm>
#include <atomic>
#include <mutex>
#include <set>
#include <sstream>
#include <thread>

#include "server/live_json.h"
#include "server/live_site.h"
#include "server/metrics.h"
#include "tests/server/worlds.h"

namespace {

using server::FrameInput;
using server::FrameReport;
using server::LiveBoard;
using server::LiveNews;
using server::LiveSession;
using server::ShadowConfig;
using server::ShadowSystem;
using tests::systemOn;

ShadowConfig boardConfig() {
    ShadowConfig config;
    config.cascades = 3;
    config.side = 128;
    config.farDistance = 45;
    config.geometryBytes = 16 << 20;
    return config;
}

/// Advances by one frame and publishes it.
FrameReport step(ShadowSystem& system, LiveSession& live, double time, glm::dvec3 eye) {
    FrameInput input;
    input.time = time;
    input.camera.position = eye;
    auto report = system.advance(input);
    if (!report) throw std::runtime_error(report.error().what);
    if (auto done = system.finish(report.value()); !done) throw std::runtime_error(done.error().what);
    live.publish(system, input, report.value(), 1.5);
    return std::move(report.value());
}

TEST(LiveBoard, TellsEachFrameOnceAndAddsUp) {
    const auto store = tests::baked(tests::streets({0, 0, 0}), "board.world");
    const auto system = systemOn(store, boardConfig());
    LiveBoard board;
    LiveSession live = board.open("walk", "streets");
    uint64_t seen = 0, told = 0;
    std::array<cache::Cost, cache::kCauses> sums{};
    for (int i = 0; i < 40; ++i) {
        const FrameReport report = step(*system, live, i * 0.1, {i * 0.7, 2, 0});
        for (const auto& cascade : report.cascades)
            for (size_t c = 0; c < sums.size(); ++c) sums[c] += cascade.byCause[c];
        if (i % 3 != 0) continue;
        const auto news = board.news(live.id(), seen);
        ASSERT_TRUE(news);
        for (const server::LiveFrame& frame : news->frames) {
            ASSERT_EQ(frame.number, ++told);
            EXPECT_EQ(frame.frame + 1, frame.number);
        }
        seen = news->frames.back().number;
        EXPECT_EQ(news->lost, 0u);
    }
    EXPECT_EQ(told, 40u);
    const server::LiveTotals totals = board.totals();
    EXPECT_EQ(totals.frames, 40u);
    EXPECT_EQ(totals.byCause, sums);
    EXPECT_GT(sums[size_t(cache::Cause::kScroll)].texels, 0u);
    EXPECT_EQ(totals.frameTimes[2], 40u);  // 1.5 ms: above 1 and at most 2
    tests::expectSilence();
}

/// The rectangles that are told are those that the frame drew: as much area for each cause as it counted.
void expectMarksAddUp(const world::WorldStore& store, uint64_t budget) {
    ShadowConfig config = boardConfig();
    config.budget.texels = budget;
    const auto system = systemOn(store, config);
    const auto box = system->adopt("box (0,0,0) 1");
    ASSERT_TRUE(box);
    LiveBoard board;
    LiveSession live = board.open("walk", "streets");
    ASSERT_TRUE(board.news(live.id(), 0));  // somebody watches
    for (int i = 0; i < 30; ++i) {
        if (i == 20) {
            ASSERT_TRUE(system->remove(box.value()));
        }
        const FrameReport report = step(*system, live, i * 0.1, {i * 0.7, 2, 0});
        std::array<uint64_t, cache::kCauses> counted{}, marked{};
        for (const auto& cascade : report.cascades)
            for (size_t c = 0; c < counted.size(); ++c) counted[c] += cascade.byCause[c].texels;
        const auto news = board.news(live.id(), uint64_t(i));
        ASSERT_TRUE(news);
        for (const server::LiveMark& mark : news->marks) {
            const server::LiveCascade& cascade = news->cascades[size_t(mark.cascade)];
            const cache::TexelRect window{cascade.window, cascade.window + int64_t(128)};
            EXPECT_TRUE(window.contains(mark.rect)) << "frame " << i;
            if (mark.cause) marked[size_t(*mark.cause)] += uint64_t(mark.rect.area());
        }
        EXPECT_EQ(marked, counted) << "frame " << i;
        if (i == 20) {
            EXPECT_GT(marked[size_t(cache::Cause::kDeparture)], 0u);
        }
    }
}

TEST(LiveBoard, MarksWhatWasDrawnByCause) {
    const auto store = tests::baked(tests::streets({0, 0, 0}), "marks.world");
    for (const uint64_t budget : {cache::Limits::kNone, uint64_t{20000}}) {
        SCOPED_TRACE(budget);
        expectMarksAddUp(store, budget);
    }
    tests::expectSilence();
}

TEST(LiveBoard, ForgetsWhatIsOldAndSaysSo) {
    const auto store = tests::baked(tests::streets({0, 0, 0}), "bound.world");
    const auto system = systemOn(store, boardConfig());
    LiveBoard board;
    LiveSession live = board.open("long", "streets");
    const size_t frames = server::kLiveFrames + 50;
    for (size_t i = 0; i < frames; ++i) {
        ASSERT_TRUE(board.news(live.id(), i));  // watched throughout
        step(*system, live, double(i) * 0.1, {std::sin(double(i)) * 9, 2, 0});
    }
    const auto news = board.news(live.id(), 0);
    ASSERT_TRUE(news);
    EXPECT_EQ(news->frames.size(), server::kLiveFrames);
    EXPECT_EQ(news->lost, 50u);
    EXPECT_LE(news->marks.size(), server::kLiveMarks);
    EXPECT_EQ(news->frames.back().number, frames);
    // A watcher of another life of the process knows of frames that never were: it is told from the start.
    EXPECT_EQ(board.news(live.id(), frames + 7)->frames.size(), server::kLiveFrames);
}

/// Nothing dear is made for a session that nobody asks for.
TEST(LiveBoard, MakesPicturesForWatchersAlone) {
    const auto store = tests::baked(tests::streets({0, 0, 0}), "pictures.world");
    const auto system = systemOn(store, boardConfig());
    LiveBoard board;
    LiveSession live = board.open("still", "streets");
    for (int i = 0; i < 10; ++i) step(*system, live, i, {0, 2, 0});
    const auto before = board.news(live.id(), 0);
    ASSERT_TRUE(before);
    EXPECT_TRUE(before->cascades.empty());
    EXPECT_FALSE(before->chunks);
    EXPECT_FALSE(board.picture(live.id(), 0));
    for (int i = 10; i < 400 && !board.picture(live.id(), 2); ++i) {
        step(*system, live, i, {0, 2, 0});
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    const auto after = board.news(live.id(), 0);
    ASSERT_TRUE(after && after->chunks && after->settings);
    EXPECT_EQ(after->cascades.size(), 3u);
    EXPECT_EQ(size_t(std::count_if(after->chunks->places.begin(), after->chunks->places.end(),
                                   [](const server::ChunkPlace& p) { return p.phase == world::ChunkPhase::kResident; })),
              after->chunks->places.size());  // lock-step: nothing is under way between frames
    EXPECT_FALSE(after->chunks->places.empty());
    const auto picture = board.picture(live.id(), 2);
    ASSERT_TRUE(picture);
    EXPECT_EQ(picture->side, 128);
    EXPECT_TRUE(std::any_of(picture->values.begin(), picture->values.end(), [](uint8_t v) { return v > 0 && v < 255; }));
    EXPECT_FALSE(board.picture(live.id(), 3));
    EXPECT_FALSE(board.picture(live.id() + 1, 0));
    tests::expectSilence();
}

/// Pictures follow the window through the wrap of the stored map; a pixel is what is nearest the sun beneath it.
TEST(LiveBoard, PicturesAreInTheOrderOfTheWindow) {
    constexpr int kSide = 512;  // two texels a pixel
    const cache::Texel window(-700, 1300);
    std::vector<float> depths(kSide * kSide, cache::kEmptyDepth);
    const auto at = [&](int x, int y) -> float& {
        const auto slot = [](int64_t t) { return size_t(((t % kSide) + kSide) % kSide); };
        return depths[slot(window.y + y) * kSide + slot(window.x + x)];
    };
    at(0, 0) = 0.25f;
    at(511, 3) = 0.75f;
    at(511, 2) = 0.5f;  // the same pixel, nearer
    at(100, 400) = 0.75f;
    at(7, 9) = cache::kUnknownDepth;
    at(6, 9) = 0.3f;  // beside an unknown one
    const server::LivePicture picture = server::pictureOf(depths, kSide, window, 10, 100);
    EXPECT_EQ(picture.side, 256);
    EXPECT_EQ(picture.texels, kSide);
    EXPECT_DOUBLE_EQ(picture.near, 35);
    EXPECT_DOUBLE_EQ(picture.far, 85);
    const auto pixel = [&](int x, int y) { return int(picture.values[size_t(y * 256 + x)]); };
    EXPECT_EQ(pixel(0, 0), 1);
    EXPECT_EQ(pixel(255, 1), 128);  // halfway from 1 to 254, rounded away from 127.5
    EXPECT_EQ(pixel(50, 200), 254);
    EXPECT_EQ(pixel(3, 4), 0);
    EXPECT_EQ(std::count(picture.values.begin(), picture.values.end(), 255), 256 * 256 - 4);

    const std::vector<float> empty(64 * 64, cache::kEmptyDepth);
    const server::LivePicture nothing = server::pictureOf(empty, 64, {0, 0}, 0, 1);
    EXPECT_EQ(size_t(std::count(nothing.values.begin(), nothing.values.end(), 255)), nothing.values.size());
}

TEST(LiveBoard, SessionsAndWatchersComeAndGo) {
    const auto store = tests::baked(tests::streets({0, 0, 0}), "crowd.world");
    const auto system = systemOn(store, boardConfig());
    LiveBoard board;
    FrameInput input;
    const auto report = system->advance(input);
    ASSERT_TRUE(report);
    constexpr int kWriters = 4, kLives = 25, kFrames = 40;
    std::atomic<bool> stop = false;
    std::atomic<uint64_t> told = 0, lived = 0;
    std::vector<std::thread> watchers, writers;
    for (int w = 0; w < 3; ++w)
        watchers.emplace_back([&] {
            while (!stop) {
                for (const server::LiveName& name : board.sessions())
                    if (const auto news = board.news(name.id, 0)) told += news->frames.size();
                const std::string text = server::metricsText(board.totals(), true, 0);
                if (text.empty()) ADD_FAILURE();
            }
        });
    // One system for all: what the watched part reads of it is the same for every writer, and it is locked.
    std::mutex one;
    for (int w = 0; w < kWriters; ++w)
        writers.emplace_back([&] {
            for (int life = 0; life < kLives || told == 0; ++life) {  // until watchers had their turn
                ++lived;
                LiveSession live = board.open("crowd", "streets");
                for (int i = 0; i < kFrames; ++i) {
                    const std::lock_guard lock(one);
                    live.publish(*system, input, report.value(), 0.1);
                }
            }
        });
    for (std::thread& t : writers) t.join();
    stop = true;
    for (std::thread& t : watchers) t.join();
    const server::LiveTotals totals = board.totals();
    EXPECT_EQ(totals.frames, lived * kFrames);
    EXPECT_EQ(totals.sessionsOpened, lived.load());
    EXPECT_EQ(totals.sessions, 0u);
    EXPECT_TRUE(board.sessions().empty());
}

/// Each family has its HELP and TYPE before its values, and names nothing twice.
TEST(Metrics, AreWhatPrometheusReads) {
    server::LiveTotals totals;
    totals.frames = 7;
    totals.frameTimes[0] = 5;
    totals.frameTimes.back() = 2;
    totals.frameSeconds = 4.5;
    totals.byCause[size_t(cache::Cause::kScroll)].texels = 123456789012;
    const std::string text = server::metricsText(totals, true, 4096);
    std::istringstream lines(text);
    std::string line, family;
    std::set<std::string> families, values;
    while (std::getline(lines, line)) {
        if (line.starts_with("# HELP ")) {
            family = line.substr(7, line.find(' ', 7) - 7);
            EXPECT_TRUE(families.insert(family).second) << line;
            ASSERT_TRUE(std::getline(lines, line));
            ASSERT_TRUE(line.starts_with("# TYPE " + family + " ")) << line;
            continue;
        }
        ASSERT_TRUE(line.starts_with(family)) << line;
        EXPECT_TRUE(values.insert(line.substr(0, line.rfind(' '))).second) << line;
    }
    EXPECT_NE(text.find("gnomon_frames_total 7\n"), std::string::npos);
    EXPECT_NE(text.find("gnomon_redrawn_texels_total{cause=\"scroll\"} 123456789012\n"), std::string::npos);
    EXPECT_NE(text.find("gnomon_frame_seconds_bucket{le=\"0.0005\"} 5\n"), std::string::npos);
    EXPECT_NE(text.find("gnomon_frame_seconds_bucket{le=\"1\"} 5\n"), std::string::npos);
    EXPECT_NE(text.find("gnomon_frame_seconds_bucket{le=\"+Inf\"} 7\n"), std::string::npos);
    EXPECT_NE(text.find("gnomon_frame_seconds_count 7\n"), std::string::npos);
    EXPECT_GT(server::processResidentBytes(), 1u << 20);
}

TEST(LiveSite, AnswersWhateverIsAsked) {
    LiveBoard board;
    EXPECT_EQ(server::answer(board, "/").status, 200);
    EXPECT_NE(server::answer(board, "/").body.find("<title>Gnomon"), std::string::npos);
    EXPECT_EQ(server::answer(board, "/readyz").status, 503);
    board.setReady(true);
    EXPECT_EQ(server::answer(board, "/readyz").status, 200);
    EXPECT_EQ(server::answer(board, "/healthz").status, 200);
    EXPECT_TRUE(server::answer(board, "/events").events);
    EXPECT_EQ(server::answer(board, "/events?session=18446744073709551615").session, ~0ull);
    for (const char* bad : {"/events?", "/events?session=", "/events?session=-1", "/events?session=1x",
                            "/events?session=18446744073709551616", "/events?other=1"})
        EXPECT_EQ(server::answer(board, bad).status, bad == std::string("/events?") ? 200 : 400) << bad;
    for (const char* bad : {"/map", "/map?session=1", "/map?cascade=0", "/map?session=&cascade=", "/map?session=1&cascade=a"})
        EXPECT_EQ(server::answer(board, bad).status, 400) << bad;
    EXPECT_EQ(server::answer(board, "/map?session=1&cascade=18446744073709551615").status, 404);
    std::mt19937 rng(7);
    for (int i = 0; i < 2000; ++i) {  // anything at all
        std::string target = "/x";
        for (uint32_t k = rng() % 40; k > 0; --k) target += char(rng() % 256);
        EXPECT_EQ(server::answer(board, target).status, 404) << i;
    }
    EXPECT_EQ(server::answer(board, "").status, 404);
    EXPECT_EQ(server::answer(board, "/../etc/passwd").status, 404);
}

/// Names and errors may be any bytes; JSON is not.
TEST(LiveSite, NamesOfAnyBytesStayJson) {
    LiveBoard board;
    const LiveSession live = board.open("\xff</script>\"\n", std::string("a\0b", 3));
    server::LiveSeen seen{live.id(), 0, 0};
    const std::string json = server::newsJson(board.sessions(), board.news(live.id(), 0), seen);
    EXPECT_EQ(json.find('\n'), std::string::npos);  // it is one line of an event
    EXPECT_NE(json.find("\xef\xbf\xbd</script>\\\"\\n"), std::string::npos) << json;
    EXPECT_NE(json.find("a\\u0000b"), std::string::npos) << json;
}

}  // namespace
