// Sessions without a socket: what requests become, what replies say, and what no request can break.
#include "server/session.h"

#include "tests/server/rays.h"
#include "tests/server/sessions.h"
#include "world/hash.h"
#include "world/movers.h"

namespace {

using tests::lifeFrame;
using tests::openStreets;
using tests::openSession;
using tests::streets;
namespace v1 = gnomon::v1;

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
    const auto session = openSession();
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
            if (request.wants().hashes()) {
                EXPECT_EQ(cascade.working_hash(), direct.mapHash(c, gpu::MapKind::kWorking).value()) << "frame " << k;
            }
        }
    }
    EXPECT_EQ(session->objects(), 1u);
    tests::expectSilence();
}

TEST(Session, SaysOfEachItemWhatIsWrongAndDoesTheRest) {
    const auto session = openSession();
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
    const auto one = openSession(), other = openSession();
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
    const auto session = openSession();
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

TEST(Session, TakesPosesAsRecordingsHaveThem) {
    const auto posed = openSession(), placed = openSession();
    world::Placement rest = tests::placedAt({4, 2, 1});
    rest.linear = glm::mat3(1, 0, 0, 0, 3, 0, 0, 0, 0.5f);  // its ratios stay
    const auto fill = [](v1::Placement* to, const world::Placement& from) {
        tests::put(to->mutable_translation(), from.translation);
        for (int i = 0; i < 9; ++i) to->add_linear(from.linear[i / 3][i % 3]);
    };
    const auto frameOf = [](uint64_t k) {
        v1::Frame frame = lifeFrame(k);
        frame.clear_objects();
        frame.clear_edits();
        return frame;
    };
    std::mt19937 rng(5);
    std::uniform_real_distribution<double> unit(-1, 1);
    for (uint64_t k = 0; k < 12; ++k) {
        v1::Frame poses = frameOf(k), places = frameOf(k);
        if (k == 0) {
            v1::ObjectUpdate* spawn = poses.add_objects();
            spawn->set_object(3);
            spawn->mutable_spawn()->set_mesh(1);
            spawn->mutable_spawn()->set_at_rest(true);
            fill(spawn->mutable_spawn()->mutable_placement(), rest);
            *places.add_objects() = *spawn;
        }
        world::MoverSample sample{0, rest.translation + glm::dvec3(4e-4, 0, 0), glm::dquat(1, 0, 0, 0), std::cbrt(1.5)};
        // Until frame 4 it rests, to a recording's rounding; in frame 9 it comes back to the same place, and that is a move.
        if (k >= 4 && k != 9) {
            sample.position += glm::dvec3(unit(rng), 0, unit(rng));
            sample.orientation = glm::normalize(glm::dquat(unit(rng), unit(rng), unit(rng), unit(rng)));
            sample.scale *= 1 + 0.5 * unit(rng);
        }
        v1::ObjectUpdate* pose = poses.add_objects();
        pose->set_object(3);
        tests::put(pose->mutable_pose()->mutable_position(), sample.position);
        pose->mutable_pose()->mutable_orientation()->set_x(sample.orientation.x);
        pose->mutable_pose()->mutable_orientation()->set_y(sample.orientation.y);
        pose->mutable_pose()->mutable_orientation()->set_z(sample.orientation.z);
        pose->mutable_pose()->mutable_orientation()->set_w(sample.orientation.w);
        pose->mutable_pose()->set_scale(sample.scale);
        if (k >= 4) {
            v1::ObjectUpdate* move = places.add_objects();
            move->set_object(3);
            fill(move->mutable_move(), world::moved(rest, sample));
        }
        const auto a = posed->frame(poses), b = placed->frame(places);
        ASSERT_TRUE(a && b);
        ASSERT_EQ(a.value().errors_size(), 0);
        ASSERT_EQ(tests::deterministic(a.value()), tests::deterministic(b.value())) << "frame " << k;
    }
    v1::Frame wrong = frameOf(12);
    for (int i = 0; i < 3; ++i) wrong.add_objects()->set_object(3);
    wrong.mutable_objects(0)->mutable_pose()->mutable_orientation()->set_x(2);
    wrong.mutable_objects(1)->mutable_pose()->set_scale(-1);
    wrong.mutable_objects(2)->mutable_pose()->mutable_position()->set_y(std::nan(""));
    const auto reply = posed->frame(wrong);
    ASSERT_TRUE(reply);
    ASSERT_EQ(reply.value().errors_size(), 3);
    EXPECT_NE(reply.value().errors(0).what().find("pose.orientation"), std::string::npos);
    EXPECT_NE(reply.value().errors(1).what().find("pose.scale"), std::string::npos);
    EXPECT_NE(reply.value().errors(2).what().find("object 3"), std::string::npos) << reply.value().errors(2).what();
    tests::expectSilence();
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
    const auto session = openSession(openStreets(), limits);
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

v1::ObjectUpdate* updateOf(v1::Frame& frame, uint64_t object) {
    v1::ObjectUpdate* update = frame.add_objects();
    update->set_object(object);
    return update;
}

TEST(Session, ObjectsBecomeStaticAndDeformingWhenTheyAreMarked) {
    const auto session = openSession();
    struct Seen {
        uint64_t active = 0, promoted = 0, demoted = 0;
    };
    uint64_t k = 0;
    const auto draw = [&](v1::Frame frame) {
        const uint64_t number = k++;
        frame.set_time(double(number) / 30);
        tests::put(frame.add_cameras()->mutable_position(), {0, 2, 0});
        const auto reply = session->frame(frame);
        EXPECT_TRUE(reply) << reply.error().what;
        EXPECT_EQ(reply.value().errors_size(), 0);
        const auto verified = session->system().verify();
        EXPECT_TRUE(verified);
        EXPECT_EQ(verified.value().differing, 0u) << "frame " << number;
        Seen seen;
        for (const v1::Cascade& c : reply.value().cascades()) {
            seen.active += c.active().triangles();
            for (const v1::CauseCost& cause : c.causes()) {
                seen.promoted += cause.cause() == "promotion" ? cause.cost().texels() : 0;
                seen.demoted += cause.cause() == "demotion" ? cause.cost().texels() : 0;
            }
        }
        return seen;
    };
    draw({});
    v1::Frame frame;
    tests::put(updateOf(frame, 1)->mutable_spawn()->mutable_placement()->mutable_translation(), {3, 8, 2});
    EXPECT_GT(draw(frame).active, 0u);
    frame.Clear();
    updateOf(frame, 1)->mutable_mark()->set_at_rest(true);
    EXPECT_GT(draw(frame).promoted, 0u) << "long before it has rested";
    EXPECT_EQ(draw({}).active, 0u);
    frame.Clear();
    v1::Mark* mark = updateOf(frame, 1)->mutable_mark();
    mark->set_deforms(true);
    mark->set_margin(1);
    EXPECT_GT(draw(frame).demoted, 0u);
    for (int i = 0; i < 30; ++i) {  // twice as long as a rest
        frame.Clear();
        tests::put(updateOf(frame, 1)->mutable_move()->mutable_translation(), {3, 8, 2});
        EXPECT_GT(draw(frame).active, 0u) << "what deforms is drawn anew where it stands";
    }
    frame.Clear();
    updateOf(frame, 1)->mutable_mark();
    draw(frame);
    uint64_t promoted = 0;
    for (int i = 0; i < 30; ++i) promoted += draw({}).promoted;
    EXPECT_GT(promoted, 0u) << "an object like any other rests";
    frame.Clear();
    mark = updateOf(frame, 1)->mutable_mark();
    mark->set_deforms(true);
    mark->set_at_rest(true);
    updateOf(frame, 2)->mutable_mark();
    tests::put(frame.add_cameras()->mutable_position(), {0, 2, 0});
    frame.set_time(100);
    const auto refused = session->frame(frame);
    ASSERT_TRUE(refused);
    ASSERT_EQ(refused.value().errors_size(), 2);
    EXPECT_EQ(refused.value().errors(0).code(), v1::USAGE);
    EXPECT_EQ(refused.value().errors(1).code(), v1::NOT_FOUND);
    tests::expectSilence();
}

TEST(Session, SpotLightsShineMoveAndGo) {
    const auto session = openSession();
    v1::Frame frame = lifeFrame(0);
    const auto shine = [&](uint64_t number, glm::dvec3 position, uint32_t side) {
        v1::SpotUpdate* update = frame.add_spots();
        update->set_spot(number);
        tests::put(update->mutable_shine()->mutable_position(), position);
        tests::put(update->mutable_shine()->mutable_direction(), {0.2, -1, 0.1});
        update->mutable_shine()->set_side(side);
    };
    shine(70, {0, 9, 0}, 128);
    shine(5, {4, 9, 3}, 256);
    frame.add_spots()->set_spot(6);
    frame.add_spots()->set_spot(7);
    frame.mutable_spots()->rbegin()->mutable_remove();
    const auto first = session->frame(frame);
    ASSERT_TRUE(first);
    ASSERT_EQ(first.value().spots_size(), 2);
    EXPECT_EQ(first.value().spots(0).spot(), 70u);
    EXPECT_TRUE(first.value().spots(1).drawn());
    EXPECT_EQ(first.value().spots(1).cause(), "start");
    EXPECT_GT(first.value().spots(1).statics().triangles(), 0u);
    EXPECT_EQ(first.value().spots(1).working_hash(),
              world::hashValues(std::span<const float>(session->system().readSpotMap(1, gpu::MapKind::kWorking).value())));
    ASSERT_EQ(first.value().errors_size(), 2);
    for (int i = 0; i < 2; ++i) EXPECT_EQ(first.value().errors(i).kind(), v1::ItemError::SPOT);
    EXPECT_EQ(first.value().errors(1).code(), v1::NOT_FOUND);

    v1::QueryShadowRequest query;
    std::vector<glm::dvec3> points;
    for (int i = 0; i < 400; ++i) points.push_back({(i % 20) * 0.7 - 5, 0.1, (i / 20) * 0.7 - 5});
    query.set_points(points.data(), points.size() * sizeof points[0]);
    query.set_spot(5);
    const auto answers = session->query(query);
    ASSERT_TRUE(answers) << answers.error().what;
    const auto expected = session->system().lookupSpot(1, points).value();
    int counts[4] = {};
    for (size_t i = 0; i < points.size(); ++i) {
        const int light = answers.value().light()[i];
        EXPECT_EQ(light, expected[i] == server::SpotAnswer::kLit       ? v1::LIT
                         : expected[i] == server::SpotAnswer::kShadowed ? v1::SHADOWED
                                                                        : v1::OUTSIDE);
        ++counts[light];
    }
    EXPECT_GT(counts[v1::LIT], 20);
    EXPECT_GT(counts[v1::SHADOWED], 5);
    EXPECT_GT(counts[v1::OUTSIDE], 20);
    query.set_by_rays(true);
    EXPECT_EQ(session->query(query).error().code, world::ErrorCode::kUsage);
    query.set_by_rays(false);
    query.set_spot(6);
    EXPECT_EQ(session->query(query).error().code, world::ErrorCode::kNotFound);
    v1::GetDepthMapRequest map;
    map.set_spot(5);
    EXPECT_EQ(session->depthMap(map).value().depths, session->system().readSpotMap(1, gpu::MapKind::kCache).value());

    frame = lifeFrame(1);
    shine(70, {1, 9, 0}, 128);
    frame.add_spots()->set_spot(5);
    frame.mutable_spots()->rbegin()->mutable_remove();
    const auto second = session->frame(frame);
    ASSERT_TRUE(second);
    ASSERT_EQ(second.value().spots_size(), 1);
    EXPECT_EQ(second.value().spots(0).spot(), 70u);
    EXPECT_GT(second.value().spots(0).statics().texels(), 0u) << "it moved";
    EXPECT_EQ(session->frame(lifeFrame(2)).value().spots(0).statics().texels(), 0u);

    server::SessionLimits limits;
    limits.mapBytes = 3 * 256 * 256 * 8 + 128 * 128 * 8;
    limits.spots = 2;
    const auto small = openSession(openStreets(), limits);
    frame = lifeFrame(0);
    shine(1, {0, 9, 0}, 128);
    shine(2, {0, 9, 0}, 128);
    const auto limited = small->frame(frame);
    ASSERT_TRUE(limited);
    ASSERT_EQ(limited.value().errors_size(), 1);
    EXPECT_EQ(limited.value().errors(0).code(), v1::LIMIT);
    frame.add_spots();
    EXPECT_EQ(small->frame(frame).error().code, world::ErrorCode::kLimit);
    tests::expectSilence();
}

TEST(Session, TellsWhatIsWanted) {
    const auto session = openSession();
    v1::Frame frame = lifeFrame(0);
    frame.mutable_wants()->set_whole_redraws(true);
    frame.mutable_wants()->set_dearest_casters(3);
    const auto reply = session->frame(frame);
    ASSERT_TRUE(reply);
    const server::RedrawCosts whole = session->system().redrawCosts();
    for (int c = 0; c < 3; ++c) EXPECT_EQ(reply.value().cascades(c).whole().triangles(), whole[size_t(c)].triangles);
    EXPECT_GT(whole[2].triangles, 0u);
    ASSERT_EQ(reply.value().dearest_size(), 3);
    EXPECT_GE(reply.value().dearest(0).triangles(), reply.value().dearest(2).triangles());
    EXPECT_NE(reply.value().dearest(0).name(), "");
    const auto quiet = session->frame(lifeFrame(1));
    EXPECT_EQ(quiet.value().dearest_size(), 0);
    EXPECT_FALSE(quiet.value().cascades(0).has_whole());
}

TEST(Session, RaysAnswerAsTheTrianglesDo) {
    const auto session = openSession();
    v1::QueryShadowRequest query;
    query.set_by_rays(true);
    EXPECT_EQ(session->query(query).error().code, world::ErrorCode::kUsage) << "no frame yet";
    ASSERT_TRUE(session->frame(lifeFrame(0)));
    std::vector<glm::dvec3> points;
    for (int i = 0; i < 900; ++i) points.push_back({(i % 30) * 1.3 - 20, 0.1, (i / 30) * 1.3 - 20});
    query.set_points(points.data(), points.size() * sizeof points[0]);
    query.set_bias_metres(0.05);  // as far as the test's own rays begin from their points
    const auto traced = session->query(query);
    ASSERT_TRUE(traced) << traced.error().what;
    const tests::WorldTriangles triangles = tests::trianglesOf(streets().store);
    const glm::dvec3 toSun = -streets().store.header().sun;
    int shadowed = 0;
    for (size_t i = 0; i < points.size(); ++i) {
        const bool expected = tests::shadowed(triangles, points[i], toSun);
        EXPECT_EQ(int(traced.value().light()[i]), expected ? v1::SHADOWED : v1::LIT) << i;
        shadowed += expected;
    }
    EXPECT_GT(shadowed, 100);
    EXPECT_LT(shadowed, 800);

    // What an object does is seen by the next frame's rays.
    v1::Frame frame = lifeFrame(1);
    frame.clear_objects();
    v1::Spawn* roof = updateOf(frame, 1)->mutable_spawn();
    roof->set_mesh(2);
    tests::put(roof->mutable_placement()->mutable_translation(), points[0] + 9.0 * toSun);
    ASSERT_TRUE(session->frame(frame));
    int more = 0;
    const auto later = session->query(query);
    for (size_t i = 0; i < points.size(); ++i) more += later.value().light()[i] == v1::SHADOWED;
    EXPECT_GT(more, shadowed);
}

TEST(Session, MasksAreWhatTheCameraSees) {
    const auto session = openSession();
    v1::Frame frame = lifeFrame(0);
    v1::GetShadowMaskRequest request;
    request.set_width(160);
    request.set_height(90);
    ASSERT_TRUE(session->frame(frame));
    EXPECT_EQ(session->mask(request).error().code, world::ErrorCode::kUsage) << "no field of view";
    frame = lifeFrame(1);
    frame.mutable_cameras(0)->set_vertical_fov(1);
    frame.mutable_cameras(0)->set_aspect(16 / 9.0);
    ASSERT_TRUE(session->frame(frame));
    const auto maps = session->mask(request);
    ASSERT_TRUE(maps) << maps.error().what;
    request.set_by_rays(true);
    const auto rays = session->mask(request);
    ASSERT_TRUE(rays);
    int counts[4] = {}, far = 0, lit = 0;
    for (size_t i = 0; i < 160 * 90; ++i) {
        const int surface = maps.value().surface()[i], light = uint8_t(maps.value().light()[i]), exact = uint8_t(rays.value().light()[i]);
        ++counts[surface];
        if (surface == v1::SKY) { EXPECT_EQ(light, 255); }
        if (surface == v1::AWAY) { EXPECT_EQ(light, 0); }
        if (surface != v1::FACING) continue;
        EXPECT_TRUE(exact == 0 || exact == 255);
        far += std::abs(light - exact) > 127;
        lit += exact == 255;
    }
    for (const v1::Surface surface : {v1::SKY, v1::AWAY, v1::FACING}) EXPECT_GT(counts[surface], 100) << int(surface);
    EXPECT_EQ(counts[v1::UNMAPPED], 0);
    EXPECT_GT(lit, 100);
    EXPECT_LT(far, counts[v1::FACING] / 25) << "pixels on the wrong side: those at edges, within a texel";
    request.set_width(100'000);
    EXPECT_EQ(session->mask(request).error().code, world::ErrorCode::kLimit);
    request.set_width(0);
    EXPECT_EQ(session->mask(request).error().code, world::ErrorCode::kUsage);
    request.set_width(10);
    request.set_camera(1);
    EXPECT_EQ(session->mask(request).error().code, world::ErrorCode::kUsage);
}

TEST(MergeFrames, KeepsWhatHappenedInOrderAndTheLatestPose) {
    v1::Frame all = lifeFrame(1);
    for (uint64_t k = 2; k < 8; ++k) server::mergeFrames(all, lifeFrame(k));
    EXPECT_EQ(all.sequence(), 107u);
    EXPECT_EQ(all.objects_size(), 2 + 6 + 2);
    EXPECT_EQ(all.objects(0).object(), 7u);
    EXPECT_TRUE(all.objects(0).has_adopt());
    EXPECT_TRUE(all.wants().hashes()) << "one of them wanted hashes";
    EXPECT_DOUBLE_EQ(all.cameras(0).position().x(), 0.4 * 7);
    v1::Frame withSun = lifeFrame(8);
    tests::put(withSun.mutable_sun(), {0, -1, 0});
    server::mergeFrames(withSun, lifeFrame(9));
    EXPECT_TRUE(withSun.has_sun()) << "the later frame left it as it was";
}

}  // namespace
