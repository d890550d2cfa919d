#include "tools/sweep/workers.h"

#include <sys/prctl.h>
#include <sys/wait.h>
#include <tbb/info.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <iostream>
#include <map>

#include "tools/output_folder.h"
#include "tools/progress.h"

namespace tools::sweep {
namespace {

using world::Error;
using world::ErrorCode;
using world::Result;

/// SIGINT, SIGTERM and SIGCHLD wait to be asked for.
class Signals {
public:
    Signals() {
        sigemptyset(&waited_);
        for (const int signal : {SIGINT, SIGTERM, SIGCHLD}) sigaddset(&waited_, signal);
        pthread_sigmask(SIG_BLOCK, &waited_, &before_);
    }
    Signals(const Signals&) = delete;
    Signals& operator=(const Signals&) = delete;
    ~Signals() { pthread_sigmask(SIG_SETMASK, &before_, nullptr); }
    int next() const {
        int signal = 0;
        sigwait(&waited_, &signal);
        return signal;
    }
    const sigset_t& before() const { return before_; }

private:
    sigset_t waited_{}, before_{};
};

/// 0 where there is no room for a process.
pid_t start(const Sweep& sweep, size_t index, int threads, const sigset_t& mask) {
    const std::string folder = sweep.folder.string(), shard = std::to_string(index), count = std::to_string(threads);
    const char* arguments[] = {"gnomon", "sweep", "run", folder.c_str(), "--shard", shard.c_str(), "--threads", count.c_str(), nullptr};
    const pid_t parent = getpid(), child = fork();
    if (child != 0) return std::max(child, 0);
    // Nothing but system calls: other threads of the parent may have held any lock.
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (getppid() != parent) _exit(3);
    pthread_sigmask(SIG_SETMASK, &mask, nullptr);
    execv("/proc/self/exe", const_cast<char* const*>(arguments));
    _exit(3);
}

std::string howItEnded(int status) {
    if (WIFSIGNALED(status)) return std::string("ended by signal ") + std::to_string(WTERMSIG(status)) + ", " + strsignal(WTERMSIG(status));
    return "ended with status " + std::to_string(WEXITSTATUS(status));
}

/// What to say of a shard whose process has ended; nothing if it is done.
std::string failureOf(const Sweep& sweep, const Shard& shard, int status) {
    if (sweep.done(shard)) return "";
    const std::string failed = sweep.failure(shard).string();
    std::error_code ignored;
    if (!std::filesystem::exists(failed, ignored)) (void)writeText(failed, howItEnded(status) + "\n");
    return shard.label + ": " + howItEnded(status) + "; " + sweep.log(shard).string() + " holds what it said";
}

}  // namespace

Result<bool> runHere(const Sweep& sweep, const std::vector<size_t>& shards, int jobs) {
    const int cores = tbb::info::default_concurrency();
    const size_t most = size_t(jobs > 0 ? jobs : cores);
    const int threads = std::max(1, int(cores / std::max<size_t>(1, std::min(most, shards.size()))));
    const Signals signals;
    Progress progress("sweep", std::cerr, stderrIsTerminal());
    std::map<pid_t, size_t> running;
    size_t begun = 0;
    bool stopped = false;
    progress.at(0, shards.size());
    while (!running.empty() || (begun < shards.size() && !stopped)) {
        while (!stopped && begun < shards.size() && running.size() < most) {
            const pid_t child = start(sweep, shards[begun], threads, signals.before());
            if (child == 0 && running.empty()) return Error{ErrorCode::kLimit, "no process can be started; give fewer --jobs, or end others"};
            if (child == 0) break;  // again when one has ended
            running[child] = shards[begun++];
        }
        if (signals.next() != SIGCHLD) {
            stopped = true;
            for (const auto& [child, index] : running) kill(child, SIGTERM);
        }
        // One signal may stand for several children.
        int status = 0;
        for (pid_t child; (child = waitpid(-1, &status, WNOHANG)) > 0;) {
            const auto at = running.find(child);
            if (at == running.end()) continue;
            if (!stopped)
                if (const std::string failure = failureOf(sweep, sweep.plan.shards[at->second], status); !failure.empty()) progress.say(failure);
            running.erase(at);
        }
        progress.at(begun - running.size(), shards.size());
    }
    sweep.tidy();
    return !stopped;
}

}  // namespace tools::sweep
