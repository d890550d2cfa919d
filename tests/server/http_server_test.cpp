// The HTTP port against clients of every kind: what it answers, what it refuses, and that none of them can hold it up.
#include "server/http_server.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <thread>
#include <vector>

#include "tests/server/socket.h"

namespace {

using server::HttpConfig;
using server::HttpServer;
using server::LiveBoard;
using std::chrono::milliseconds;
using tests::Socket;

std::unique_ptr<HttpServer> started(LiveBoard& board, const HttpConfig& config = {}) {
    auto server = HttpServer::start(board, config);
    if (!server) throw std::runtime_error(server.error().what);
    return std::move(server.value());
}

std::string request(const std::string& target, const std::string& more = "Connection: close\r\n") {
    return "GET " + target + " HTTP/1.1\r\nHost: localhost\r\n" + more + "\r\n";
}

/// The whole answer to one request on a connection of its own.
std::string ask(uint16_t port, const std::string& text) {
    Socket socket(port);
    EXPECT_TRUE(socket.connected());
    socket.say(text);
    return socket.hear();
}

int statusOf(const std::string& answer) { return answer.starts_with("HTTP/1.") ? std::stoi(answer.substr(9, 3)) : 0; }

size_t descriptors() {
    size_t count = 0;
    for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator("/proc/self/fd")) ++count;
    return count;
}

TEST(HttpServer, AnswersAndSecures) {
    LiveBoard board;
    const auto server = started(board);
    const std::string page = ask(server->port(), request("/"));
    EXPECT_EQ(statusOf(page), 200);
    EXPECT_NE(page.find("Content-Security-Policy: default-src 'none'; script-src 'self'"), std::string::npos);
    EXPECT_NE(page.find("X-Content-Type-Options: nosniff"), std::string::npos);
    EXPECT_NE(page.find("</html>"), std::string::npos);
    EXPECT_EQ(statusOf(ask(server->port(), request("/healthz"))), 200);
    EXPECT_EQ(statusOf(ask(server->port(), request("/readyz"))), 503);
    board.setReady(true);
    EXPECT_EQ(statusOf(ask(server->port(), request("/readyz"))), 200);
    EXPECT_NE(ask(server->port(), request("/metrics")).find("# TYPE gnomon_frames_total counter"), std::string::npos);
    EXPECT_EQ(statusOf(ask(server->port(), request("/nowhere"))), 404);
    const std::string head = ask(server->port(), "HEAD / HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n");
    EXPECT_EQ(statusOf(head), 200);
    EXPECT_TRUE(head.ends_with("\r\n\r\n"));
    // Several requests on one connection, the second sent before the first is answered.
    Socket kept(server->port());
    kept.say(request("/healthz", "") + request("/readyz"));
    const std::string both = kept.hear();
    EXPECT_NE(both.find("alive"), std::string::npos);
    EXPECT_NE(both.find("ready"), std::string::npos);
}

TEST(HttpServer, RefusesWhatIsNoRequest) {
    LiveBoard board;
    const auto server = started(board);
    const std::vector<std::pair<std::string, int>> cases = {
        {"nonsense\r\n\r\n", 400},
        {"GET /\r\n\r\n", 400},
        {"GET / HTTP/3.0\r\nHost: localhost\r\n\r\n", 400},
        {"GET / HTTP/1.1\r\n\r\n", 400},
        {"GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n", 421},
        {"GET / HTTP/1.1\r\nHost: localhost.evil.example:80\r\n\r\n", 421},
        {"GET / HTTP/1.1\r\nHost: [::1]:80\r\nConnection: close\r\n\r\n", 200},
        {"GET / HTTP/1.1\r\nHost: 127.0.0.1:8080\r\nConnection: close\r\n\r\n", 200},
        {"POST / HTTP/1.1\r\nHost: localhost\r\n\r\n", 405},
        {"BREW / HTTP/1.1\r\nHost: localhost\r\n\r\n", 405},
        {"POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 5\r\n\r\nhello", 413},
        {"POST / HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n5\r\nhello\r\n", 413},
        {"GET / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1\r\nContent-Length: 2\r\n\r\n", 400},
        {"GET / HTTP/1.1\r\nHost: localhost\r\nX: " + std::string(9000, 'a') + "\r\n\r\n", 431},
        {"GET /" + std::string(20000, 'a') + " HTTP/1.1\r\nHost: localhost\r\n\r\n", 431},
        {request("/events?session=x"), 400},
    };
    for (const auto& [text, status] : cases) {
        EXPECT_EQ(statusOf(ask(server->port(), text)), status) << text.substr(0, 60);
        EXPECT_EQ(statusOf(ask(server->port(), request("/healthz"))), 200);
    }
    const std::string whole = request("/healthz");
    for (size_t length = 0; length < whole.size(); ++length) {  // cut off anywhere
        Socket socket(server->port());
        socket.say(whole.substr(0, length));
    }
    EXPECT_EQ(statusOf(ask(server->port(), whole)), 200);
}

TEST(HttpServer, StaysOnThisHost) {
    LiveBoard board;
    for (const char* address : {"0.0.0.0", "192.168.1.1", "::", "example.org", ""}) {
        const auto server = HttpServer::start(board, {.address = address});
        ASSERT_FALSE(server) << address;
        EXPECT_EQ(server.error().code, world::ErrorCode::kUsage);
    }
    const auto first = started(board);
    const auto second = HttpServer::start(board, {.port = first->port()});
    ASSERT_FALSE(second);
    EXPECT_EQ(second.error().code, world::ErrorCode::kIo);
    EXPECT_NE(second.error().what.find(std::to_string(first->port())), std::string::npos);
}

/// A byte at a time, never an end, never a word: dropped when the patience is over, and nobody else waits for them.
TEST(HttpServer, SlowAskersHoldNothingUp) {
    LiveBoard board;
    const auto server = started(board, {.patience = milliseconds(400)});
    std::vector<std::unique_ptr<Socket>> idle;
    for (int i = 0; i < 100; ++i) {
        idle.push_back(std::make_unique<Socket>(server->port()));
        idle.back()->say("GET / HT");
    }
    EXPECT_EQ(statusOf(ask(server->port(), request("/healthz"))), 200);
    Socket drip(server->port());
    const std::string text = request("/healthz");
    bool open = true;
    for (size_t k = 0; k < text.size() && open; ++k) {
        open = drip.say(text.substr(k, 1));
        std::this_thread::sleep_for(milliseconds(20));
    }
    drip.hear();
    EXPECT_TRUE(drip.closed());
    for (auto& socket : idle) {
        EXPECT_EQ(socket->hear(), "");
        EXPECT_TRUE(socket->closed());
    }
}

TEST(HttpServer, TakesSoManyConnectionsAndNoMore) {
    LiveBoard board;
    const auto server = started(board, {.connections = 4});
    std::vector<std::unique_ptr<Socket>> held;
    for (int i = 0; i < 4; ++i) {
        held.push_back(std::make_unique<Socket>(server->port()));
        held.back()->say(request("/healthz", ""));
        EXPECT_EQ(statusOf(held.back()->hear("alive\n")), 200);
    }
    EXPECT_EQ(ask(server->port(), request("/healthz")), "");  // closed
    held.pop_back();
    for (int tries = 0; tries < 100 && ask(server->port(), request("/healthz")).empty(); ++tries)
        std::this_thread::sleep_for(milliseconds(20));  // the server has to notice first
    EXPECT_EQ(statusOf(ask(server->port(), request("/healthz"))), 200);
}

TEST(HttpServer, TellsWatchersAndSoManyOnly) {
    LiveBoard board;
    const auto live = board.open("walk", "streets");
    const auto server = started(board, {.watchers = 2});
    std::vector<std::unique_ptr<Socket>> watching;
    for (int i = 0; i < 2; ++i) {
        watching.push_back(std::make_unique<Socket>(server->port()));
        watching.back()->say(request("/events"));
        const std::string heard = watching.back()->hear("event: news\n");
        EXPECT_NE(heard.find("Content-Type: text/event-stream"), std::string::npos);
        EXPECT_NE(heard.find("retry: 1000\nevent: hello\n"), std::string::npos);
        EXPECT_NE(heard.find("\nid: "), std::string::npos);
    }
    EXPECT_EQ(statusOf(ask(server->port(), request("/events"))), 503);
    watching.pop_back();
    int status = 503;
    for (int tries = 0; tries < 100 && status == 503; ++tries) {
        std::this_thread::sleep_for(milliseconds(20));  // the server has to notice first
        Socket socket(server->port());
        socket.say(request("/events"));
        status = statusOf(socket.hear("event: news\n"));
    }
    EXPECT_EQ(status, 200);
    const std::string beat = watching.front()->hear("event: beat\n", std::chrono::seconds(15));
    EXPECT_NE(beat.find("event: beat\n"), std::string::npos);  // nothing happens, and it is said
}

/// Who reads nothing is owed one event at most, and dropped.
TEST(HttpServer, DropsSlowReaders) {
    LiveBoard board;
    const auto server = started(board, {.watchers = 1, .patience = milliseconds(500)});
    std::vector<server::LiveSession> crowd;  // long news, so that the kernel's buffers fill up
    for (int i = 0; i < 200; ++i) crowd.push_back(board.open(std::string(2000, 'x'), "w"));
    Socket deaf(server->port(), 4096);
    deaf.say(request("/events"));
    deaf.hear("event: hello");
    int status = 503;
    for (int i = 0; i < 400 && status == 503; ++i) {
        crowd.push_back(board.open(std::string(2000, 'x'), "w"));  // something new to tell
        std::this_thread::sleep_for(milliseconds(25));
        Socket next(server->port());
        next.say(request("/events"));
        status = statusOf(next.hear("\r\n"));
    }
    EXPECT_EQ(status, 200);  // the place is free again
}

TEST(HttpServer, StopsWhileAllKindsAreConnected) {
    const size_t before = descriptors();
    for (int round = 0; round < 5; ++round) {
        LiveBoard board;
        const auto live = board.open("walk", "streets");
        auto server = started(board);
        Socket silent(server->port()), half(server->port()), watcher(server->port()), kept(server->port());
        half.say("GET / HTTP/1.1\r\n");
        watcher.say(request("/events"));
        watcher.hear("event: news\n");
        kept.say(request("/healthz", ""));
        kept.hear("alive\n");
        const auto begin = std::chrono::steady_clock::now();
        server.reset();
        EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(1));
        for (Socket* socket : {&silent, &half, &watcher, &kept}) {
            socket->hear();
            EXPECT_TRUE(socket->closed());
        }
    }
    EXPECT_EQ(descriptors(), before);
}

}  // namespace
