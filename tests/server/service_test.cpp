// The service over a socket: the same frames as without one, limits that end what exceeds them, and clients that vanish.
#include "server/service.h"

#include <zstd.h>

#include <atomic>
#include <thread>

#include "server/recording.h"
#include "server/session_replay.h"
#include "tests/server/clients.h"
#include "world/hash.h"

namespace {

using tests::lifeFrame;
using tests::openStreets;
using tests::Running;
using tests::serviceConfig;
namespace v1 = gnomon::v1;

/// The same life in process.
std::vector<std::string> inProcess(uint64_t frames) {
    const auto folder = server::WorldFolder::create(tests::servedFolder());
    const auto world = folder.value()->open("streets");
    server::SessionLimits limits;
    limits.geometryBytes = 16 << 20;
    const auto session = server::Session::open(tests::validatedDevice(), world.value()->store, openStreets(), limits);
    std::vector<std::string> replies;
    for (uint64_t k = 0; k < frames; ++k) replies.push_back(tests::deterministic(session.value()->frame(lifeFrame(k)).value()));
    return replies;
}

TEST(Service, ListsAndDescribesWorlds) {
    const Running running;
    server::Client client = running.client();
    ASSERT_TRUE(client.healthy());
    EXPECT_EQ(client.worlds().value(), std::vector<std::string>{"streets"});
    const auto info = client.openWorld("streets");
    ASSERT_TRUE(info) << info.error().what;
    EXPECT_EQ(info.value().chunks(), 144u);
    EXPECT_EQ(info.value().meshes(), 4u);
    EXPECT_NE(info.value().content(), 0u);
    for (const char* name : {"", "..", "../streets", "/etc/passwd", "streets.world/", "a b", "nothing"}) {
        const auto refused = client.openWorld(name);
        ASSERT_FALSE(refused) << name;
        EXPECT_EQ(refused.error().what.find(tests::servedFolder()), std::string::npos) << refused.error().what;
    }
}

TEST(Service, FramesOverTheWireAreThoseInProcess) {
    const std::vector<std::string> expected = inProcess(40);
    Running running;
    for (int again = 0; again < 2; ++again) {
        server::Client client = running.client();
        const auto session = client.session(openStreets());
        ASSERT_TRUE(session) << session.error().what;
        EXPECT_EQ(session.value()->opened().world().name(), "streets");
        for (uint64_t k = 0; k < 40; ++k) {
            const auto reply = session.value()->frame(lifeFrame(k));
            ASSERT_TRUE(reply) << reply.error().what;
            ASSERT_EQ(tests::deterministic(reply.value()), expected[k]) << "frame " << k;
            EXPECT_GT(reply.value().times().advance(), 0);
        }
        ASSERT_TRUE(session.value()->close());
    }
    EXPECT_TRUE(running.empty());
    EXPECT_EQ(running.told("ended"), 2u);
    EXPECT_EQ(running.service->frames(), 80u);
    tests::expectSilence();
}

TEST(Service, RequestsThatWaitAreAnsweredInOrder) {
    const std::vector<std::string> expected = inProcess(100);
    const Running running;
    server::Client client = running.client();
    const auto session = client.session(openStreets());
    ASSERT_TRUE(session);
    std::thread sender([&] {
        for (uint64_t k = 0; k < 100; ++k) EXPECT_TRUE(session.value()->send(lifeFrame(k)));
    });
    for (uint64_t k = 0; k < 100; ++k) {
        const auto reply = session.value()->receive();
        ASSERT_TRUE(reply) << reply.error().what;
        ASSERT_EQ(tests::deterministic(reply.value()), expected[k]) << "frame " << k;
    }
    sender.join();
    ASSERT_TRUE(session.value()->close());
}

TEST(Service, TheLatestPoseWinsAndNoUpdateIsLost) {
    Running running;
    server::Client client = running.client();
    v1::OpenSession open = openStreets();
    open.set_latest_pose_wins(true);
    const auto session = client.session(open);
    ASSERT_TRUE(session);
    constexpr uint64_t kFrames = 120;
    std::thread sender([&] {
        for (uint64_t k = 0; k < kFrames; ++k) {
            v1::Frame frame = lifeFrame(0);
            frame.set_sequence(k);
            frame.set_time(double(k) / 30);
            frame.mutable_cameras(0)->mutable_position()->set_x(0.2 * double(k));
            frame.add_objects()->set_object(k);
            frame.mutable_objects()->rbegin()->mutable_spawn()->set_mesh(0);
            EXPECT_TRUE(session.value()->send(frame));
        }
    });
    uint64_t answered = 0, replies = 0, errors = 0, last = 0;
    while (answered < kFrames) {
        const auto reply = session.value()->receive();
        ASSERT_TRUE(reply) << reply.error().what;
        answered += reply.value().answers();
        errors += uint64_t(reply.value().errors_size());
        last = reply.value().sequence();
        ++replies;
    }
    sender.join();
    EXPECT_EQ(answered, kFrames);
    EXPECT_EQ(last, kFrames - 1);
    EXPECT_LT(replies, kFrames) << "nothing ever waited: the test is too tame";
    EXPECT_EQ(errors, 0u);
    // Each object is there: its number is taken.
    v1::Frame probe = lifeFrame(0);
    probe.set_time(100);
    for (uint64_t k = 0; k < kFrames; ++k) {
        probe.add_objects()->set_object(k);
        probe.mutable_objects()->rbegin()->mutable_remove();
    }
    const auto reply = session.value()->frame(probe);
    ASSERT_TRUE(reply);
    EXPECT_EQ(reply.value().errors_size(), 0);
}

TEST(Service, AnswersForPointsAsTheSystemDoes) {
    const Running running;
    server::Client client = running.client();
    const auto session = client.session(openStreets());
    ASSERT_TRUE(session);
    v1::QueryShadowRequest query;
    query.set_session(session.value()->opened().session());
    EXPECT_EQ(client.query(query).error().code, world::ErrorCode::kUsage) << "no frame yet";
    ASSERT_TRUE(session.value()->frame(lifeFrame(0)));

    const auto folder = server::WorldFolder::create(tests::servedFolder());
    const auto world = folder.value()->open("streets");
    server::SessionLimits limits;
    limits.geometryBytes = 16 << 20;
    const auto direct = server::Session::open(tests::validatedDevice(), world.value()->store, openStreets(), limits);
    ASSERT_TRUE(direct.value()->frame(lifeFrame(0)));
    std::vector<glm::dvec3> points;
    for (int i = 0; i < 900; ++i) points.push_back({(i % 30) * 3.0 - 45, 0.1, (i / 30) * 3.0 - 45});
    const auto expected = direct.value()->system().lookup(points).value();
    query.set_points(points.data(), points.size() * sizeof points[0]);
    const auto reply = client.query(query);
    ASSERT_TRUE(reply) << reply.error().what;
    int shadowed = 0;
    for (size_t i = 0; i < points.size(); ++i) {
        ASSERT_EQ(int(reply.value().light()[i]), int(expected[i].light)) << i;
        ASSERT_EQ(int8_t(reply.value().cascade()[i]), expected[i].cascade) << i;
        shadowed += expected[i].light == server::Light::kShadowed;
    }
    EXPECT_GT(shadowed, 50);

    const auto code = [&](const v1::QueryShadowRequest& bad) { return client.query(bad).error().code; };
    v1::QueryShadowRequest bad = query;
    bad.mutable_points()->pop_back();
    EXPECT_EQ(code(bad), world::ErrorCode::kUsage);
    bad = query;
    bad.set_normals("x");
    EXPECT_EQ(code(bad), world::ErrorCode::kUsage);
    bad = query;
    bad.set_camera(1);
    EXPECT_EQ(code(bad), world::ErrorCode::kUsage);
    bad = query;
    const double nan[3] = {0, std::nan(""), 0};
    bad.set_points(nan, sizeof nan);
    EXPECT_EQ(code(bad), world::ErrorCode::kUsage);
    bad = query;
    bad.set_session("0123");
    EXPECT_EQ(code(bad), world::ErrorCode::kNotFound);
    ASSERT_TRUE(session.value()->close());
    EXPECT_EQ(code(query), world::ErrorCode::kNotFound) << "it has ended";
}

TEST(Service, HandsOutMapsInTiles) {
    const Running running;
    server::Client client = running.client();
    const auto session = client.session(openStreets());
    ASSERT_TRUE(session);
    const auto frame = session.value()->frame(lifeFrame(0));
    ASSERT_TRUE(frame);
    v1::GetDepthMapRequest request;
    request.set_session(session.value()->opened().session());
    request.set_cascade(1);
    request.set_working(true);
    for (const uint32_t tile : {0u, 64u, 1024u})
        for (const bool zstd : {false, true}) {
            request.set_tile(tile);
            request.set_zstd(zstd);
            const auto tiles = client.depthMap(request);
            ASSERT_TRUE(tiles) << tiles.error().what;
            std::vector<float> map(256 * 256, -1);
            for (const v1::DepthTile& t : tiles.value()) {
                std::string bytes = t.depths();
                if (zstd) {
                    bytes.resize(size_t(t.width()) * t.height() * 4);
                    ASSERT_EQ(ZSTD_decompress(bytes.data(), bytes.size(), t.depths().data(), t.depths().size()), bytes.size());
                }
                ASSERT_EQ(bytes.size(), size_t(t.width()) * t.height() * 4);
                for (uint32_t j = 0; j < t.height(); ++j)
                    std::memcpy(&map[size_t(t.y() + j) * 256 + t.x()], bytes.data() + size_t(j) * t.width() * 4, size_t(t.width()) * 4);
            }
            EXPECT_EQ(world::hashValues(std::span<const float>(map)), frame.value().cascades(1).working_hash());
            EXPECT_LT(*std::min_element(map.begin(), map.end()), 1.0f) << "something casts";
            EXPECT_EQ(tiles.value().front().cascade().window_x(), frame.value().cascades(1).window_x());
        }
    request.set_tile(100);
    EXPECT_EQ(client.depthMap(request).error().code, world::ErrorCode::kUsage);
    request.set_tile(64);
    request.set_cascade(3);
    EXPECT_EQ(client.depthMap(request).error().code, world::ErrorCode::kUsage);
}

TEST(Service, RecordsWhatItIsAskedAndAnswers) {
    server::ServiceConfig config = serviceConfig();
    config.record = tests::temporary("recordings");
    std::filesystem::create_directory(config.record);
    std::vector<std::string> replies;
    {
        Running running(config);
        server::Client client = running.client();
        const auto session = client.session(openStreets());
        ASSERT_TRUE(session);
        for (uint64_t k = 0; k < 30; ++k) replies.push_back(tests::deterministic(session.value()->frame(lifeFrame(k)).value()));
        ASSERT_TRUE(session.value()->close());
        ASSERT_TRUE(running.empty());
    }
    std::vector<std::filesystem::path> files;
    for (const auto& entry : std::filesystem::directory_iterator(config.record)) files.push_back(entry.path());
    ASSERT_EQ(files.size(), 1u);
    auto reader = server::RecordingReader::open(files[0].string());
    ASSERT_TRUE(reader) << reader.error().what;
    uint64_t requests = 0, answers = 0;
    for (;;) {
        const auto entry = reader.value().next();
        ASSERT_TRUE(entry) << entry.error().what;
        if (!entry.value()) break;
        if (entry.value()->kind == server::EntryKind::kRequest) {
            v1::SessionRequest request;
            ASSERT_TRUE(request.ParseFromString(entry.value()->message));
            if (requests++ == 0) {
                EXPECT_EQ(request.open().world(), "streets");
                EXPECT_EQ(request.open().guard_band(), 4u) << "and what the server made of what was left open";
            } else {
                EXPECT_EQ(request.frame().SerializeAsString(), lifeFrame(requests - 2).SerializeAsString());
            }
        } else {
            v1::SessionReply reply;
            ASSERT_TRUE(reply.ParseFromString(entry.value()->message));
            if (answers++ == 0) {
                EXPECT_EQ(reply.opened().session(), "") << "a secret is not written down";
            } else {
                EXPECT_EQ(tests::deterministic(reply.frame()), replies[answers - 2]);
            }
        }
    }
    EXPECT_EQ(requests, 31u);
    EXPECT_EQ(answers, 31u);
    EXPECT_FALSE(reader.value().torn());

    const auto worlds = server::WorldFolder::create(tests::servedFolder());
    uint64_t frame = 0;
    const auto replay = server::replaySession(tests::validatedDevice(), *worlds.value(), files[0].string(), true, [&](const v1::FrameReply& reply) {
        v1::FrameReply told = reply;
        EXPECT_EQ(tests::deterministic(told), replies[frame++]);
    });
    ASSERT_TRUE(replay) << replay.error().what;
    EXPECT_EQ(replay.value().compared, 30u);
    EXPECT_EQ(replay.value().difference, "");

    // One number of one recorded reply is another.
    const std::string changed = config.record + "/changed.gnomonrec";
    auto from = server::RecordingReader::open(files[0].string());
    auto to = server::RecordingWriter::create(changed);
    for (uint64_t n = 0;; ++n) {
        auto entry = from.value().next();
        if (!entry.value()) break;
        if (n == 2 + 2 * 17 + 1) {
            v1::SessionReply reply;
            ASSERT_TRUE(reply.ParseFromString(entry.value()->message));
            v1::Cost* cost = reply.mutable_frame()->mutable_cascades(1)->mutable_total();
            cost->set_triangles(cost->triangles() + 1);
            entry.value()->message = reply.SerializeAsString();
        }
        ASSERT_TRUE(to.value().add(entry.value()->kind, entry.value()->message));
    }
    const auto differs = server::replaySession(tests::validatedDevice(), *worlds.value(), changed, true, [](const v1::FrameReply&) {});
    ASSERT_TRUE(differs);
    EXPECT_EQ(differs.value().frames, 18u) << "it stops there";
    EXPECT_NE(differs.value().difference.find("frame 17, sequence 117"), std::string::npos) << differs.value().difference;
    EXPECT_NE(differs.value().difference.find("cascades[1].total.triangles"), std::string::npos) << differs.value().difference;
}

TEST(Service, WhatASessionLeavesOpenIsTheServersOwn) {
    server::ServiceConfig config = serviceConfig();
    config.maps.cascades = 2;
    config.maps.side = 128;
    config.maps.guardBand = 16;
    config.maps.farDistance = 45;
    const Running running(config);
    server::Client client = running.client();
    v1::OpenSession open;
    open.set_world("streets");
    const auto given = client.session(open);
    ASSERT_TRUE(given);
    const auto frame = given.value()->frame(lifeFrame(1));
    ASSERT_TRUE(frame);
    ASSERT_EQ(frame.value().cascades_size(), 2);
    EXPECT_DOUBLE_EQ(frame.value().cascades(1).split(), 45);
    EXPECT_EQ(frame.value().cascades(0).window_x() % 16, 0);
    open.set_cascades(3);
    const auto asked = client.session(open);
    ASSERT_TRUE(asked);
    EXPECT_EQ(asked.value()->frame(lifeFrame(1)).value().cascades_size(), 3) << "what it asks for is its own";
}

TEST(Service, MoreSessionsThanItServesAreRefusedUntilOneEnds) {
    server::ServiceConfig config = serviceConfig();
    config.sessions = 2;
    Running running(config);
    server::Client client = running.client();
    auto a = client.session(openStreets()), b = client.session(openStreets());
    ASSERT_TRUE(a && b);
    const auto c = client.session(openStreets());
    ASSERT_FALSE(c);
    EXPECT_EQ(c.error().code, world::ErrorCode::kLimit) << c.error().what;
    EXPECT_NE(c.error().what.find("2 are open"), std::string::npos);
    ASSERT_TRUE(a.value()->close());
    for (int i = 0; i < 500 && running.service->sessions() > 1; ++i) std::this_thread::sleep_for(std::chrono::milliseconds(10));
    EXPECT_TRUE(client.session(openStreets()));
}

TEST(Service, WhatMakesNoSenseEndsASessionByName) {
    const Running running;
    server::Client client = running.client();
    v1::OpenSession open = openStreets();
    open.set_world("elsewhere");
    EXPECT_EQ(client.session(open).error().code, world::ErrorCode::kNotFound);
    open = openStreets();
    open.set_side(1);
    EXPECT_EQ(client.session(open).error().code, world::ErrorCode::kUsage);
    server::ServiceConfig small = serviceConfig();
    small.messageBytes = 1000;
    const Running narrow(small);
    server::Client other = narrow.client();
    const auto session = other.session(openStreets());
    ASSERT_TRUE(session);
    v1::Frame large = lifeFrame(0);
    for (int i = 0; i < 100; ++i) large.add_objects()->mutable_adopt()->set_name("a name of some length");
    const auto reply = session.value()->frame(large);
    ASSERT_FALSE(reply);
    EXPECT_TRUE(narrow.empty());
}

TEST(Service, IdleSessionsEndAndSayWhy) {
    server::ServiceConfig config = serviceConfig();
    config.idleSeconds = 0.3;
    Running running(config);
    server::Client client = running.client();
    const auto session = client.session(openStreets());
    ASSERT_TRUE(session);
    ASSERT_TRUE(session.value()->frame(lifeFrame(0)));
    const auto reply = session.value()->receive();
    ASSERT_FALSE(reply);
    EXPECT_NE(reply.error().what.find("idle"), std::string::npos) << reply.error().what;
    EXPECT_TRUE(running.empty());
}

TEST(Service, WhoDoesNotReadIsDropped) {
    server::ServiceConfig config = serviceConfig();
    config.unreadSeconds = 0.5;
    Running running(config);
    server::Client client = running.client();
    const auto session = client.session(openStreets());
    ASSERT_TRUE(session);
    std::atomic<bool> refused = false;
    std::thread sender([&] {
        for (uint64_t k = 0; k < 100'000 && !refused; ++k) {
            v1::Frame frame = lifeFrame(0);
            frame.set_time(double(k) / 30);
            for (int i = 0; i < 200; ++i) frame.add_objects();  // each an error of the reply: 20 kB to read
            if (!session.value()->send(frame)) refused = true;
        }
    });
    sender.join();
    EXPECT_TRUE(refused);
    EXPECT_TRUE(running.empty());
}

TEST(Service, AStopLetsFramesEndAndTellsTheRest) {
    Running running;
    server::Client client = running.client();
    const auto session = client.session(openStreets());
    ASSERT_TRUE(session);
    ASSERT_TRUE(session.value()->frame(lifeFrame(0)));
    std::thread stopper([&] { running.service->stop(std::chrono::seconds(5)); });
    const auto reply = session.value()->receive();
    ASSERT_FALSE(reply);
    EXPECT_NE(reply.error().what.find("stops"), std::string::npos) << reply.error().what;
    stopper.join();
    EXPECT_EQ(running.service->sessions(), 0u);
    EXPECT_FALSE(client.healthy(0.2));
}

TEST(Service, AddressesThatOthersReachNeedTls) {
    const auto host = tests::localHost();
    server::ServiceConfig config = serviceConfig();
    for (const char* listen : {"0.0.0.0:0", "192.0.2.1:0", "[::]:0", "example.org:1"}) {
        config.listen = listen;
        const auto refused = server::Service::start(*host, config, {});
        ASSERT_FALSE(refused) << listen;
        EXPECT_NE(refused.error().what.find("mutual TLS"), std::string::npos) << refused.error().what;
    }
    config.listen = "unix:" + tests::temporary("gnomon.sock");
    const Running running(config);
    EXPECT_TRUE(running.client().healthy());
    const Running first;
    server::ServiceConfig second = serviceConfig();
    second.listen = first.service->address();
    const auto taken = server::Service::start(*host, second, {});
    ASSERT_FALSE(taken);
    EXPECT_NE(taken.error().what.find("cannot be had"), std::string::npos);
}

}  // namespace
