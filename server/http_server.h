// server/http_server.h — the port for people and monitors: the live page, health, metrics.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>

#include "server/live_board.h"
#include "world/result.h"

namespace server {

struct HttpConfig {
    std::string address = "127.0.0.1";  ///< of this host alone: the port has neither TLS nor a login
    uint16_t port = 0;                  ///< 0: any that is free
    int socket = -1;                    ///< what `listen` gave, taken over; instead of an address
    size_t connections = 128;           ///< at once; further ones are closed
    size_t watchers = 16;               ///< of them, streams of events; further ones are answered 503
    std::chrono::milliseconds patience{10000};  ///< for a whole request, and for a reader to take what it was sent
};

/// Serves what server/live_site.h says, GET and HEAD, until it is destroyed. All connections share one thread and none
/// can hold it up: a client that is slow to ask or to read is dropped when the patience is over, and is owed one event at
/// most until then. Requests longer than 8 KiB are refused, and so is a Host that is not this one (DNS rebinding).
class HttpServer {
public:
    /// A socket that listens, for another process to serve at; who comes before that waits. Errors as below.
    static world::Result<int> listen(const HttpConfig& config);
    static uint16_t portOf(int socket);
    /// `board` must outlive the server. kUsage for an address that is not a loopback one, kIo where the port cannot be had.
    static world::Result<std::unique_ptr<HttpServer>> start(LiveBoard& board, const HttpConfig& config = {});
    /// Takes no more connections, lets answers under way end for two seconds at most, and closes the rest.
    ~HttpServer();

    uint16_t port() const;

private:
    struct Impl;
    explicit HttpServer(std::unique_ptr<Impl> impl);
    std::unique_ptr<Impl> impl_;
};

}  // namespace server
