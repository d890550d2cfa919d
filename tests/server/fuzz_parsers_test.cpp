// Random changes of what the service's other parsers read: HTTP, lines between front end and worker, tokens, option files.
#include <CLI/CLI.hpp>
#include <sys/socket.h>
#include <sys/un.h>

#include <fstream>
#include <thread>

#include "server/http_server.h"
#include "server/live_board.h"
#include "server/share_socket.h"
#include "server/worker.pb.h"
#include "server/worker_loop.h"
#include "tests/server/mutator.h"
#include "tests/server/socket.h"
#include "tools/option_file.h"
#include "tools/serve_command.h"

namespace {

using tests::kFuzzTime;
using tests::Mutator;
namespace wire = gnomon::worker;

bool within(std::chrono::steady_clock::time_point begin) { return std::chrono::steady_clock::now() < begin + kFuzzTime; }

TEST(FuzzParsers, HttpRequestsAreAnsweredOrRefused) {
    server::LiveBoard board;
    const auto http = server::HttpServer::start(board, {});
    ASSERT_TRUE(http);
    const uint16_t port = http.value()->port();
    const std::string sound = "GET /events?session=1 HTTP/1.1\r\nHost: localhost\r\nContent-Length: 0\r\nLast-Event-ID: 7\r\nConnection: close\r\n\r\n",
                      other = "HEAD /metrics HTTP/1.0\r\nTransfer-Encoding: chunked\r\nExpect: 100-continue\r\n\r\n";
    Mutator mutator(3);
    uint64_t answered = 0, served = 0, asked = 0;
    for (const auto begin = std::chrono::steady_clock::now(); within(begin); ++asked) {
        std::string text = sound;
        mutator.change(text, other);
        tests::Socket socket(port);
        ASSERT_TRUE(socket.connected());
        socket.say(text);
        socket.end();
        const std::string heard = socket.hear("\r\n", std::chrono::seconds(5));
        answered += heard.starts_with("HTTP/1.") ? 1 : 0;
        served += heard.find(" 200 ") != std::string::npos ? 1 : 0;
        ASSERT_TRUE(heard.empty() || heard.starts_with("HTTP/1.")) << heard;
    }
    EXPECT_GT(answered, asked / 2);
    EXPECT_GT(served, 0u) << "some changes do not matter";
    tests::Socket last(port);
    last.say("GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
    EXPECT_TRUE(last.hear().starts_with("HTTP/1.1 200"));
}

/// A worker on a thread of its own, and its front end's end of the line.
struct Line {
    explicit Line(server::SessionHost& host) {
        EXPECT_EQ(::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends), 0);
        thread = std::thread([this, &host] {
            ended = server::runWorker(host, ends[1]);
            ::shutdown(ends[1], SHUT_RDWR);
        });
        wire::Reply hello;
        EXPECT_TRUE(server::receiveMessage(ends[0], hello));
    }
    ~Line() {
        ::shutdown(ends[0], SHUT_RDWR);
        thread.join();
        for (const int end : ends) ::close(end);
    }
    int ends[2]{};
    std::optional<world::Result<world::Done>> ended;
    std::thread thread;
};

TEST(FuzzParsers, LinesOfAWorkerAreAnsweredOrEndIt) {
    const auto host = tests::localHost(tests::validatedDevice());
    wire::Request open, frame;
    *open.mutable_open() = tests::openStreets();
    open.mutable_open()->set_cascades(2);
    open.mutable_open()->set_side(64);
    open.set_session(1);
    frame.set_session(1);
    Mutator mutator(4);
    std::optional<Line> line;
    uint64_t replies = 0, refusals = 0, ends = 0;
    const auto begin = std::chrono::steady_clock::now();
    for (uint64_t k = 0; within(begin); ++k) {
        if (!line) {
            line.emplace(*host);
            wire::Reply reply;
            ASSERT_TRUE(server::sendMessage(line->ends[0], open));
            ASSERT_TRUE(server::receiveMessage(line->ends[0], reply));
            ASSERT_FALSE(reply.has_error()) << reply.error().what();
        }
        *frame.mutable_frame() = tests::richFrame(k);
        std::string bytes = frame.SerializeAsString();
        mutator.change(bytes, k % 5 == 0 ? open.SerializeAsString() : bytes);
        const auto length = uint32_t(bytes.size());
        bytes.insert(0, reinterpret_cast<const char*>(&length), 4);
        ASSERT_EQ(::send(line->ends[0], bytes.data(), bytes.size(), MSG_NOSIGNAL), ssize_t(bytes.size()));
        wire::Reply reply;
        if (server::receiveMessage(line->ends[0], reply)) {
            ++replies;
            refusals += reply.has_error() ? 1 : 0;
            ASSERT_TRUE(!reply.has_error() || !reply.error().what().empty());
            continue;
        }
        line->thread.join();
        line->thread = std::thread([] {});
        ASSERT_TRUE(line->ended && !*line->ended);
        EXPECT_EQ(line->ended->error().code, world::ErrorCode::kBadData) << line->ended->error().what;
        line.reset();
        ++ends;
    }
    EXPECT_GT(replies, refusals);
    EXPECT_GT(refusals, 0u);
    EXPECT_GT(ends, 0u);
}

TEST(FuzzParsers, TokensThatAreNoneGetNothing) {
    const std::string path = tests::temporary("share");
    const auto socket = server::ShareSocket::listen(path);
    ASSERT_TRUE(socket);
    auto maps = server::SharedMaps::create({.cascades = 1, .side = 64, .texelBytes = 4});
    ASSERT_TRUE(maps);
    const std::string token(32, 'a');
    socket.value()->offer(token, std::move(maps.value()));
    Mutator mutator(5);
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::strncpy(address.sun_path, path.c_str(), sizeof address.sun_path - 1);
    uint64_t asked = 0;
    for (const auto begin = std::chrono::steady_clock::now(); within(begin); ++asked) {
        std::string shown = token;
        do mutator.change(shown, std::string(64, '\0'));
        while (shown.starts_with(token));
        const int client = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
        ASSERT_EQ(::connect(client, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
        ::send(client, shown.data(), shown.size(), MSG_NOSIGNAL);
        ::shutdown(client, SHUT_WR);
        EXPECT_FALSE(server::receiveDescriptor(client));
        ::close(client);
    }
    EXPECT_GT(asked, 100u);
    EXPECT_TRUE(server::fetchShared(path, token)) << "and it is still there for who has it";
}

TEST(FuzzParsers, OptionFilesAreTakenOrRefusedByName) {
    const std::string sound = "worlds = \"/srv/worlds\"\nlisten = \"127.0.0.1:7311\"\nsessions = 16\nmap-mib = 512.5\nhttp = 0\nidle-seconds = 1e2\n",
                      other = "[[a]]\nb.c = {d=[1,2.5,'x']}\n\"\"\"t\n\"\"\"\ninf nan 0x7f 1979-05-27T07:32:00Z \\u00e9";
    const std::string path = tests::temporary("options.toml");
    Mutator mutator(6);
    uint64_t taken = 0, refused = 0;
    for (const auto begin = std::chrono::steady_clock::now(); within(begin);) {
        std::string text = sound;
        mutator.change(text, other);
        std::ofstream(path, std::ios::binary | std::ios::trunc) << text;
        CLI::App app;
        const tools::Command command = tools::addServeCommand(app);
        const auto read = tools::readOptionFile(*command.parser, path);
        ++(read ? taken : refused);
        if (read) continue;
        ASSERT_EQ(read.error().code, world::ErrorCode::kUsage) << read.error().what;
        ASSERT_TRUE(read.error().what.starts_with(path + ":")) << read.error().what;
    }
    std::printf("%llu taken, %llu refused\n", static_cast<unsigned long long>(taken), static_cast<unsigned long long>(refused));
    EXPECT_GT(taken, refused / 100);  // was 5 in 100
    EXPECT_GT(refused, 0u);
}

}  // namespace
