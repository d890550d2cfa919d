// Random changes of sound requests and recordings: whatever still parses is answered or refused by name, and what the session
// draws afterwards is still right to the bit.
#include <google/protobuf/stubs/logging.h>

#include <chrono>
#include <fstream>

#include "server/recording.h"
#include "server/session.h"
#include "server/session_replay.h"
#include "tests/server/clients.h"
#include "tests/server/mutator.h"
#include "world/hash.h"

namespace {

using tests::kFuzzTime;
using tests::lifeFrame;
using tests::Mutator;
using tests::openStreets;
using tests::richFrame;
namespace v1 = gnomon::v1;

TEST(Fuzz, RequestsAreAnsweredOrRefusedByName) {
    const auto folder = server::WorldFolder::create(tests::servedFolder());
    const auto world = folder.value()->open("streets");
    server::SessionLimits limits;
    limits.geometryBytes = 16 << 20;
    limits.mapBytes = 8 << 20;
    limits.objects = 200;
    v1::OpenSession open = openStreets();
    open.set_cascades(2);
    open.set_side(64);
    open.set_moving_sun(true);
    const auto fresh = [&](const v1::OpenSession& request) {
        return server::Session::open(tests::validatedDevice(), world.value()->store, request, limits);
    };
    const auto before = google::protobuf::SetLogHandler(nullptr);  // each request that is none would have its line
    Mutator mutator(1);
    auto session = fresh(open);
    ASSERT_TRUE(session) << session.error().what;
    const auto end = std::chrono::steady_clock::now() + kFuzzTime;
    uint64_t k = 0, frames = 0, refused = 0, opened = 0, questions = 0;
    const auto named = [](const world::Error& error) {
        return error.code != world::ErrorCode::kDevice && error.code != world::ErrorCode::kIo && !error.what.empty();
    };
    for (; std::chrono::steady_clock::now() < end; ++k) {
        std::string bytes = richFrame(k).SerializeAsString();
        mutator.change(bytes, richFrame(mutator.below(1000)).SerializeAsString());
        v1::Frame frame;
        if (!frame.ParseFromString(bytes)) continue;
        const auto reply = session.value()->frame(frame);
        if (reply) frames += reply.value().cascades_size() > 0;
        else {
            ++refused;
            ASSERT_TRUE(named(reply.error())) << reply.error().what << "\n" << frame.DebugString();
        }
        if (k % 8 == 0) {
            v1::QueryShadowRequest query;
            const double points[] = {1, 2, 3, 4, 5, 6};
            query.set_points(points, sizeof points);
            query.set_bias_metres(0.1);
            query.set_by_rays(true);
            if (k % 16 == 0) query.set_spot(0);
            bytes = query.SerializeAsString();
            mutator.change(bytes, bytes);
            if (query.ParseFromString(bytes)) {
                const auto answer = session.value()->query(query);
                questions += bool(answer);
                ASSERT_TRUE(answer || named(answer.error())) << answer.error().what << "\n" << query.DebugString();
            }
        }
        if (k % 64 == 0) {
            bytes = open.SerializeAsString();
            mutator.change(bytes, bytes);
            v1::OpenSession request;
            if (!request.ParseFromString(bytes)) continue;
            const auto another = fresh(request);
            opened += bool(another);
            ASSERT_TRUE(another || named(another.error())) << another.error().what << "\n" << request.DebugString();
        }
        if (k % 500 == 0) {  // before its clock has run away for good
            v1::Frame sound;
            sound.set_time(1e300);
            tests::put(sound.add_cameras()->mutable_position(), {0, 2, 0});
            sound.mutable_budget();
            const auto drawn = session.value()->frame(sound);
            ASSERT_TRUE(drawn) << drawn.error().what;
            if (session.value()->frames() > 0) {
                const auto verified = session.value()->system().verify();
                ASSERT_TRUE(verified) << verified.error().what;
                ASSERT_EQ(verified.value().differing, 0u) << "after " << k << " requests";
            }
            session = fresh(open);
            ASSERT_TRUE(session);
        }
    }
    google::protobuf::SetLogHandler(before);
    // Shares, not numbers: machines differ. They were 18, 0.4 and 0.06 in 100.
    EXPECT_GT(frames, k / 20);
    EXPECT_GT(questions, k / 2000);
    EXPECT_GT(opened, 0u);
    tests::expectSilence();
    std::printf("%llu requests: %llu frames drawn, %llu refused, %llu questions answered, %llu sessions opened\n", static_cast<unsigned long long>(k), static_cast<unsigned long long>(frames),
                static_cast<unsigned long long>(refused), static_cast<unsigned long long>(questions), static_cast<unsigned long long>(opened));
}

TEST(Fuzz, RecordingsAreReadToWhereTheyAreSound) {
    const std::string sound = tests::temporary("fuzz-sound.gnomonrec"), changed = tests::temporary("fuzz-changed.gnomonrec");
    {
        auto writer = server::RecordingWriter::create(sound);
        ASSERT_TRUE(writer);
        for (uint64_t k = 0; k < 20; ++k) {
            v1::SessionRequest request;
            *request.mutable_frame() = lifeFrame(k);
            ASSERT_TRUE(writer.value().add(server::EntryKind::kRequest, request.SerializeAsString()));
        }
    }
    std::ifstream file(sound, std::ios::binary);
    const std::string bytes{std::istreambuf_iterator<char>(file), {}};
    Mutator mutator(2);
    const auto end = std::chrono::steady_clock::now() + kFuzzTime;
    uint64_t tries = 0, whole = 0, damaged = 0, torn = 0;
    for (; std::chrono::steady_clock::now() < end; ++tries) {
        std::string other = bytes;
        if (mutator.below(4) == 0) other.resize(mutator.below(other.size()));
        else mutator.change(other, bytes);
        std::ofstream(changed, std::ios::binary | std::ios::trunc) << other;
        auto reader = server::RecordingReader::open(changed);
        if (!reader) {
            ASSERT_EQ(reader.error().code, world::ErrorCode::kBadData);
            continue;
        }
        uint64_t entries = 0;
        for (;; ++entries) {
            const auto entry = reader.value().next();
            if (!entry) {
                ASSERT_EQ(entry.error().code, world::ErrorCode::kBadData);
                ++damaged;
                break;
            }
            if (!entry.value()) break;
            v1::SessionRequest request;
            ASSERT_TRUE(request.ParseFromString(entry.value()->message)) << "what its checksum vouches for is as it was written";
        }
        torn += reader.value().torn();
        whole += entries == 20;
    }
    std::printf("%llu tries: %llu damaged, %llu torn\n", static_cast<unsigned long long>(tries), static_cast<unsigned long long>(damaged),
                static_cast<unsigned long long>(torn));
    EXPECT_GT(damaged, tries / 4);  // was 72 in 100
    EXPECT_GT(torn, tries / 20);    // 26
    EXPECT_GT(whole, 0u) << "some end after the last entry";
}

}  // namespace
