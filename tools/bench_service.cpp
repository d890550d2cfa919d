#include "tools/bench_service.h"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <mutex>
#include <random>
#include <thread>

#include "server/client.h"
#include "server/live_board.h"
#include "server/session.h"
#include "server/stopwatch.h"
#include "server/world_folder.h"
#include "tools/bench_motion.h"
#include "tools/summary.h"
#include "tools/temporary_folder.h"

namespace tools {
namespace {

namespace fs = std::filesystem;
namespace v1 = gnomon::v1;
using world::Error;
using world::ErrorCode;
using world::Result;

constexpr size_t kPoints = 1'000'000;  ///< of a question
constexpr size_t kStretch = 30;        ///< frames
constexpr size_t kPace = 60;           ///< poses of one session's stretch
constexpr size_t kRefused = 2000, kRefusedRested = 200;  ///< frames that draw nothing
constexpr std::chrono::milliseconds kRest{6};            ///< between such: about what a drawn frame takes
constexpr double kStartSeconds = 30;   ///< for the service to come up
constexpr double kReach = 80;          ///< points lie so far from the eye [m]
constexpr double kOverheadMs = 0.5, kPointsPerSecond = 1e6, kFair = 2, kGrowth = 1.05;

/// `gnomon serve`, the program beside this one, as long as it lives.
class Served {
public:
    static Result<std::unique_ptr<Served>> start(const std::string& worldFolder, size_t sessions) {
        auto made = std::make_unique<Served>();
        if (made->scratch_.path().empty()) return Error{ErrorCode::kIo, "no temporary folder can be made: check TMPDIR"};
        std::error_code error;
        const std::string program = fs::read_symlink("/proc/self/exe", error).parent_path() / "gnomon";
        std::vector<std::string> words{program,   "serve",        "--worlds",   worldFolder,
                                       "--listen", made->address(), "--sessions", std::to_string(sessions)};
        std::vector<char*> arguments;
        for (std::string& word : words) arguments.push_back(word.data());
        arguments.push_back(nullptr);
        posix_spawn_file_actions_t actions;
        posix_spawn_file_actions_init(&actions);
        posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
        const int failed = ::posix_spawn(&made->pid_, program.c_str(), &actions, nullptr, arguments.data(), environ);
        posix_spawn_file_actions_destroy(&actions);
        if (failed != 0) return Error{ErrorCode::kNotFound, program + ": build it; it is what is measured"};
        auto client = server::Client::connect(made->address());
        if (!client) return client.error();
        if (const auto up = client.value().healthy(kStartSeconds); !up) return up.error();
        for (const auto& thread : fs::directory_iterator(format("/proc/%d/task", made->pid_)))
            if (pid_t child = 0; std::ifstream(thread.path() / "children") >> child) made->worker_ = child;
        if (made->worker_ == 0) return Error{ErrorCode::kNotFound, "the service has no worker"};
        return made;
    }
    ~Served() {
        if (pid_ <= 0) return;
        ::kill(pid_, SIGTERM);
        ::waitpid(pid_, nullptr, 0);
    }
    std::string address() const { return "unix:" + scratch_.path() + "/socket"; }
    pid_t front() const { return pid_; }
    pid_t worker() const { return worker_; }  ///< of the front end, what draws

private:
    TemporaryFolder scratch_;
    pid_t pid_ = 0, worker_ = 0;
};

v1::Frame frameOf(const world::Pose& pose, double time) {
    v1::Frame frame;
    frame.set_time(time);
    v1::Camera* camera = frame.add_cameras();
    camera->mutable_position()->set_x(pose.position.x);
    camera->mutable_position()->set_y(pose.position.y);
    camera->mutable_position()->set_z(pose.position.z);
    camera->mutable_orientation()->set_x(pose.orientation.x);
    camera->mutable_orientation()->set_y(pose.orientation.y);
    camera->mutable_orientation()->set_z(pose.orientation.z);
    camera->mutable_orientation()->set_w(pose.orientation.w);
    return frame;
}

std::string pointsAround(glm::dvec3 eye) {
    std::mt19937_64 rng(7);
    std::vector<glm::dvec3> points(kPoints);
    for (glm::dvec3& p : points)
        for (int axis = 0; axis < 3; ++axis)
            p[axis] = eye[axis] + (axis == 1 ? 0.05 : 1) * kReach * (2 * double(rng() >> 11) / double(1ull << 53) - 1);
    return {reinterpret_cast<const char*>(points.data()), points.size() * sizeof points[0]};
}

}  // namespace

Result<ServiceCost> measureService(const std::string& world, std::span<const world::Pose> poses, int questions) {
    const fs::path file = fs::absolute(world);
    auto device = gpu::Device::create({});
    if (!device) return device.error();
    v1::OpenSession open;
    open.set_world(file.stem().string());
    const server::SessionLimits limits;

    const auto folder = server::WorldFolder::create(file.parent_path().string());
    if (!folder) return folder.error();
    const auto opened = folder.value()->open(open.world());
    if (!opened) return opened.error();
    const auto direct = server::Session::open(*device.value(), opened.value()->store, open, limits);
    const auto directWaits = server::Session::open(*device.value(), opened.value()->store, open, limits);
    if (!direct) return direct.error();
    if (!directWaits) return directWaits.error();

    server::LiveBoard board;
    const auto shown = server::Session::open(*device.value(), opened.value()->store, open, limits);
    const auto watched = server::Session::open(*device.value(), opened.value()->store, open, limits);
    if (!shown) return shown.error();
    if (!watched) return watched.error();
    shown.value()->show(board.open("shown", open.world()));
    server::LiveSession live = board.open("watched", open.world());
    const server::LiveId watchedId = live.id();
    watched.value()->show(std::move(live));
    const auto served = Served::start(file.parent_path().string(), 4);
    if (!served) return served.error();
    auto client = server::Client::connect(served.value()->address());
    if (!client) return client.error();
    const auto wired = client.value().session(open);
    const auto wiredWaits = client.value().session(open);
    if (!wired) return wired.error();
    if (!wiredWaits) return wiredWaits.error();

    ServiceCost cost;
    const auto timed = [](std::vector<double>& times, const auto& call) {
        const server::Stopwatch watch;
        auto reply = call();
        times.push_back(watch.ms());
        return reply;
    };
    uint64_t seen = 0;
    struct Lane {
        FrameTimes& times;
        std::function<Result<v1::FrameReply>(const v1::Frame&)> frame;
        bool waits = false;
    };
    const std::vector<Lane> lanes{{cost.direct, [&](const v1::Frame& f) { return direct.value()->frame(f); }},
                                  {cost.shown, [&](const v1::Frame& f) { return shown.value()->frame(f); }},
                                  {cost.watched, [&](const v1::Frame& f) { return watched.value()->frame(f); }},
                                  {cost.served, [&](const v1::Frame& f) { return wired.value()->frame(f); }},
                                  {cost.directWaited, [&](const v1::Frame& f) { return directWaits.value()->frame(f); }, true},
                                  {cost.servedWaited, [&](const v1::Frame& f) { return wiredWaits.value()->frame(f); }, true}};
    // In stretches: a frame follows others of its own kind, as it does in use, and what the machine does meanwhile befalls all.
    for (size_t first = 0; first < poses.size(); first += kStretch)
        for (size_t turn = 0; turn < lanes.size(); ++turn) {
            const Lane& lane = lanes[(turn + first / kStretch) % lanes.size()];
            for (size_t k = first; k < std::min(first + kStretch, poses.size()); ++k) {
                v1::Frame frame = frameOf(poses[k], double(k) / kBenchFps);
                frame.mutable_wants()->set_gpu_time(lane.waits);
                const auto reply = timed(lane.times.all, [&] { return lane.frame(frame); });
                if (!reply) return reply.error();
                lane.times.drawn.push_back(reply.value().times().advance());
                lane.times.rest.push_back(lane.times.all.back() - lane.times.drawn.back());
                if (&lane.times == &cost.watched) seen = board.news(watchedId, seen)->frames.back().number;
            }
        }
    const v1::Frame nowhere;  // without a camera: it is refused, and what it takes is the way there and back
    for (size_t k = 0; k < kRefused + kRefusedRested; ++k) {
        const bool rested = k >= kRefused;
        if (rested) std::this_thread::sleep_for(kRest);
        if (const auto reply = timed(rested ? cost.refusedRested : cost.refused, [&] { return wired.value()->frame(nowhere); }); !reply) return reply.error();
    }
    v1::QueryShadowRequest query;
    query.set_points(pointsAround(poses.back().position));
    cost.points = kPoints;
    for (int round = 0; round < questions; ++round) {
        if (const auto done = timed(cost.directQuery, [&] { return direct.value()->query(query); }); !done) return done.error();
        v1::QueryShadowRequest asked = query;
        asked.set_session(wired.value()->opened().session());
        if (const auto done = timed(cost.servedQuery, [&] { return client.value().query(asked); }); !done) return done.error();
    }
    return cost;
}

std::string serviceText(const ServiceCost& cost) {
    const auto row = [](const char* name, const FrameTimes& ms, const FrameTimes& beside) {
        return format("%-34s %8.3f ms  %+8.3f ms  drawing %8.3f ms, the rest %8.3f ms\n", name, median(ms.all),
                      median(ms.all) - median(beside.all), median(ms.drawn), median(ms.rest));
    };
    const auto rate = [&](const std::vector<double>& ms) { return double(cost.points) / median(ms) / 1e3; };
    return format("median of %zu frames\n", cost.direct.all.size()) + row("in process", cost.direct, cost.direct) +
           row("on the live board", cost.shown, cost.direct) + row("served", cost.served, cost.direct) +
           row("in process, waiting for the GPU", cost.directWaited, cost.directWaited) +
           row("watched on the live board", cost.watched, cost.directWaited) +
           row("served, waiting for the GPU", cost.servedWaited, cost.directWaited) +
           format("served, refused, one after the other %6.3f ms\nserved, refused, with a rest between %6.3f ms\n", median(cost.refused), median(cost.refusedRested)) +
           format("median of %zu questions of %zu points\n", cost.directQuery.size(), cost.points) +
           format("in process                         %8.2f million points a second\n", rate(cost.directQuery)) +
           format("served                             %8.2f million points a second\n", rate(cost.servedQuery));
}

std::vector<Goal> serviceGoals(const ServiceCost& cost) {
    const double more = median(cost.served.all) - median(cost.direct.all), rate = double(cost.points) / median(cost.servedQuery) * 1e3;
    return {{"service: a frame at most 0.5 ms above one in process", format("%.3f ms", more), more <= kOverheadMs},
            {"service: at least 1 million points a second", format("%.2f million", rate / 1e6), rate >= kPointsPerSecond}};
}

Result<CrowdCost> measureCrowd(const std::string& world, std::span<const world::Pose> poses, const CrowdConfig& config) {
    rlimit files{};
    if (::getrlimit(RLIMIT_NOFILE, &files) == 0) {
        files.rlim_cur = files.rlim_max;
        ::setrlimit(RLIMIT_NOFILE, &files);
    }
    const fs::path file = fs::absolute(world);
    const auto served = Served::start(file.parent_path().string(), config.sessions);
    if (!served) return served.error();
    std::vector<server::Client> idle;
    for (size_t i = 0; i < config.idle; ++i) {
        auto client = server::Client::connect(served.value()->address());
        if (!client) return client.error();
        if (const auto there = client.value().healthy(); !there) return Error{ErrorCode::kIo, "idle connection " + std::to_string(i) + ": " + there.error().what};
        idle.push_back(std::move(client.value()));
    }
    CrowdCost cost;
    cost.frames.assign(config.sessions, 0);
    std::atomic<bool> over = false;
    std::mutex mutex;
    const auto fail = [&](const Error& error) {
        const std::lock_guard lock(mutex);
        if (cost.errors++ == 0) cost.firstError = error.what;
    };
    const auto live = [&](size_t number) {
        auto client = server::Client::connect(served.value()->address());
        if (!client) return fail(client.error());
        v1::OpenSession open;
        open.set_world(file.stem().string());
        open.set_side(512);
        open.set_cascades(3);
        open.set_far(200);
        const auto session = client.value().session(open);
        if (!session) return fail(session.error());
        for (uint64_t k = 0; !over; ++k) {
            // To and fro over a stretch of its own: memory that still grows where each place was visited before is lost.
            const size_t turn = k % (2 * kPace), along = turn < kPace ? turn : 2 * kPace - turn;
            const size_t at = (number * poses.size() / config.sessions + along) % poses.size();
            const auto reply = session.value()->frame(frameOf(poses[at], double(k) / kBenchFps));
            if (!reply) return fail(reply.error());
            if (reply.value().errors_size() > 0) fail({ErrorCode::kBadData, reply.value().errors(0).what()});
            ++cost.frames[number];
        }
        if (const auto closed = session.value()->close(); !closed) fail(closed.error());
    };
    const server::Stopwatch watch;
    std::vector<std::thread> threads;
    for (size_t n = 0; n < config.sessions; ++n) threads.emplace_back(live, n);
    std::this_thread::sleep_for(std::chrono::duration<double>(config.seconds / 4));
    cost.frontThen = memory(served.value()->front()).nowMiB;
    cost.workerThen = memory(served.value()->worker()).nowMiB;
    std::this_thread::sleep_for(std::chrono::duration<double>(config.seconds * 3 / 4));
    cost.frontNow = memory(served.value()->front()).nowMiB;
    cost.workerNow = memory(served.value()->worker()).nowMiB;
    cost.seconds = watch.ms() / 1e3;
    over = true;
    for (std::thread& thread : threads) thread.join();
    for (size_t i = 0; i < idle.size(); ++i)
        if (const auto there = idle[i].healthy(); !there) fail(there.error());
    return cost;
}

std::string crowdText(const CrowdCost& cost, const CrowdConfig& config) {
    uint64_t all = 0;
    for (const uint64_t n : cost.frames) all += n;
    const auto [least, most] = std::minmax_element(cost.frames.begin(), cost.frames.end());
    return format("%zu sessions, %zu idle connections, %.0f s: %llu frames, %.0f a second; of one session %llu to %llu; %llu errors%s%s\n"
                  "memory after a quarter of the time, and at its end: front end %.0f and %.0f MiB, worker %.0f and %.0f MiB\n",
                  config.sessions, config.idle, cost.seconds, static_cast<unsigned long long>(all), double(all) / cost.seconds,
                  static_cast<unsigned long long>(*least), static_cast<unsigned long long>(*most),
                  static_cast<unsigned long long>(cost.errors), cost.errors > 0 ? ", the first: " : "", cost.firstError.c_str(),
                  cost.frontThen, cost.frontNow, cost.workerThen, cost.workerNow);
}

std::vector<Goal> crowdGoals(const CrowdCost& cost) {
    const auto [least, most] = std::minmax_element(cost.frames.begin(), cost.frames.end());
    const double ratio = *least > 0 ? double(*most) / double(*least) : 1e9;
    const double growth = (cost.frontNow + cost.workerNow) / (cost.frontThen + cost.workerThen);
    return {{"sessions: no error", std::to_string(cost.errors), cost.errors == 0},
            {"sessions: nobody has twice another's frames", format("%.2f", ratio), ratio <= kFair},
            {"sessions: memory within a twentieth of what it was", format("%.3f", growth), growth <= kGrowth}};
}

}  // namespace tools
