// The live page in a headless Chromium (tests/server/live_page_test.py), fed by a real system that drives through a
// small world.
#include <array>
#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <thread>

#include "server/http_server.h"
#include "server/stopwatch.h"
#include "tests/server/worlds.h"

namespace {

using server::FrameInput;
using server::HttpServer;
using server::LiveBoard;
using server::ShadowConfig;
using server::ShadowSystem;

/// Drives in a circle behind an object that moves; one at rest can be taken away.
class Drive {
public:
    Drive(LiveBoard& board, const world::WorldStore& store, const ShadowConfig& config, glm::dvec3 centre, double radius)
        : live_(board.open("drive in a circle", std::filesystem::path(store.path()).stem())), centre_(centre), radius_(radius) {
        auto made = ShadowSystem::create(tests::validatedDevice(), store, config);
        if (!made) throw std::runtime_error(made.error().what);
        system_ = std::move(made.value());
        mover_ = system_->spawn(0, tests::placedAt(centre), {}).value();
        victim_ = system_->spawn(0, tests::placedAt(centre + glm::dvec3(radius + 2, 0, 2)), {.atRest = true}).value();
    }

    void step() {
        const double time = frame_++ / 30.0, angle = 6 * time / radius_;  // 6 m/s
        const server::ObjectUpdate update{mover_, tests::placedAt(on(angle + 8 / radius_ + 0.1 * std::sin(time)))};
        if (inject.exchange(false) && !system_->remove(victim_)) throw std::runtime_error("nothing to remove");
        FrameInput input;
        input.time = time;
        input.camera.position = on(angle);
        input.camera.orientation = glm::angleAxis(-angle + 3.14159265, glm::dvec3(0, 1, 0));
        input.objects = std::span(&update, 1);
        const server::Stopwatch watch;
        auto report = system_->advance(input);
        if (!report) throw std::runtime_error(report.error().what);
        if (auto done = system_->finish(report.value()); !done) throw std::runtime_error(done.error().what);
        live_.publish(*system_, input, report.value(), watch.ms());
    }

    std::atomic<bool> inject = false;

private:
    glm::dvec3 on(double angle) const { return centre_ + radius_ * glm::dvec3(std::cos(angle), 0, std::sin(angle)); }

    server::LiveSession live_;
    glm::dvec3 centre_;
    double radius_;
    std::unique_ptr<ShadowSystem> system_;
    server::ObjectId mover_ = 0, victim_ = 0;
    int frame_ = 0;
};

ShadowConfig driving() {
    ShadowConfig config;
    config.cascades = 4;
    config.side = 256;
    config.farDistance = 70;
    config.geometryBytes = 16 << 20;
    // The chunks of the small world come for a minute, and some never.
    config.streaming.clock = world::Clock::kVirtual;
    config.streaming.disk = {.latency = 0.4, .channels = 1, .corruptShare = 0.1};
    return config;
}

/// GNOMON_PAGE_PICTURES names a folder for screenshots, GNOMON_PAGE_WORLD another world to drive through for them.
TEST(LivePage, ShowsWhatHappens) {
    LiveBoard board;
    board.setReady(true);
    const char *pictures = std::getenv("GNOMON_PAGE_PICTURES"), *other = std::getenv("GNOMON_PAGE_WORLD");
    auto opened = other ? world::WorldStore::open(other) : world::Result<world::WorldStore>(tests::baked(tests::streets({0, 0, 0}), "page.world"));
    ASSERT_TRUE(opened) << opened.error().what;
    ShadowConfig config = driving();
    if (other) {
        config.side = 1024;
        config.farDistance = 300;
        config.geometryBytes = 512u << 20;
        config.streaming = {};
    }
    Drive drive(board, opened.value(), config, {0, other ? 40 : 2, 0}, other ? 90 : 25);
    auto server = HttpServer::start(board, {});
    ASSERT_TRUE(server) << server.error().what;
    const uint16_t port = server.value()->port();

    std::atomic<bool> stop = false;
    std::thread driver([&] {
        for (auto next = std::chrono::steady_clock::now(); !stop; next += std::chrono::milliseconds(33)) {
            drive.step();
            std::this_thread::sleep_until(next);
        }
    });
    const std::string command = "/usr/bin/python3 '" GNOMON_SOURCE_DIR "/tests/server/live_page_test.py' http://localhost:" +
                                std::to_string(port) + "/" + (pictures ? std::string(" '") + pictures + "'" : "");
    FILE* page = popen(command.c_str(), "re");
    ASSERT_TRUE(page);
    std::string said;
    for (std::array<char, 1024> line; fgets(line.data(), line.size(), page);) {
        const std::string text = line.data();
        if (text == "inject\n") {
            drive.inject = true;
        } else if (text == "restart\n") {
            server.value().reset();
            std::this_thread::sleep_for(std::chrono::seconds(2));
            server = HttpServer::start(board, {.port = port});
            EXPECT_TRUE(server) << server.error().what;
        } else {
            said += text;
        }
    }
    const int status = pclose(page);
    stop = true;
    driver.join();
    if (WEXITSTATUS(status) == 77) GTEST_SKIP() << said;
    EXPECT_EQ(status, 0) << said;
    EXPECT_EQ(said, "ok\n");
    tests::expectSilence();
}

}  // namespace
