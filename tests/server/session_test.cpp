// Sessions without a socket: what requests become, what replies say, and what no request can break.
#include "server/session.h"

#include "tests/server/clients.h"

namespace {

using tests::lifeFrame;
using tests::openStreets;
namespace v1 = gnomon::v1;

const server::OpenedWorld& streets() {
    static const auto folder = server::WorldFolder::create(tests::servedFolder());
    static const auto world = folder.value()->open("streets");
    return *world.value();
}

std::unique_ptr<server::Session> open(const v1::OpenSession& request = openStreets(), server::SessionLimits limits = {}) {
    limits.geometryBytes = 16 << 20;
    auto session = server::Session::open(tests::validatedDevice(), streets().store, request, limits);
    EXPECT_TRUE(session) << session.error().what;
    return std::move(session.value());
}

TEST(Session, DrawsWhatTheSameFramesDrawInASystem) {
    server::ShadowConfig config;
    config.cascades = 3;
    config.side = 256;
    config.farDistance = 45;
    config.restSeconds = 0.5;
    config.geometryBytes = 16 << 20;
    const auto system = server::ShadowSystem::create(tests::validatedDevice(), streets().store, config);
    ASSERT_TRUE(system);
    server::ShadowSystem& direct = *system.value();
    const auto session = open();
    std::optional<server::ObjectId> adopted, spawned;
    for (uint64_t k = 0; k < 60; ++k) {
        const v1::Frame request = lifeFrame(k);
        if (k == 1) adopted = direct.adopt("box " + world::toString(world::ChunkKey{0, 0, 0}) + " 0").value();
        if (k == 5) spawned = direct.spawn(1, tests::placedAt({4, 2, 1})).value();
        if (k == 20) {
            ASSERT_TRUE(direct.remove(*spawned));
        }
        std::vector<server::ObjectUpdate> moves;
        if (k >= 2 && k < 10) moves.push_back({*adopted, tests::placedAt({2 + 0.3 * double(k), 1, 3})});
        const auto& eye = request.cameras(0).position();
        const auto expected = direct.advance({request.time(), {{eye.x(), eye.y(), eye.z()}}, moves});
        ASSERT_TRUE(expected) << expected.error().what;
        const auto reply = session->frame(request);
        ASSERT_TRUE(reply) << reply.error().what;
        ASSERT_EQ(reply.value().plan_hash(), expected.value().planHash) << "frame " << k;
        ASSERT_EQ(reply.value().sequence(), 100 + k);
        ASSERT_EQ(reply.value().frame(), k);
        ASSERT_EQ(reply.value().cascades_size(), 3);
        for (int c = 0; c < 3; ++c) {
            const v1::Cascade& cascade = reply.value().cascades(c);
            const cache::CascadeStatistics& counted = expected.value().cascades[size_t(c)];
            EXPECT_EQ(cascade.total().triangles(), counted.total.triangles);
            uint64_t texels = 0;
            for (const v1::CauseCost& cause : cascade.causes()) texels += cause.cost().texels();
            EXPECT_EQ(texels, counted.total.texels);
            EXPECT_EQ(cascade.window_x(), direct.view(c).window.x);
            if (request.hashes()) {
                EXPECT_EQ(cascade.working_hash(), direct.mapHash(c, gpu::MapKind::kWorking).value()) << "frame " << k;
            }
        }
    }
    EXPECT_EQ(session->objects(), 1u);
    tests::expectSilence();
}

TEST(Session, SaysOfEachItemWhatIsWrongAndDoesTheRest) {
    const auto session = open();
    std::vector<std::pair<uint64_t, std::string>> errors;
    for (uint64_t k = 0; k < 25; ++k) {
        const auto reply = session->frame(lifeFrame(k));
        ASSERT_TRUE(reply);
        for (const v1::ItemError& e : reply.value().errors())
            errors.push_back({k, std::to_string(int(e.kind())) + std::to_string(e.index()) + " " + e.what()});
    }
    ASSERT_EQ(errors.size(), 3u);
    EXPECT_EQ(errors[0].first, 1u);
    EXPECT_TRUE(errors[0].second.starts_with("11 object 8: there is none of that number")) << errors[0].second;
    EXPECT_EQ(errors[1].first, 5u);
    EXPECT_TRUE(errors[1].second.starts_with("12 object 99: there is none")) << errors[1].second;
    EXPECT_EQ(errors[2].first, 20u);
    EXPECT_TRUE(errors[2].second.starts_with("20 ")) << errors[2].second;
}

TEST(Session, BadFramesAreToldAndTheNextOneIsAsIfTheyHadNotBeen) {
    const auto one = open(), other = open();
    const auto told = [](const world::Result<v1::FrameReply>& reply) {
        return reply && reply.value().errors_size() > 0 && reply.value().cascades_size() == 0 ? reply.value().errors(0).what() : "";
    };
    const auto has = [](const std::string& text, const char* part) { return text.find(part) != std::string::npos; };
    for (uint64_t k = 0; k < 12; ++k) {
        v1::Frame bad = lifeFrame(k);
        bad.clear_objects();
        if (k % 3 == 0) bad.clear_cameras();
        if (k % 3 == 1) *bad.add_cameras() = bad.cameras(0);
        if (k % 3 == 2) bad.mutable_cameras(0)->mutable_orientation()->set_w(0);
        const std::string text = told(one->frame(bad));
        EXPECT_TRUE(has(text, k % 3 == 0 ? "position" : k % 3 == 1 ? "2 cameras" : "orientation")) << text;
        const auto a = one->frame(lifeFrame(k)), b = other->frame(lifeFrame(k));
        ASSERT_TRUE(a && b);
        EXPECT_EQ(tests::deterministic(a.value()), tests::deterministic(b.value())) << "frame " << k;
    }
}

TEST(Session, MovesOfABadFrameAreMadeByTheNext) {
    const auto session = open();
    ASSERT_TRUE(session->frame(lifeFrame(0)));
    ASSERT_TRUE(session->frame(lifeFrame(1)));
    v1::Frame bad = lifeFrame(2);
    bad.clear_cameras();
    ASSERT_TRUE(session->frame(bad));
    v1::Frame quiet = lifeFrame(3);
    quiet.clear_objects();
    const auto reply = session->frame(quiet);
    ASSERT_TRUE(reply);
    uint64_t demoted = 0;
    for (const v1::Cascade& c : reply.value().cascades())
        for (const v1::CauseCost& cause : c.causes()) demoted += cause.cause() == "demotion";
    EXPECT_GT(demoted, 0u);
}

TEST(Session, LimitsAreNamed) {
    const auto refused = [](const v1::OpenSession& request, const server::SessionLimits& limits, const char* part) {
        const auto session = server::Session::open(tests::validatedDevice(), streets().store, request, limits);
        ASSERT_FALSE(session);
        EXPECT_NE(session.error().what.find(part), std::string::npos) << session.error().what;
    };
    v1::OpenSession large = openStreets();
    large.set_side(8192);
    large.set_cascades(8);
    refused(large, {}, "bytes of shadow maps");
    v1::OpenSession wrong = openStreets();
    wrong.set_far(-1);
    refused(wrong, {}, "far");
    wrong = openStreets();
    wrong.set_cameras(9);
    refused(wrong, {}, "cameras");
    wrong = openStreets();
    tests::put(wrong.mutable_sun(), {0, 1, 0});
    refused(wrong, {}, "sun");

    server::SessionLimits limits;
    limits.objects = 1;
    limits.updates = 3;
    limits.edits = 1;
    const auto session = open(openStreets(), limits);
    v1::Frame frame = lifeFrame(0);
    for (uint64_t k = 0; k < 2; ++k) {
        frame.add_objects()->set_object(k);
        frame.mutable_objects()->rbegin()->mutable_spawn()->set_mesh(0);
    }
    const auto reply = session->frame(frame);
    ASSERT_TRUE(reply);
    ASSERT_EQ(reply.value().errors_size(), 1);
    EXPECT_EQ(reply.value().errors(0).code(), v1::LIMIT);
    EXPECT_EQ(reply.value().errors(0).index(), 1u);
    frame.add_objects();
    frame.add_objects();
    EXPECT_EQ(session->frame(frame).error().code, world::ErrorCode::kLimit);
    frame.clear_objects();
    frame.add_edits();
    frame.add_edits();
    EXPECT_EQ(session->frame(frame).error().code, world::ErrorCode::kLimit);
}

TEST(MergeFrames, KeepsWhatHappenedInOrderAndTheLatestPose) {
    v1::Frame all = lifeFrame(1);
    for (uint64_t k = 2; k < 8; ++k) server::mergeFrames(all, lifeFrame(k));
    EXPECT_EQ(all.sequence(), 107u);
    EXPECT_EQ(all.objects_size(), 2 + 6 + 2);
    EXPECT_EQ(all.objects(0).object(), 7u);
    EXPECT_TRUE(all.objects(0).has_adopt());
    EXPECT_TRUE(all.hashes()) << "one of them wanted hashes";
    EXPECT_DOUBLE_EQ(all.cameras(0).position().x(), 0.4 * 7);
    v1::Frame withSun = lifeFrame(8);
    tests::put(withSun.mutable_sun(), {0, -1, 0});
    server::mergeFrames(withSun, lifeFrame(9));
    EXPECT_TRUE(withSun.has_sun()) << "the later frame left it as it was";
}

}  // namespace
