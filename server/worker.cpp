#include "server/worker.h"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstring>
#include <mutex>
#include <thread>
#include <utility>

#include "server/share_socket.h"
#include "server/worker.pb.h"
#include "server/worker_loop.h"

extern char** environ;

namespace server {

namespace wire = gnomon::worker;
using world::Error;
using world::ErrorCode;
using world::Result;

namespace {

using Clock = std::chrono::steady_clock;
constexpr std::chrono::seconds kPatience{30};             ///< for a worker that serves
constexpr std::chrono::seconds kLongLife{10};             ///< of one that died of something new
constexpr std::chrono::milliseconds kLongestPause{5000};  ///< before the next start
constexpr std::chrono::seconds kLastWords{2};

std::string causeOf(int status) {
    if (WIFSIGNALED(status)) return "signal " + std::to_string(WTERMSIG(status)) + ", " + ::strsignal(WTERMSIG(status));
    return "status " + std::to_string(WEXITSTATUS(status));
}

}  // namespace

WorkerLine::~WorkerLine() { ::close(socket_); }

Result<wire::Reply> WorkerLine::ask(const wire::Request& request, int* descriptor) {
    if (const auto sent = sendMessage(socket_, request); !sent) return sent.error();
    wire::Reply reply;
    if (const auto received = receiveMessage(socket_, reply); !received) return received.error();
    if (!reply.shares()) return reply;
    const auto came = receiveDescriptor(socket_);
    if (!came) return came.error();
    if (descriptor) *descriptor = came.value();
    else ::close(came.value());
    return reply;
}

struct Worker::Impl {
    Impl(const WorkerConfig& c, std::function<void(const std::string&)> e) : config(c), onEvent(std::move(e)) {}

    /// The process, or -errno; and this side of its line.
    pid_t spawn(int& socket) {
        std::vector<std::string> words = config.command(starts + 1);
        std::vector<char*> argv;
        for (std::string& word : words) argv.push_back(word.data());
        argv.push_back(nullptr);
        int ends[2];
        if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0) return -errno;
        // Out of the way of the numbers that the worker finds them under.
        const int theirs = ::fcntl(ends[1], F_DUPFD_CLOEXEC, kWorkerInherited + 1);
        const int inherited = config.inherited < 0 ? -1 : ::fcntl(config.inherited, F_DUPFD_CLOEXEC, kWorkerInherited + 1);
        posix_spawn_file_actions_t actions;
        posix_spawn_file_actions_init(&actions);
        posix_spawn_file_actions_adddup2(&actions, theirs, kWorkerLine);
        if (inherited >= 0) posix_spawn_file_actions_adddup2(&actions, inherited, kWorkerInherited);
        posix_spawn_file_actions_addclosefrom_np(&actions, inherited >= 0 ? kWorkerInherited + 1 : kWorkerLine + 1);
        posix_spawnattr_t attributes;
        posix_spawnattr_init(&attributes);
        posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);  // Ctrl-C is this process's to hear
        pid_t born = 0;
        const int failed = ::posix_spawn(&born, argv[0], &actions, &attributes, argv.data(), environ);
        posix_spawnattr_destroy(&attributes);
        posix_spawn_file_actions_destroy(&actions);
        for (const int mine : {ends[1], theirs, inherited})
            if (mine >= 0) ::close(mine);
        if (failed != 0) ::close(ends[0]);
        socket = ends[0];
        return failed != 0 ? -failed : born;
    }

    /// One worker from its start to its end.
    void live(std::unique_lock<std::mutex>& lock) {
        int socket = -1;
        const pid_t born = spawn(socket);
        ++starts;
        if (born <= 0) {
            cause = std::string("it cannot be started: ") + std::strerror(int(-born));
            return;
        }
        child = born;
        auto mine = std::make_shared<WorkerLine>(starts, socket);
        lock.unlock();
        wire::Reply hello;
        const timeval patience{kPatience.count(), 0};
        ::setsockopt(socket, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
        const bool up = bool(receiveMessage(socket, hello));
        const timeval forever{};
        ::setsockopt(socket, SOL_SOCKET, SO_RCVTIMEO, &forever, sizeof forever);
        if (!up) ::kill(born, SIGKILL);
        lock.lock();
        if (up && !ending) line = std::move(mine);
        mine.reset();
        changed.notify_all();
        lock.unlock();
        siginfo_t info{};
        while (::waitid(P_PID, id_t(born), &info, WEXITED | WNOWAIT) != 0 && errno == EINTR) {}
        lock.lock();
        int status = 0;
        ::waitpid(born, &status, 0);  // its number is free from here on
        cause = causeOf(status);
        child = 0;
        line.reset();
    }

    void run() {
        std::unique_lock lock(mutex);
        auto pause = std::chrono::milliseconds(0);
        while (!ending) {
            const auto born = Clock::now();
            live(lock);
            ++deaths;
            changed.notify_all();
            if (ending) break;
            const bool anew = Clock::now() - born > kLongLife;
            pause = anew ? std::chrono::milliseconds(0) : std::min(kLongestPause, 2 * pause + std::chrono::milliseconds(50));
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
    std::shared_ptr<WorkerLine> line;  ///< null: none serves
    uint64_t starts = 0, deaths = 0;
    bool ending = false;
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
    w.changed.wait(lock, [&] { return w.line || w.deaths > 0; });
    if (w.line) return worker;
    const std::string why = w.cause;
    lock.unlock();
    return Error{ErrorCode::kIo, "worker: it ended by " + why + " before it served; what it said is above"};
}

Worker::~Worker() {
    std::unique_lock lock(impl_->mutex);
    impl_->ending = true;
    impl_->line.reset();  // the worker sees it, and ends
    impl_->changed.notify_all();
    impl_->changed.wait_for(lock, kLastWords, [this] { return impl_->child == 0; });
    if (impl_->child > 0) ::kill(impl_->child, SIGKILL);
    lock.unlock();
    impl_->thread.join();
}

Result<std::shared_ptr<WorkerLine>> Worker::serving() {
    std::unique_lock lock(impl_->mutex);
    if (impl_->changed.wait_for(lock, kPatience, [this] { return impl_->line || impl_->ending; }) && impl_->line) return impl_->line;
    return Error{ErrorCode::kIo, "worker: it does not serve: " + impl_->cause};
}

void Worker::discard(uint64_t start) {
    const std::lock_guard lock(impl_->mutex);
    if (impl_->starts != start || impl_->child <= 0) return;
    ::kill(impl_->child, SIGKILL);
    impl_->line.reset();
}

pid_t Worker::pid() const {
    const std::lock_guard lock(impl_->mutex);
    return impl_->child;
}

}  // namespace server
