// A front end whose worker is killed, loses its device, hangs or cannot start: clients see none of it but the time it takes.
#include "server/worker_host.h"

#include <signal.h>

#include <atomic>
#include <chrono>
#include <thread>

#include "server/share_socket.h"
#include "tests/server/clients.h"
#include "world/hash.h"

namespace {

using tests::lifeFrame;
using tests::openStreets;
using tests::Running;
namespace v1 = gnomon::v1;

/// A worker that is the program itself, and a service before it.
struct Supervised {
    /// `more`: arguments of a start, counted from 1.
    explicit Supervised(std::function<std::vector<std::string>(uint64_t)> more = {}) {
        server::WorkerConfig config;
        config.command = [=](uint64_t start) {
            std::vector<std::string> words{GNOMON_BINARY, "serve", "--worlds", tests::servedFolder(), "--geometry-mib", "16", "--worker"};
            if (more)
                for (const std::string& word : more(start)) words.push_back(word);
            return words;
        };
        auto started = server::Worker::start(config, [](const std::string&) {});
        if (!started) throw std::runtime_error(started.error().what);
        worker = std::move(started.value());
        server::ServiceConfig front = tests::serviceConfig();
        front.record = tests::temporary("front");
        front.keepRecordings = false;
        front.share = tests::temporary("front.sock");
        std::filesystem::create_directory(front.record);
        recordings = front.record;
        running.emplace(front, server::makeWorkerHost(*worker, [this](uint64_t, const std::string&) { ++resumed; }));
    }
    std::unique_ptr<server::Worker> worker;
    std::atomic<int> resumed = 0;
    std::string recordings;
    std::optional<Running> running;
};

std::vector<std::string> undisturbed(uint64_t frames) {
    const Running running;
    server::Client client = running.client();
    const auto session = client.session(openStreets());
    std::vector<std::string> replies;
    for (uint64_t k = 0; k < frames; ++k) replies.push_back(tests::deterministic(session.value()->frame(lifeFrame(k)).value()));
    return replies;
}

double seconds(std::chrono::steady_clock::time_point since) {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - since).count();
}

TEST(Worker, KilledInTheMiddleOfFramesItIsMissedByNobody) {
    const std::vector<std::string> expected = undisturbed(40);
    Supervised supervised;
    server::Client client = supervised.running->client();
    const auto one = client.session(openStreets()), other = client.session(openStreets());
    ASSERT_TRUE(one && other);
    v1::QueryShadowRequest query;
    query.set_session(other.value()->opened().session());
    const double point[3] = {1, 0.1, 2};
    query.set_points(point, sizeof point);
    int killed = 0;
    for (uint64_t k = 0; k < 40; ++k) {
        const auto start = std::chrono::steady_clock::now();
        ASSERT_TRUE(one.value()->send(lifeFrame(k)));
        if (k == 0 || k == 9 || k == 27) {
            std::this_thread::sleep_for(std::chrono::microseconds(500 * k));
            const pid_t pid = supervised.worker->pid();
            ASSERT_GT(pid, 0);
            ASSERT_EQ(::kill(pid, SIGKILL), 0);
            ++killed;
        }
        const auto reply = one.value()->receive();
        ASSERT_TRUE(reply) << "frame " << k << ": " << reply.error().what;
        ASSERT_EQ(tests::deterministic(reply.value()), expected[k]) << "frame " << k;
        EXPECT_LT(seconds(start), 5) << "frame " << k;
        const auto second = other.value()->frame(lifeFrame(k));
        ASSERT_TRUE(second) << "frame " << k << ": " << second.error().what;
        ASSERT_EQ(tests::deterministic(second.value()), expected[k]) << "frame " << k;
    }
    const auto before = client.query(query);
    ASSERT_TRUE(before) << before.error().what;
    ASSERT_EQ(::kill(supervised.worker->pid(), SIGKILL), 0);
    std::this_thread::sleep_for(std::chrono::milliseconds(100));  // nobody asked: it is seen all the same
    const auto after = client.query(query);
    ASSERT_TRUE(after) << after.error().what;
    EXPECT_EQ(after.value().SerializeAsString(), before.value().SerializeAsString());
    EXPECT_GE(supervised.resumed, killed) << "each kill cost each session that had frames a repetition";
    ASSERT_TRUE(one.value()->close());
    ASSERT_TRUE(other.value()->close());
    ASSERT_TRUE(supervised.running->empty());
    EXPECT_TRUE(std::filesystem::is_empty(supervised.recordings));
}

TEST(Worker, TheNextOneSharesOtherMemory) {
    Supervised supervised;
    server::Client client = supervised.running->client();
    v1::OpenSession open = openStreets();
    open.set_share_maps(true);
    const auto session = client.session(open);
    ASSERT_TRUE(session) << session.error().what;
    std::shared_ptr<server::SharedMaps> maps;
    int fetched = 0;
    for (uint64_t k = 0; k < 12; ++k) {
        if (k == 6) { ASSERT_EQ(::kill(supervised.worker->pid(), SIGKILL), 0); }
        v1::Frame frame = lifeFrame(k);
        frame.mutable_wants()->set_hashes(true);
        const auto reply = session.value()->frame(frame);
        ASSERT_TRUE(reply) << reply.error().what;
        if (!reply.value().share_token().empty()) {
            auto found = server::fetchShared(session.value()->opened().share_socket(), reply.value().share_token());
            ASSERT_TRUE(found) << found.error().what;
            maps = std::move(found.value());
            ++fetched;
        }
        const std::span<const std::byte> bytes = maps->map(1);
        EXPECT_EQ(maps->frame(), k);
        EXPECT_EQ(world::hashValues(std::span(reinterpret_cast<const float*>(bytes.data()), bytes.size() / 4)), reply.value().cascades(1).working_hash()) << k;
    }
    EXPECT_EQ(fetched, 2);
}

TEST(Worker, ALostDeviceIsLeftToTheNextOne) {
    const std::vector<std::string> expected = undisturbed(30);
    Supervised supervised([](uint64_t start) { return start == 1 ? std::vector<std::string>{"--lose-device-after", "17"} : std::vector<std::string>{}; });
    server::Client client = supervised.running->client();
    const auto session = client.session(openStreets());
    ASSERT_TRUE(session);
    for (uint64_t k = 0; k < 30; ++k) {
        const auto reply = session.value()->frame(lifeFrame(k));
        ASSERT_TRUE(reply) << "frame " << k << ": " << reply.error().what;
        ASSERT_EQ(tests::deterministic(reply.value()), expected[k]) << "frame " << k;
    }
    EXPECT_EQ(supervised.resumed, 1);
}

TEST(Worker, AFrameThatKillsThreeEndsItsSessionAlone) {
    Supervised supervised([](uint64_t) { return std::vector<std::string>{"--lose-device-after", "12"}; });
    server::Client client = supervised.running->client();
    const auto session = client.session(openStreets());
    ASSERT_TRUE(session);
    uint64_t k = 0;
    for (;; ++k) {
        const auto reply = session.value()->frame(lifeFrame(k));
        if (reply) continue;
        EXPECT_EQ(reply.error().code, world::ErrorCode::kDevice) << reply.error().what;
        EXPECT_NE(reply.error().what.find("ended 3 workers"), std::string::npos) << reply.error().what;
        break;
    }
    EXPECT_GT(k, 2u);
    const auto next = client.session(openStreets());
    ASSERT_TRUE(next) << next.error().what;
    EXPECT_TRUE(next.value()->frame(lifeFrame(0)));
}

TEST(Worker, OneThatStoppedAnsweringIsReplaced) {
    const std::vector<std::string> expected = undisturbed(6);
    Supervised supervised;
    server::Client client = supervised.running->client();
    const auto session = client.session(openStreets());
    ASSERT_TRUE(session);
    for (uint64_t k = 0; k < 5; ++k) ASSERT_TRUE(session.value()->frame(lifeFrame(k)));
    ASSERT_EQ(::kill(supervised.worker->pid(), SIGSTOP), 0);
    ASSERT_TRUE(session.value()->send(lifeFrame(5)));
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    supervised.worker->discard(1);
    const auto reply = session.value()->receive();
    ASSERT_TRUE(reply) << reply.error().what;
    EXPECT_EQ(tests::deterministic(reply.value()), expected[5]);
}

TEST(Worker, EndsWithWhoStartedItAndSaysWhereItCannotStart) {
    pid_t pid = 0;
    {
        const Supervised supervised;
        pid = supervised.worker->pid();
        ASSERT_EQ(::kill(pid, 0), 0);
    }
    EXPECT_EQ(::kill(pid, 0), -1);
    server::WorkerConfig config;
    for (const char* program : {"/bin/false", "/nowhere/program"}) {
        config.command = [=](uint64_t) { return std::vector<std::string>{program}; };
        const auto refused = server::Worker::start(config, [](const std::string&) {});
        ASSERT_FALSE(refused);
        EXPECT_NE(refused.error().what.find(*program == '/' && program[1] == 'b' ? "status 1" : "No such file"), std::string::npos) << refused.error().what;
    }
}

}  // namespace
