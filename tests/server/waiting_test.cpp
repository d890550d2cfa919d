// When a session's frame waits for the GPU, what its reply then tells, and that nothing else depends on it.
#include <chrono>
#include <thread>

#include "server/live_board.h"
#include "server/messages.h"
#include "tests/server/sessions.h"

namespace {

namespace v1 = gnomon::v1;
using tests::lifeFrame;
using tests::openSession;

/// Something moves in each, so that each draws.
v1::Frame frame(uint64_t k, bool gpuTime) {
    v1::Frame frame = lifeFrame(k);
    frame.mutable_wants()->set_hashes(false);
    frame.mutable_wants()->set_gpu_time(gpuTime);
    return frame;
}

TEST(Waiting, TimesOfTheGpuAreForWhoWantsThem) {
    const auto session = openSession();
    for (uint64_t k = 0; k < 12; ++k) {
        const auto reply = session->frame(frame(k, k % 2 == 1));
        ASSERT_TRUE(reply);
        if (!reply.value().submitted()) continue;
        const v1::Times& times = reply.value().times();
        EXPECT_GT(times.record(), 0);
        EXPECT_EQ(times.gpu() > 0, k % 2 == 1) << "frame " << k;
        EXPECT_GE(times.advance(), times.gpu());
    }
    v1::Frame first = frame(0, true);
    server::mergeFrames(first, frame(1, false));
    EXPECT_TRUE(first.wants().gpu_time()) << "one of them wanted it";
}

struct Seen {
    uint64_t geometryBytes = 0;  ///< at most
    uint32_t missing = 0;        ///< chunks, summed over frames
};

/// One session waits for each frame, the other for none. Questions are asked while the GPU draws.
Seen playBoth(const server::SessionLimits& limits) {
    const auto waits = openSession(tests::openStreets(), limits), goesOn = openSession(tests::openStreets(), limits);
    v1::QueryShadowRequest query;
    std::vector<glm::dvec3> points;
    for (int i = 0; i < 2000; ++i) points.push_back({-40 + 0.04 * i, 0.1 * (i % 30), -20 + 0.7 * (i % 60)});
    query.set_points(points.data(), points.size() * sizeof points[0]);
    Seen seen;
    for (uint64_t k = 0; k < 40; ++k) {
        const auto a = waits->frame(frame(k, true)), b = goesOn->frame(frame(k, false));
        EXPECT_TRUE(a && b);
        EXPECT_EQ(tests::deterministic(a.value()), tests::deterministic(b.value())) << "frame " << k;
        seen.geometryBytes = std::max(seen.geometryBytes, a.value().geometry_bytes());
        seen.missing += a.value().missing_chunks();
        if (k % 8 != 7) continue;
        EXPECT_EQ(waits->query(query).value().light(), goesOn->query(query).value().light());
        for (uint32_t c = 0; c < 3; ++c) {
            v1::GetDepthMapRequest map;
            map.set_cascade(c);
            map.set_working(true);
            EXPECT_EQ(waits->depthMap(map).value().depths, goesOn->depthMap(map).value().depths) << "frame " << k << " cascade " << c;
        }
    }
    return seen;
}

TEST(Waiting, IsNoDifferenceToMapsAndAnswers) {
    const Seen roomy = playBoth({});
    EXPECT_EQ(roomy.missing, 0u);
    server::SessionLimits tight;  // chunks come and go for want of room
    tight.geometryBytes = roomy.geometryBytes * 2 / 3;
    EXPECT_GT(playBoth(tight).missing, 0u);
    tests::expectSilence();
}

TEST(Waiting, IsForWhoWatches) {
    server::LiveBoard board;
    const auto session = openSession();
    server::LiveSession entry = board.open("1", "streets");
    const server::LiveId id = entry.id();
    session->show(std::move(entry));
    for (uint64_t k = 0; k < 6; ++k) ASSERT_TRUE(session->frame(frame(k, false)));
    const auto before = board.news(id, 0);  // from now on somebody watches
    for (uint64_t k = 6; k < 12; ++k) ASSERT_TRUE(session->frame(frame(k, false)));
    for (const server::LiveFrame& f : before->frames) EXPECT_EQ(f.gpuMs, 0);
    const auto after = board.news(id, before->frames.back().number);
    ASSERT_EQ(after->frames.size(), 6u);
    EXPECT_TRUE(std::any_of(after->frames.begin(), after->frames.end(), [](const server::LiveFrame& f) { return f.gpuMs > 0; }));
}

TEST(Waiting, ABudgetInTimeLearnsFromNoFrameThatNobodyWaitedFor) {
    server::SessionLimits limits;
    limits.geometryBytes = 16 << 20;
    const server::ShadowConfig config = server::configOf(tests::openStreets(), limits).value();
    ASSERT_FALSE(config.timestamps) << "with them nobody need look";
    constexpr server::Budget kTime{.ms = 2};
    std::vector<uint64_t> triangles;
    for (const int frames : {1, 12}) {
        const auto system = tests::systemOn(tests::streets().store, config);
        for (int k = 0; k < frames; ++k) {
            ASSERT_TRUE(system->advance({k / 30.0, {{4.0 * k, 2, 0}}, {}}));
            if (frames > 1) std::this_thread::sleep_for(std::chrono::milliseconds(20));
        }
        ASSERT_TRUE(system->setBudget(kTime));
        const auto report = system->advance({1, {{4.0 * frames, 2, 0}}, {}});
        ASSERT_TRUE(report);
        triangles.push_back(report.value().limits.triangles);
    }
    EXPECT_GT(triangles[0], 0u);
    EXPECT_EQ(triangles[0], triangles[1]) << "fences that nobody looked at say nothing of the GPU";

    v1::OpenSession open = tests::openStreets();
    open.mutable_budget()->set_ms(2);
    const auto reply = openSession(open)->frame(frame(0, false));
    ASSERT_TRUE(reply);
    EXPECT_GT(reply.value().times().gpu(), 0);
}

}  // namespace
