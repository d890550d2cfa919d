// server/service.h — the gRPC front end: streams, limits, recordings and who may come; a host draws.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "server/pem.h"
#include "server/session_host.h"
#include "server/shadow_system.h"
#include "world/result.h"

namespace server {

struct ServiceConfig {
    std::string listen = "127.0.0.1:50471";   ///< HOST:PORT, port 0: any; or unix:PATH
    std::optional<TlsFiles> tls;              ///< required where `listen` is neither of this machine alone nor a Unix socket
    std::string record;                       ///< folder for a recording of each session; empty: none
    bool keepRecordings = true;               ///< false: each is removed when its session ends
    std::string share;                        ///< path of the Unix socket where shared maps are fetched; empty: none are shared
    std::string operatorFile;                 ///< gets a token, for its owner alone, by which any session may be asked; empty: none
    size_t sessions = 64;                     ///< at the same time, > 0
    size_t messageBytes = 64u << 20;          ///< of one request, > 0
    size_t waitingFrames = 64;                ///< that become one where the latest pose wins, > 0
    double idleSeconds = 600;                 ///< without a request a session ends, > 0
    double unreadSeconds = 30;                ///< so long may a reply wait for its reader, > 0
    double silentSeconds = 20;                ///< a connection that says nothing is asked for a sign of life, which may take as long, > 0
    ShadowConfig maps;                        ///< what a session's request leaves open is as here
};

/// Something worth a line in a log: a session opened, ended, was refused.
struct ServiceEvent {
    const char* what = "";  ///< "listening", "opened", "ended", "refused", "stopped"
    uint64_t session = 0;   ///< counted from 1; 0: none
    std::string detail;     ///< world, address or reason
    uint64_t frames = 0;
};

/// Serves until it is stopped. Each session has a thread. Any thread may call what is below. `onEvent` comes from any of them, one call at a time.
class Service {
public:
    /// `host` must outlive it. kUsage for an address that others reach without TLS, kIo for one that cannot be had,
    /// kNotFound and kIo for files and folders.
    static world::Result<std::unique_ptr<Service>> start(SessionHost& host, const ServiceConfig& config,
                                                         std::function<void(const ServiceEvent&)> onEvent);
    /// Stops, without waiting for frames to be asked.
    ~Service();

    /// As clients name it; with the port that was had.
    const std::string& address() const;
    size_t sessions() const;  ///< open now
    uint64_t frames() const;  ///< drawn so far, by all sessions

    /// Takes no new sessions; each open one ends after the frame that it is drawing, at the latest after so long.
    void stop(std::chrono::milliseconds patience);

    struct Impl;

private:
    explicit Service(std::unique_ptr<Impl> impl);
    std::unique_ptr<Impl> impl_;
};

}  // namespace server
