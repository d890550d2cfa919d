// tests/tools/served.h — `gnomon serve` as a process beside a test, and programs that talk to it.
#pragma once

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cstdio>
#include <filesystem>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "server/client.h"

namespace tests {

/// Serves worlds of a folder from its making to its end, which SIGTERM brings about.
class Served {
public:
    /// `more`: further arguments. Throws where it does not serve within 30 seconds.
    ///   address  as clients name it: a Unix socket, or a port that is free
    ///   tls      what a client shows to see whether it serves
    Served(const std::string& worlds, const std::string& address, const std::vector<std::string>& more = {},
           const std::optional<server::TlsFiles>& tls = {})
        : address_(address) {
        std::vector<std::string> words{GNOMON_BINARY, "serve", "--worlds", worlds, "--listen", address};
        words.insert(words.end(), more.begin(), more.end());
        std::vector<char*> arguments;
        for (std::string& word : words) arguments.push_back(word.data());
        arguments.push_back(nullptr);
        posix_spawn_file_actions_t actions;
        posix_spawn_file_actions_init(&actions);
        posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
        const int failed = ::posix_spawn(&pid_, GNOMON_BINARY, &actions, nullptr, arguments.data(), environ);
        posix_spawn_file_actions_destroy(&actions);
        if (failed != 0) throw std::runtime_error("gnomon serve cannot be started");
        const auto served = server::Client::connect(address, tls).value().healthy(30);
        if (!served) {
            stop();
            throw std::runtime_error("gnomon serve: " + served.error().what);
        }
    }
    ~Served() { stop(); }
    Served(const Served&) = delete;
    Served& operator=(const Served&) = delete;

    const std::string& address() const { return address_; }
    /// It answers nobody until it is stopped.
    void freeze() const { ::kill(pid_, SIGSTOP); }
    /// Its exit status; -1 where it was stopped before.
    int stop() {
        if (pid_ == 0) return -1;
        ::kill(pid_, SIGTERM);
        ::kill(pid_, SIGCONT);
        int status = 0;
        ::waitpid(pid_, &status, 0);
        pid_ = 0;
        return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    }

private:
    std::string address_;
    pid_t pid_ = 0;
};

struct Said {
    int status = -1;
    std::string text;
};

/// Runs a line of shell; what it says on both outputs, unless the line redirects them.
inline Said run(const std::string& line) {
    Said said;
    FILE* pipe = ::popen((line + " 2>&1 </dev/null").c_str(), "r");
    if (!pipe) return said;
    std::array<char, 4096> buffer;
    while (const size_t read = std::fread(buffer.data(), 1, buffer.size(), pipe)) said.text.append(buffer.data(), read);
    const int status = ::pclose(pipe);
    said.status = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    return said;
}

}  // namespace tests
