// Maps in shared memory: the same texels as over the wire, for whoever has the token and nobody else, and never to be written.
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstring>
#include <thread>

#include "server/share_socket.h"
#include "tests/server/clients.h"
#include "world/hash.h"

namespace {

using tests::lifeFrame;
using tests::openStreets;
using tests::Running;
namespace v1 = gnomon::v1;

server::ServiceConfig sharing() {
    server::ServiceConfig config = tests::serviceConfig();
    config.share = tests::temporary("share.sock");
    return config;
}

v1::OpenSession openShared() {
    v1::OpenSession open = openStreets();
    open.set_share_maps(true);
    return open;
}

v1::Frame withHashes(uint64_t k) {
    v1::Frame frame = lifeFrame(k);
    frame.mutable_wants()->set_hashes(true);
    return frame;
}

/// Every cascade's hash as the reply has it.
void expectHashes(const server::SharedMaps& maps, const v1::FrameReply& reply) {
    ASSERT_EQ(maps.frame(), reply.frame());
    const auto before = maps.sequence();
    ASSERT_TRUE(before);
    for (int c = 0; c < reply.cascades_size(); ++c) {
        const std::span<const std::byte> bytes = maps.map(c);
        const std::span<const float> depths(reinterpret_cast<const float*>(bytes.data()), bytes.size() / sizeof(float));
        ASSERT_EQ(world::hashValues(depths), reply.cascades(c).working_hash()) << "cascade " << c << ", frame " << reply.frame();
    }
    EXPECT_EQ(maps.sequence(), before) << "nobody wrote meanwhile";
}

TEST(Share, HoldsWhatTheHashesSayAfterEachFrame) {
    const Running running(sharing());
    server::Client client = running.client();
    v1::OpenSession open = openShared();
    open.set_moving_sun(true);
    const auto session = client.session(open);
    ASSERT_TRUE(session) << session.error().what;
    std::shared_ptr<server::SharedMaps> maps;
    for (uint64_t k = 0; k < 40; ++k) {
        v1::Frame frame = withHashes(k);
        if (k == 15) tests::put(frame.mutable_sun(), {0.1, -0.9, 0.5});  // the maps of another direction are shown some frames later
        const auto reply = session.value()->frame(frame);
        ASSERT_TRUE(reply) << reply.error().what;
        EXPECT_EQ(reply.value().share_token().empty(), k > 0);
        if (k == 0) {
            auto fetched = server::fetchShared(session.value()->opened().share_socket(), reply.value().share_token());
            ASSERT_TRUE(fetched) << fetched.error().what;
            maps = std::move(fetched.value());
            EXPECT_EQ(maps->shape(), (server::SharedShape{3, 256, 4}));
        }
        expectHashes(*maps, reply.value());
    }
    ASSERT_TRUE(session.value()->close());
    tests::expectSilence();
}

TEST(Share, UnitsAreSharedAsUnits) {
    const Running running(sharing());
    server::Client client = running.client();
    v1::OpenSession open = openShared();
    open.set_depth16(true);
    const auto session = client.session(open);
    ASSERT_TRUE(session) << session.error().what;
    const auto reply = session.value()->frame(lifeFrame(0));
    ASSERT_TRUE(reply);
    const auto maps = server::fetchShared(session.value()->opened().share_socket(), reply.value().share_token());
    ASSERT_TRUE(maps);
    v1::GetDepthMapRequest request;
    request.set_session(session.value()->opened().session());
    request.set_cascade(2);
    request.set_working(true);
    request.set_tile(256);
    const auto tiles = client.depthMap(request);
    ASSERT_TRUE(tiles);
    const auto* units = reinterpret_cast<const uint16_t*>(maps.value()->map(2).data());
    const auto* depths = reinterpret_cast<const float*>(tiles.value().front().depths().data());
    size_t casts = 0;
    for (size_t i = 0; i < 256 * 256; ++i) {
        ASSERT_EQ(float(units[i]) / 65535.0f, depths[i]) << i;
        casts += units[i] < 65535;
    }
    EXPECT_GT(casts, 1000u);
}

TEST(Share, ATokenIsGoodOnceAndOthersNever) {
    const Running running(sharing());
    server::Client client = running.client();
    const auto session = client.session(openShared());
    ASSERT_TRUE(session);
    const auto reply = session.value()->frame(lifeFrame(0));
    const std::string path = session.value()->opened().share_socket(), token = reply.value().share_token();
    const auto refused = [&](const std::string& shown) { return server::fetchShared(path, shown).error().code == world::ErrorCode::kNotFound; };
    EXPECT_TRUE(refused(""));
    EXPECT_TRUE(refused("short"));
    EXPECT_TRUE(refused(std::string(32, '0')));
    EXPECT_TRUE(refused(session.value()->opened().session())) << "the session's own secret is another";
    ASSERT_TRUE(server::fetchShared(path, token));
    EXPECT_TRUE(refused(token));
    const auto other = client.session(openShared());
    ASSERT_TRUE(other);
    const auto theirs = other.value()->frame(lifeFrame(0));
    ASSERT_TRUE(other.value()->close());
    for (int i = 0; i < 500 && running.service->sessions() > 1; ++i) std::this_thread::sleep_for(std::chrono::milliseconds(10));
    EXPECT_TRUE(refused(theirs.value().share_token())) << "its session has ended";
    struct stat status{};
    ASSERT_EQ(::stat(path.c_str(), &status), 0);
    EXPECT_EQ(status.st_mode & 0777, 0600u) << "nobody else's to reach";
}

TEST(Share, ReadersCannotWriteOrShrinkIt) {
    const Running running(sharing());
    server::Client client = running.client();
    const auto session = client.session(openShared());
    const auto reply = session.value()->frame(lifeFrame(0));
    const auto maps = server::fetchShared(session.value()->opened().share_socket(), reply.value().share_token());
    ASSERT_TRUE(maps);
    const int descriptor = maps.value()->descriptor();
    EXPECT_EQ(::mmap(nullptr, 4096, PROT_READ | PROT_WRITE, MAP_SHARED, descriptor, 0), MAP_FAILED);
    EXPECT_EQ(::ftruncate(descriptor, 0), -1);
    EXPECT_EQ(::pwrite(descriptor, "x", 1, 0), -1);
    EXPECT_EQ(::fcntl(descriptor, F_ADD_SEALS, F_SEAL_WRITE), -1);
    EXPECT_TRUE(session.value()->frame(lifeFrame(1)));
}

TEST(Share, MemoryThatIsNoneIsRefused) {
    const auto refused = [](const std::string& bytes, off_t size) {
        const int descriptor = ::memfd_create("none", MFD_CLOEXEC);
        EXPECT_EQ(::write(descriptor, bytes.data(), bytes.size()), ssize_t(bytes.size()));
        EXPECT_EQ(::ftruncate(descriptor, size), 0);
        return !server::SharedMaps::read(descriptor);
    };
    EXPECT_TRUE(refused("", 0));
    EXPECT_TRUE(refused("", 8192));
    const auto good = server::SharedMaps::create({2, 64, 4});
    ASSERT_TRUE(good);
    std::string header(reinterpret_cast<const char*>(good.value()->memory().data()), 64);
    const auto size = off_t(good.value()->memory().size());
    EXPECT_FALSE(refused(header, size));
    EXPECT_TRUE(refused(header, size - 1));
    const uint32_t wild = 0xffffffff;
    for (const size_t at : {16u, 20u, 24u}) {
        std::string other = header;
        std::memcpy(other.data() + at, &wild, 4);
        EXPECT_TRUE(refused(other, size)) << at;
    }
}

TEST(Share, IsOffUnlessTheServerWasToldSo) {
    const Running running;
    server::Client client = running.client();
    const auto refused = client.session(openShared());
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, world::ErrorCode::kUsage);
    EXPECT_NE(refused.error().what.find("--share"), std::string::npos) << refused.error().what;
    server::ServiceConfig config = tests::serviceConfig();
    config.share = std::string(200, 'x');
    const auto host = tests::localHost();
    EXPECT_FALSE(server::Service::start(*host, config, {}));
}

}  // namespace
