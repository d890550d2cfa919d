// server/session_stream.h — one client's stream: requests wait in order, a thread of its own draws them, replies follow.
#pragma once

#include <grpcpp/grpcpp.h>

#include <chrono>
#include <condition_variable>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>

#include "server/gnomon.pb.h"

namespace server {

/// How much may wait for a session that is drawing. What exceeds it waits with the client, by the transport's own flow
/// control.
struct StreamLimits {
    size_t requests = 64;
    size_t bytes = 64u << 20;
};

/// gRPC calls what begins with On, the session's thread what is named so, and anybody the rest.
class SessionStream final : public grpc::ServerBidiReactor<gnomon::v1::SessionRequest, gnomon::v1::SessionReply> {
public:
    SessionStream(grpc::CallbackServerContext* context, const StreamLimits& limits);

    /// Begins to read, and runs `work` on a thread of its own; the status that it gives ends the stream.
    /// `gone` is called last of all, by whatever thread: the stream may be destroyed after it, once `join` returned.
    void start(std::function<grpc::Status(SessionStream&)> work, std::function<void()> gone);
    /// Waits for the session's thread.
    void join();

    /// The session's thread: the next request, or with `all` all that wait, in order. None: the client has ended the
    /// stream, or it is to end, and then `verdict` says why.
    std::deque<gnomon::v1::SessionRequest> next(bool all);
    /// The session's thread: false when nobody will read it. The reply must live until this returns.
    bool write(const gnomon::v1::SessionReply& reply);
    /// Why `end` was called; OK where the client ended the stream.
    grpc::Status verdict() const;

    /// No request is taken any more.
    void end(const grpc::Status& why);
    /// Gives up a reply that waits for its reader, and all else. gRPC may call back before this returns: hold no lock.
    void cancel();
    /// Since when the session waits: for a request, or for somebody to read its reply; none while it draws.
    struct Wait {
        std::optional<std::chrono::steady_clock::time_point> asking, writing;
    };
    Wait waits() const;

    void OnReadDone(bool ok) override;
    void OnWriteDone(bool ok) override;
    void OnCancel() override;
    void OnDone() override;

private:
    bool room() const { return waiting_.size() < limits_.requests && bytes_ < limits_.bytes; }

    std::recursive_mutex contextMutex_;  ///< held while gRPC is asked to cancel, and may let go of the stream within
    grpc::CallbackServerContext* context_;  ///< null once gRPC has let go
    const StreamLimits limits_;
    mutable std::mutex mutex_;
    std::condition_variable changed_;
    std::deque<gnomon::v1::SessionRequest> waiting_;
    size_t bytes_ = 0;  ///< of what waits
    gnomon::v1::SessionRequest incoming_;
    bool reading_ = false, ended_ = false, written_ = false, writeOk_ = false;
    std::optional<grpc::Status> verdict_;
    Wait waits_;
    std::function<void()> gone_;
    std::thread thread_;
};

}  // namespace server
