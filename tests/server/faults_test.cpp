// Clients and networks at their worst: what vanishes, dribbles, stays half open or says nonsense costs nobody else anything.
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>
#include <malloc.h>
#include <netinet/tcp.h>
#include <sys/mount.h>

#include <atomic>
#include <fstream>
#include <limits>
#include <thread>

#include "server/recording.h"
#include "tests/server/clients.h"
#include "tests/server/socket.h"

namespace {

using tests::lifeFrame;
using tests::openStreets;
using tests::Running;
using tests::serviceConfig;
using tests::Socket;
namespace v1 = gnomon::v1;

uint16_t portOf(const Running& running) {
    const std::string& address = running.service->address();
    return uint16_t(std::stoi(address.substr(address.rfind(':') + 1)));
}

size_t descriptors() {
    size_t count = 0;
    for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator("/proc/self/fd")) ++count;
    return count;
}

/// A small session's life of two frames.
void expectServed(const Running& running) {
    server::Client client = running.client();
    const auto session = client.session(openStreets());
    ASSERT_TRUE(session) << session.error().what;
    for (uint64_t k = 0; k < 2; ++k) ASSERT_TRUE(session.value()->frame(lifeFrame(k)));
    ASSERT_TRUE(session.value()->close());
}

TEST(Faults, AThousandClientsThatVanishLeaveNothing) {
    // Not the validated one: the layer keeps some 9 KB of each session's objects for good.
    const auto device = gpu::Device::create({});
    ASSERT_TRUE(device);
    Running running(serviceConfig(), tests::localHost(*device.value()));
    v1::OpenSession open = openStreets();
    open.set_side(64);
    open.set_cascades(1);
    const auto vanish = [&](int i) {
        server::Client client = running.client();
        auto session = client.session(open);
        ASSERT_TRUE(session) << i << ": " << session.error().what;
        for (int k = 0; k < i % 3; ++k) ASSERT_TRUE(session.value()->send(lifeFrame(uint64_t(k))));
        session.value().reset();  // in the middle of a frame, or before one
    };
    // Settled: gRPC closes sockets a little later, and the driver keeps 4.5 MB of a frame that was cut off until the next.
    const auto bytes = [&] {
        EXPECT_TRUE(running.empty());
        expectServed(running);
        EXPECT_TRUE(running.empty());
        std::this_thread::sleep_for(std::chrono::milliseconds(300));
        return double(::mallinfo2().uordblks);
    };
    const int batch = 200;
    const auto vanishAll = [&] {
        for (int i = 0; i < batch; ++i) vanish(i);
    };
    vanishAll();
    double before = bytes(), least = std::numeric_limits<double>::infinity();
    const size_t openBefore = descriptors();
    for (int k = 0; k < 5; ++k) {
        vanishAll();
        const double after = bytes();
        least = std::min(least, after - before);
        before = after;
    }
    EXPECT_EQ(running.told("opened"), running.told("ended"));
    EXPECT_LE(descriptors(), openBefore + 2) << "one that is being closed";
    // A leak grows with every batch; a cache grows once. The events that the test keeps take some 200 bytes for each
    // life; a leaked session takes more than its maps' 32 KiB.
    EXPECT_LT(least, batch * 1024.0);
}

/// A file system of one mebibyte, as long as it lives.
struct SmallDisk {
    std::string path = tests::temporary("small");
    bool mounted;
    SmallDisk() {
        std::filesystem::create_directory(path);
        mounted = ::mount("tmpfs", path.c_str(), "tmpfs", 0, "size=1m") == 0;
    }
    ~SmallDisk() {
        if (mounted) ::umount(path.c_str());
    }
};

TEST(Faults, AFullDiskEndsTheSessionThatIsRecordedThere) {
    const SmallDisk disk;
    if (!disk.mounted) GTEST_SKIP() << "no small file system can be mounted; run as root";
    server::ServiceConfig config = serviceConfig();
    config.record = disk.path;
    Running running(config);
    server::Client client = running.client();
    const auto session = client.session(openStreets());
    ASSERT_TRUE(session);
    std::optional<world::Error> end;
    uint64_t drawn = 0;
    for (; drawn < 10'000 && !end; ++drawn) {
        v1::Frame frame = lifeFrame(0);
        frame.set_time(double(drawn));
        for (int i = 0; i < 200; ++i) frame.add_objects();
        const auto reply = session.value()->frame(frame);
        if (!reply) end = reply.error();
    }
    ASSERT_TRUE(end);
    EXPECT_EQ(end->code, world::ErrorCode::kLimit) << end->what;
    EXPECT_NE(end->what.find(".gnomonrec: No space left"), std::string::npos) << end->what;
    EXPECT_EQ(end->what.find(disk.path), std::string::npos) << "where the folder is is nobody's business";
    ASSERT_TRUE(running.empty());
    std::string file;
    for (const auto& entry : std::filesystem::directory_iterator(disk.path)) file = entry.path().string();
    uint64_t entries = 0;
    {
        auto reader = server::RecordingReader::open(file);
        ASSERT_TRUE(reader);
        for (;; ++entries) {
            const auto entry = reader.value().next();
            ASSERT_TRUE(entry) << entry.error().what;
            if (!entry.value()) break;
        }
    }
    { std::ofstream rest(disk.path + "/rest", std::ios::binary); rest << std::string(2 << 20, 'x'); }
    const auto refused = client.session(openStreets());
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, world::ErrorCode::kLimit) << refused.error().what;
    EXPECT_EQ(refused.error().what.find(disk.path), std::string::npos) << refused.error().what;
    std::filesystem::remove(disk.path + "/rest");
    EXPECT_GT(entries, 2 * (drawn - 2)) << "whatever was answered is there";
    std::filesystem::remove(file);
    expectServed(running);
}

/// Carries what two sides say, the client's part a byte at a time.
class Dribble {
public:
    explicit Dribble(uint16_t to) : listening_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
        sockaddr_in address{};
        address.sin_family = AF_INET;
        address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        socklen_t size = sizeof address;
        ::bind(listening_, reinterpret_cast<sockaddr*>(&address), size);
        ::listen(listening_, 1);
        ::getsockname(listening_, reinterpret_cast<sockaddr*>(&address), &size);
        port = ntohs(address.sin_port);
        thread_ = std::thread([this, to] { carry(to); });
    }
    ~Dribble() {
        ::shutdown(listening_, SHUT_RDWR);
        thread_.join();
        ::close(listening_);
    }
    uint16_t port = 0;
    std::atomic<size_t> bytes = 0;  ///< of the client's

private:
    void carry(uint16_t to) {
        const int client = ::accept(listening_, nullptr, nullptr);
        if (client < 0) return;
        sockaddr_in address{};
        address.sin_family = AF_INET;
        address.sin_port = htons(to);
        address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        const int server = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
        ::connect(server, reinterpret_cast<sockaddr*>(&address), sizeof address);
        const int now = 1;
        ::setsockopt(server, IPPROTO_TCP, TCP_NODELAY, &now, sizeof now);
        char some[65536];
        pollfd ends[2] = {{client, POLLIN, 0}, {server, POLLIN, 0}};
        while (::poll(ends, 2, -1) > 0) {
            if (ends[0].revents) {
                const ssize_t n = ::recv(client, some, sizeof some, 0);
                if (n <= 0) break;
                for (ssize_t i = 0; i < n; ++i) ::send(server, some + i, 1, MSG_NOSIGNAL);
                bytes += size_t(n);
            }
            if (ends[1].revents) {
                const ssize_t n = ::recv(server, some, sizeof some, 0);
                if (n <= 0) break;
                ::send(client, some, size_t(n), MSG_NOSIGNAL);
            }
        }
        ::close(client);
        ::close(server);
    }
    const int listening_;
    std::thread thread_;
};

TEST(Faults, AByteAtATimeIsAsGoodAsAnyOther) {
    const Running running;
    std::vector<std::string> replies;
    {
        server::Client client = running.client();
        const auto session = client.session(openStreets());
        for (uint64_t k = 0; k < 12; ++k) replies.push_back(tests::deterministic(session.value()->frame(lifeFrame(k)).value()));
    }
    Dribble dribble(portOf(running));
    auto client = server::Client::connect("127.0.0.1:" + std::to_string(dribble.port));
    const auto session = client.value().session(openStreets());
    ASSERT_TRUE(session) << session.error().what;
    for (uint64_t k = 0; k < 12; ++k) {
        const auto reply = session.value()->frame(lifeFrame(k));
        ASSERT_TRUE(reply) << reply.error().what;
        ASSERT_EQ(tests::deterministic(reply.value()), replies[k]) << "frame " << k;
    }
    ASSERT_TRUE(session.value()->close());
    EXPECT_GT(dribble.bytes, 1000u);
}

TEST(Faults, ConnectionsThatStayHalfOpenEnd) {
    server::ServiceConfig config = serviceConfig();
    config.silentSeconds = 1;
    const Running running(config);
    const std::string preface = "PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n", settings("\0\0\0\4\0\0\0\0\0", 9);
    std::vector<std::unique_ptr<Socket>> sockets;
    for (int i = 0; i < 60; ++i) {
        sockets.push_back(std::make_unique<Socket>(portOf(running)));
        ASSERT_TRUE(sockets.back()->connected());
        const std::string first = i % 3 == 0 ? "" : i % 3 == 1 ? preface.substr(0, 10) : preface + settings;  // and no ping is answered
        ASSERT_TRUE(sockets.back()->say(first));
    }
    expectServed(running);
    for (size_t i = 0; i < sockets.size(); ++i) {
        sockets[i]->hear({}, std::chrono::seconds(10));
        EXPECT_TRUE(sockets[i]->closed()) << "kind " << i % 3;
    }
    expectServed(running);
}

TEST(Faults, MessagesThatAreNoneEndTheirCallAlone) {
    const Running running;
    server::Client client = running.client();
    const auto session = client.session(openStreets());
    ASSERT_TRUE(session);
    ASSERT_TRUE(session.value()->frame(lifeFrame(0)));
    const auto channel = grpc::CreateChannel(running.service->address(), grpc::InsecureChannelCredentials());
    grpc::GenericStub stub(channel);
    grpc::CompletionQueue queue;
    const auto next = [&] {
        void* tag = nullptr;
        bool ok = false;
        EXPECT_TRUE(queue.Next(&tag, &ok));
        return ok;
    };
    const std::string texts[] = {"\xff\xff\xff\xff\xff", std::string(100'000, '\x0a'), std::string(64, '\0'), "GET / HTTP/1.1\r\n\r\n"};
    for (const std::string& text : texts) {
        const grpc::Slice slice(text);
        const grpc::ByteBuffer bytes(&slice, 1);
        for (const char* method : {"/gnomon.v1.Gnomon/QueryShadow", "/gnomon.v1.Gnomon/OpenWorld", "/gnomon.v1.Gnomon/GetShadowMask",
                                   "/gnomon.v1.Gnomon/Session", "/gnomon.v1.Gnomon/Nothing"}) {
            grpc::ClientContext context;
            context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(10));
            const auto call = stub.PrepareCall(&context, method, &queue);
            call->StartCall(nullptr);
            next();
            call->WriteLast(bytes, {}, nullptr);
            next();
            grpc::ByteBuffer reply;
            call->Read(&reply, nullptr);
            EXPECT_FALSE(next()) << method;
            grpc::Status status;
            call->Finish(&status, nullptr);
            next();
            EXPECT_FALSE(status.ok()) << method;
            EXPECT_NE(status.error_code(), grpc::StatusCode::DEADLINE_EXCEEDED) << method;
        }
    }
    EXPECT_TRUE(session.value()->frame(lifeFrame(1))) << "others notice nothing";
    queue.Shutdown();
}

}  // namespace
