#include "server/worker.h"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstring>
#include <mutex>
#include <thread>
#include <utility>

#include "server/client.h"

extern char** environ;

namespace server {

using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

namespace {

using Clock = std::chrono::steady_clock;
constexpr int kInheritedAs = 3;
constexpr std::chrono::milliseconds kLook{5};           ///< between two looks at whether it lives
constexpr std::chrono::seconds kPatience{30};           ///< for a worker that serves
constexpr std::chrono::seconds kLongLife{10};           ///< of one that died of something new
constexpr std::chrono::milliseconds kLongestPause{5000};  ///< before the next start
constexpr std::chrono::seconds kLastWords{1};

std::string causeOf(int status) {
    if (WIFSIGNALED(status)) return std::string("signal ") + std::to_string(WTERMSIG(status)) + ", " + ::strsignal(WTERMSIG(status));
    return "status " + std::to_string(WEXITSTATUS(status));
}

}  // namespace

struct Worker::Impl {
    Impl(const WorkerConfig& c, std::function<void(const std::string&)> e) : config(c), onEvent(std::move(e)) {}

    /// The process, or -errno. Its standard input is a pipe whose other end only this process has.
    pid_t spawn() {
        std::vector<std::string> words = config.command(starts + 1);
        std::vector<char*> argv;
        for (std::string& word : words) argv.push_back(word.data());
        argv.push_back(nullptr);
        int ends[2];
        if (::pipe2(ends, O_CLOEXEC) != 0) return -errno;
        posix_spawn_file_actions_t actions;
        posix_spawn_file_actions_init(&actions);
        posix_spawn_file_actions_adddup2(&actions, ends[0], STDIN_FILENO);
        if (config.inherited >= 0) posix_spawn_file_actions_adddup2(&actions, config.inherited, kInheritedAs);
        posix_spawnattr_t attributes;
        posix_spawnattr_init(&attributes);
        posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);  // Ctrl-C is this process's to hear
        posix_spawn_file_actions_addclosefrom_np(&actions, kInheritedAs + 1);
        pid_t born = 0;
        const int failed = ::posix_spawn(&born, argv[0], &actions, &attributes, argv.data(), environ);
        posix_spawnattr_destroy(&attributes);
        posix_spawn_file_actions_destroy(&actions);
        ::close(ends[0]);
        if (failed != 0) ::close(ends[1]);
        else lifeline = ends[1];
        return failed != 0 ? -failed : born;
    }

    /// Whether somebody answers at the address.
    bool answers() const {
        auto client = Client::connect(config.address);
        return client && client.value().healthy(0.05);
    }

    void run() {
        std::unique_lock lock(mutex);
        auto pause = std::chrono::milliseconds(0);
        while (!ending) {
            const auto born = Clock::now();
            child = spawn();
            ++starts;
            if (child <= 0) {
                cause = std::string("it cannot be started: ") + std::strerror(int(-child));
                child = 0;
            }
            int status = 0;
            while (child > 0) {
                if (!serves && !doomed && !ending) {
                    lock.unlock();
                    const bool up = answers();
                    lock.lock();
                    if (up && !doomed) {
                        serves = true;
                        changed.notify_all();
                    }
                }
                if (::waitpid(child, &status, WNOHANG) == child) break;
                if (ending && Clock::now() > lastMoment) ::kill(child, SIGKILL);
                changed.wait_for(lock, kLook);
            }
            if (child > 0) cause = causeOf(status);
            ::close(std::exchange(lifeline, -1));
            child = 0;
            serves = doomed = false;
            ++deaths;
            changed.notify_all();
            if (ending) break;
            pause = Clock::now() - born > kLongLife ? std::chrono::milliseconds(0) : std::min(kLongestPause, 2 * pause + std::chrono::milliseconds(50));
            const std::string why = cause;
            lock.unlock();
            onEvent("it ended by " + why + ", and is started again");
            lock.lock();
            changed.wait_for(lock, pause, [this] { return ending; });
        }
    }

    const WorkerConfig config;
    const std::function<void(const std::string&)> onEvent;
    std::mutex mutex;
    std::condition_variable changed;
    pid_t child = 0;
    int lifeline = -1;
    uint64_t starts = 0, deaths = 0;
    bool serves = false, ending = false;
    bool doomed = false;  ///< killed, and not seen dead yet
    Clock::time_point lastMoment;
    std::string cause;  ///< of the last end
    std::thread thread;
};

Worker::Worker(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

Result<std::unique_ptr<Worker>> Worker::start(const WorkerConfig& config, std::function<void(const std::string&)> onEvent) {
    auto impl = std::make_unique<Impl>(config, std::move(onEvent));
    impl->thread = std::thread([i = impl.get()] { i->run(); });
    std::unique_ptr<Worker> worker(new Worker(std::move(impl)));
    Impl& w = *worker->impl_;
    std::unique_lock lock(w.mutex);
    w.changed.wait_for(lock, kPatience, [&] { return w.serves || w.deaths > 0; });
    if (w.serves) return worker;
    const std::string why = w.deaths > 0 ? "it ended by " + w.cause + " before it served; what it said is above" : "it does not serve";
    lock.unlock();
    return Error{ErrorCode::kIo, "worker: " + why};
}

Worker::~Worker() {
    {
        const std::lock_guard lock(impl_->mutex);
        impl_->ending = true;
        impl_->lastMoment = Clock::now() + kLastWords;
        if (impl_->lifeline >= 0) ::close(std::exchange(impl_->lifeline, -1));
        impl_->changed.notify_all();
    }
    impl_->thread.join();
}

Result<uint64_t> Worker::serving() {
    std::unique_lock lock(impl_->mutex);
    if (impl_->changed.wait_for(lock, kPatience, [this] { return impl_->serves || impl_->ending; }) && impl_->serves) return impl_->starts;
    return Error{ErrorCode::kIo, "worker: it does not serve: " + impl_->cause};
}

void Worker::discard(uint64_t start) {
    const std::lock_guard lock(impl_->mutex);
    if (impl_->starts != start || impl_->child <= 0) return;
    ::kill(impl_->child, SIGKILL);
    impl_->serves = false;
    impl_->doomed = true;
}

pid_t Worker::pid() const {
    const std::lock_guard lock(impl_->mutex);
    return std::max(impl_->child, 0);
}

}  // namespace server
