// tests/server/socket.h — a client of a local port that says and hears bytes, well-behaved or not.
#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <cstdint>
#include <string>
#include <string_view>

namespace tests {

class Socket {
public:
    /// Connects to 127.0.0.1; `receiveBuffer` [bytes] is the kernel's, 0 for its own choice.
    explicit Socket(uint16_t port, int receiveBuffer = 0) : fd_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
        if (receiveBuffer > 0) setsockopt(fd_, SOL_SOCKET, SO_RCVBUF, &receiveBuffer, sizeof receiveBuffer);
        sockaddr_in address{};
        address.sin_family = AF_INET;
        address.sin_port = htons(port);
        address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        connected_ = connect(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
    }
    Socket(const Socket&) = delete;
    ~Socket() { close(fd_); }

    bool connected() const { return connected_; }
    /// Says nothing more.
    void end() { ::shutdown(fd_, SHUT_WR); }
    bool say(std::string_view bytes) {
        while (!bytes.empty()) {
            const ssize_t sent = send(fd_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
            if (sent <= 0) return false;
            bytes.remove_prefix(size_t(sent));
        }
        return true;
    }
    /// Everything until the other side closes, `until` has come or the time is over.
    std::string hear(std::string_view until = {}, std::chrono::milliseconds patience = std::chrono::seconds(20)) {
        const auto end = std::chrono::steady_clock::now() + patience;
        std::string heard;
        closed_ = false;
        while (until.empty() || heard.find(until) == std::string::npos) {
            const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(end - std::chrono::steady_clock::now());
            pollfd ready{fd_, POLLIN, 0};
            if (left.count() <= 0 || poll(&ready, 1, int(left.count())) <= 0) break;
            char bytes[4096];
            const ssize_t got = recv(fd_, bytes, sizeof bytes, 0);
            if (got <= 0) {
                closed_ = true;
                break;
            }
            heard.append(bytes, size_t(got));
        }
        return heard;
    }
    bool closed() const { return closed_; }  ///< by the other side, as of the last `hear`

private:
    int fd_;
    bool connected_ = false, closed_ = false;
};

}  // namespace tests
