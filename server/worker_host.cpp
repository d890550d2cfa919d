#include "server/worker_host.h"

#include <atomic>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>

#include "server/client.h"
#include "server/recording.h"
#include "server/stopwatch.h"
#include "server/turns.h"

namespace server {

namespace v1 = gnomon::v1;
using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

namespace {

constexpr int kMostDeaths = 3;  ///< of workers, by one frame
constexpr int kMostRevivals = 20;  ///< that fail before they count as deaths
constexpr std::chrono::minutes kLongestFrame{5};  ///< a worker that takes longer is hung, and discarded

/// The worker is dead, or of no use.
bool fatal(const Error& error) { return error.code == ErrorCode::kIo || error.code == ErrorCode::kDevice; }

class WorkerHost;

class WorkerSession final : public HostedSession {
public:
    WorkerSession(WorkerHost& host, const v1::OpenSession& open, uint64_t number, std::string recording)
        : host_(host), open_(open), number_(number), recording_(std::move(recording)) {}

    /// Opens it with the worker that serves, and asks what was answered already. What the worker says of the session.
    Result<v1::SessionOpened> open();
    Result<v1::FrameReply> frame(const v1::Frame& request) override;
    Result<v1::QueryShadowReply> query(const v1::QueryShadowRequest& request) override {
        return ask<v1::QueryShadowReply>([&](Client& client) { return client.query(named(request)); });
    }
    Result<v1::ShadowMask> mask(const v1::GetShadowMaskRequest& request) override {
        return ask<v1::ShadowMask>([&](Client& client) { return client.mask(named(request)); });
    }
    Result<Done> depthMap(const v1::GetDepthMapRequest& request, const std::function<bool(const v1::DepthTile&)>& take) override;

private:
    /// With a session at the worker that serves; opens one where that is another worker than before.
    Result<Done> revive();
    template <class Reply>
    Result<Reply> ask(const std::function<Result<Reply>(Client&)>& question);
    /// The same request, of the session as the worker calls it.
    template <class Request>
    Request named(Request request) const {
        request.set_session(session_->opened().session());
        return request;
    }

    WorkerHost& host_;
    const v1::OpenSession open_;
    const uint64_t number_;
    const std::string recording_;
    std::mutex mutex_;  ///< of what is below
    std::shared_ptr<Client> client_;
    std::unique_ptr<ClientSession> session_;
    uint64_t start_ = 0;     ///< of the worker that has the session
    uint64_t answered_ = 0;  ///< frames
};

class WorkerHost final : public SessionHost {
public:
    WorkerHost(Worker& worker, std::string address, std::function<void(uint64_t, const std::string&)> onEvent)
        : worker_(worker), address_(std::move(address)), onEvent_(std::move(onEvent)), watch_([this] { watch(); }) {}
    ~WorkerHost() override {
        {
            const std::lock_guard lock(mutex_);
            ending_ = true;
            changed_.notify_all();
        }
        watch_.join();
    }

    Result<std::vector<std::string>> worlds() override {
        const auto at = client();
        if (!at) return at.error();
        return at.value().second->worlds();
    }
    Result<v1::WorldInfo> openWorld(const std::string& name) override {
        const auto at = client();
        if (!at) return at.error();
        return at.value().second->openWorld(name);
    }
    Result<std::unique_ptr<HostedSession>> open(const v1::OpenSession& request, uint64_t number, const std::string& recording,
                                                v1::SessionOpened& opened) override {
        auto session = std::make_unique<WorkerSession>(*this, request, number, recording);
        auto at = session->open();
        if (!at && fatal(at.error())) at = session->open();  // the worker may have died of something else
        if (!at) return at.error();
        opened = std::move(at.value());
        opened.clear_session();
        return std::unique_ptr<HostedSession>(std::move(session));
    }

    /// The worker that serves: which start it is, and a client of its.
    Result<std::pair<uint64_t, std::shared_ptr<Client>>> client() {
        const auto start = worker_.serving();
        if (!start) return start.error();
        const std::lock_guard lock(mutex_);
        if (start.value() != start_ || !client_) {
            auto made = Client::connect(address_);
            if (!made) return made.error();
            client_ = std::make_shared<Client>(std::move(made.value()));
            start_ = start.value();
        }
        return std::pair(start_, client_);
    }

    /// A turn at the worker.
    class Turn {
    public:
        Turn(WorkerHost& host, uint64_t start) : host_(host), turn_(host.turns_) { set(start); }
        ~Turn() { set(0); }
        Turn(const Turn&) = delete;
        Turn& operator=(const Turn&) = delete;

    private:
        void set(uint64_t start) {
            const std::lock_guard lock(host_.mutex_);
            host_.busy_ = start;
            host_.busySince_ = std::chrono::steady_clock::now();
        }
        WorkerHost& host_;
        const Turns::Turn turn_;
    };

    Worker& worker() { return worker_; }
    void tell(uint64_t session, const std::string& what) { onEvent_(session, what); }

private:
    /// Discards a worker that does not answer.
    void watch() {
        std::unique_lock lock(mutex_);
        while (!ending_) {
            changed_.wait_for(lock, std::chrono::seconds(1));
            if (busy_ != 0 && std::chrono::steady_clock::now() - busySince_ > kLongestFrame) worker_.discard(busy_);
        }
    }

    Worker& worker_;
    const std::string address_;
    const std::function<void(uint64_t, const std::string&)> onEvent_;
    Turns turns_;
    std::mutex mutex_;  ///< of what is below
    std::condition_variable changed_;
    uint64_t start_ = 0;
    std::shared_ptr<Client> client_;
    uint64_t busy_ = 0;  ///< start of the worker that was asked something; 0: it was asked nothing
    std::chrono::steady_clock::time_point busySince_;
    bool ending_ = false;
    std::thread watch_;
};

Result<v1::SessionOpened> WorkerSession::open() {
    const auto at = host_.client();
    if (!at) return at.error();
    session_.reset();
    client_ = at.value().second;
    start_ = at.value().first;
    {
        const WorkerHost::Turn turn(host_, start_);
        auto session = client_->session(open_);
        if (!session) return session.error();
        session_ = std::move(session.value());
    }
    if (answered_ == 0) return session_->opened();
    auto reader = RecordingReader::open(recording_);
    if (!reader) return reader.error();
    for (uint64_t frames = 0; frames < answered_;) {
        auto entry = reader.value().next();
        if (!entry) return entry.error();
        if (!entry.value()) return Error{ErrorCode::kBadData, recording_ + ": it ends before its session did"};
        v1::SessionRequest request;
        if (entry.value()->kind != EntryKind::kRequest) continue;
        if (!request.ParseFromString(entry.value()->message)) return Error{ErrorCode::kBadData, recording_ + ": no request where one must be"};
        if (!request.has_frame()) continue;
        const WorkerHost::Turn turn(host_, start_);
        if (const auto reply = session_->frame(request.frame()); !reply) return reply.error();
        ++frames;
    }
    host_.tell(number_, "resumed after " + std::to_string(answered_) + " frames");
    return session_->opened();
}

Result<Done> WorkerSession::revive() {
    const auto at = host_.client();
    if (!at) return at.error();
    if (session_ && start_ == at.value().first) return Done{};
    const auto opened = open();
    if (!opened) return opened.error();
    return Done{};
}

Result<v1::FrameReply> WorkerSession::frame(const v1::Frame& request) {
    const std::lock_guard lock(mutex_);
    for (int deaths = 0, revivals = 0;;) {
        auto alive = revive();
        const bool asked = bool(alive);
        if (alive) {
            const Stopwatch watch;
            const WorkerHost::Turn turn(host_, start_);
            const double waited = watch.ms();
            auto reply = session_->frame(request);
            if (reply) {
                reply.value().mutable_times()->set_wait(waited);
                ++answered_;
            }
            if (reply || !fatal(reply.error())) return reply;
            alive = reply.error();
        }
        if (!fatal(alive.error())) return alive.error();
        session_.reset();
        host_.worker().discard(start_);
        if (!asked && ++revivals < kMostRevivals) continue;  // another session's doing, most likely
        if (++deaths == kMostDeaths)
            return Error{ErrorCode::kDevice, "the session's frame " + std::to_string(answered_) + " ended " + std::to_string(deaths) +
                                                 " workers: " + alive.error().what};
    }
}

template <class Reply>
Result<Reply> WorkerSession::ask(const std::function<Result<Reply>(Client&)>& question) {
    const std::lock_guard lock(mutex_);
    if (const auto alive = revive(); !alive) return alive.error();
    const WorkerHost::Turn turn(host_, start_);
    auto reply = question(*client_);
    if (!reply && fatal(reply.error())) host_.worker().discard(start_);
    return reply;
}

Result<Done> WorkerSession::depthMap(const v1::GetDepthMapRequest& request, const std::function<bool(const v1::DepthTile&)>& take) {
    std::shared_ptr<Client> client;
    v1::GetDepthMapRequest asked;
    {
        const std::lock_guard lock(mutex_);
        if (const auto alive = revive(); !alive) return alive.error();
        client = client_;
        asked = named(request);
    }
    return client->depthMap(asked, take);
}

}  // namespace

std::unique_ptr<SessionHost> makeWorkerHost(Worker& worker, const std::string& address,
                                            std::function<void(uint64_t, const std::string&)> onEvent) {
    return std::make_unique<WorkerHost>(worker, address, std::move(onEvent));
}

}  // namespace server
