#include "server/worker_host.h"

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <thread>
#include <utility>

#include "server/messages.h"
#include "server/recording.h"
#include "server/stopwatch.h"
#include "server/turns.h"
#include "server/worker.pb.h"

namespace server {

namespace v1 = gnomon::v1;
namespace wire = gnomon::worker;
using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

namespace {

constexpr int kMostDeaths = 3;     ///< of workers, by one frame
constexpr int kMostRevivals = 20;  ///< that fail before they count as deaths
constexpr std::chrono::minutes kLongestFrame{5};

/// The worker is dead, or of no use.
bool fatal(const Error& error) { return error.code == ErrorCode::kIo || error.code == ErrorCode::kDevice; }

/// Asks in turns, and discards a worker that does not answer.
class Desk {
public:
    explicit Desk(Worker& worker) : worker_(worker), watch_([this] { watch(); }) {}
    ~Desk() {
        {
            const std::lock_guard lock(mutex_);
            ending_ = true;
            changed_.notify_all();
        }
        watch_.join();
    }
    Desk(const Desk&) = delete;
    Desk& operator=(const Desk&) = delete;

    Worker& worker() { return worker_; }
    /// The reply's error is this one's. A line whose worker failed is discarded.
    ///   waited  if given, for the turn [ms]
    ///   descriptor  as of WorkerLine
    Result<wire::Reply> ask(WorkerLine& line, const wire::Request& request, double* waited = nullptr, int* descriptor = nullptr) {
        const Stopwatch watch;
        const Turns::Turn turn(turns_);
        if (waited) *waited = watch.ms();
        busyWith(line.start());
        auto reply = line.ask(request, descriptor);
        busyWith(0);
        if (reply && reply.value().has_error())
            reply = Error{codeOf(reply.value().error().code()), reply.value().error().what()};
        if (!reply && fatal(reply.error())) worker_.discard(line.start());
        return reply;
    }

private:
    void busyWith(uint64_t start) {
        const std::lock_guard lock(mutex_);
        busy_ = start;
        since_ = std::chrono::steady_clock::now();
    }
    void watch() {
        std::unique_lock lock(mutex_);
        while (!ending_) {
            changed_.wait_for(lock, std::chrono::seconds(1));
            if (busy_ != 0 && std::chrono::steady_clock::now() - since_ > kLongestFrame) worker_.discard(busy_);
        }
    }

    Worker& worker_;
    Turns turns_;
    std::mutex mutex_;  ///< of what is below
    std::condition_variable changed_;
    uint64_t busy_ = 0;  ///< start of the worker that was asked something; 0: none was
    std::chrono::steady_clock::time_point since_;
    bool ending_ = false;
    std::thread watch_;
};

class WorkerSession final : public HostedSession {
public:
    WorkerSession(Desk& desk, const std::function<void(uint64_t, const std::string&)>& onEvent, const v1::OpenSession& open,
                  uint64_t number, std::string recording)
        : desk_(desk), onEvent_(onEvent), open_(open), number_(number), recording_(std::move(recording)) {}
    ~WorkerSession() override {
        if (!line_) return;
        wire::Request request;
        request.set_session(number_);
        request.set_end(true);
        [[maybe_unused]] const auto ended = desk_.ask(*line_, request);  // a worker that is dead has forgotten it
    }

    /// Opens it with the worker that serves, and asks what was answered already. What the worker says of the session.
    Result<v1::SessionOpened> open() {
        auto line = desk_.worker().serving();
        if (!line) return line.error();
        line_ = std::move(line.value());
        wire::Request request;
        request.set_session(number_);
        *request.mutable_open() = open_;
        int descriptor = -1;
        const auto opened = desk_.ask(*line_, request, nullptr, &descriptor);
        if (!opened) return lost(opened.error());
        if (descriptor >= 0) {
            auto maps = SharedMaps::read(descriptor);
            if (!maps) return lost(maps.error());
            shared_ = std::move(maps.value());
        }
        if (answered_ > 0)
            if (const auto again = repeat(); !again) return lost(again.error());
        return opened.value().opened();
    }

    Result<v1::FrameReply> frame(const v1::Frame& frame) override {
        const std::lock_guard lock(mutex_);
        wire::Request request;
        request.set_session(number_);
        *request.mutable_frame() = frame;
        for (int deaths = 0, revivals = 0;;) {
            const auto alive = revive();
            double waited = 0;
            auto reply = alive ? desk_.ask(*line_, request, &waited) : Result<wire::Reply>(alive.error());
            if (reply) {
                ++answered_;
                v1::FrameReply& drawn = *reply.value().mutable_frame();
                drawn.mutable_times()->set_wait(waited);
                return std::move(drawn);
            }
            if (!fatal(reply.error())) return reply.error();
            line_.reset();
            if (!alive && ++revivals < kMostRevivals) continue;  // another session's doing, most likely
            if (++deaths < kMostDeaths) continue;
            return Error{ErrorCode::kDevice, "the session's frame " + std::to_string(answered_) + " ended " + std::to_string(deaths) +
                                                 " workers: " + reply.error().what};
        }
    }

    Result<v1::QueryShadowReply> query(const v1::QueryShadowRequest& request) override {
        wire::Request asked;
        *asked.mutable_query() = request;
        auto reply = ask(asked);
        if (!reply) return reply.error();
        return std::move(*reply.value().mutable_query());
    }

    Result<v1::ShadowMask> mask(const v1::GetShadowMaskRequest& request) override {
        wire::Request asked;
        *asked.mutable_mask() = request;
        auto reply = ask(asked);
        if (!reply) return reply.error();
        return std::move(*reply.value().mutable_mask());
    }

    Result<HostedMap> depthMap(const v1::GetDepthMapRequest& request) override {
        wire::Request asked;
        *asked.mutable_map() = request;
        auto reply = ask(asked);
        if (!reply) return reply.error();
        wire::DepthMap& from = *reply.value().mutable_map();
        HostedMap map{std::move(*from.mutable_depths()), from.side(), {}, from.frame()};
        if (from.has_cascade()) map.cascade = from.cascade();
        return map;
    }

    std::shared_ptr<SharedMaps> shared() override {
        const std::lock_guard lock(mutex_);
        return shared_;
    }

private:
    Error lost(const Error& error) {
        line_.reset();
        return error;
    }

    /// With a session at the worker that serves; opens one where that is another worker than before.
    Result<Done> revive() {
        auto serving = desk_.worker().serving();
        if (!serving) return serving.error();
        if (line_ == serving.value()) return Done{};
        const auto opened = open();
        if (!opened) return opened.error();
        return Done{};
    }

    Result<Done> repeat() {
        auto reader = RecordingReader::open(recording_);
        if (!reader) return Error{ErrorCode::kBadData, reader.error().what};
        for (uint64_t frames = 0; frames < answered_;) {
            const auto entry = reader.value().next();
            if (!entry) return Error{ErrorCode::kBadData, entry.error().what};
            if (!entry.value()) return Error{ErrorCode::kBadData, recording_ + ": it ends before its session did"};
            v1::SessionRequest recorded;
            if (entry.value()->kind != EntryKind::kRequest) continue;
            if (!recorded.ParseFromString(entry.value()->message)) return Error{ErrorCode::kBadData, recording_ + ": no request where one must be"};
            if (!recorded.has_frame()) continue;
            wire::Request request;
            request.set_session(number_);
            *request.mutable_frame() = std::move(*recorded.mutable_frame());
            request.mutable_frame()->clear_wants();
            if (const auto reply = desk_.ask(*line_, request); !reply) return reply.error();
            ++frames;
        }
        onEvent_(number_, "resumed after " + std::to_string(answered_) + " frames");
        return Done{};
    }

    Result<wire::Reply> ask(wire::Request& request) {
        const std::lock_guard lock(mutex_);
        if (const auto alive = revive(); !alive) return alive.error();
        request.set_session(number_);
        auto reply = desk_.ask(*line_, request);
        if (!reply && fatal(reply.error())) line_.reset();
        return reply;
    }

    Desk& desk_;
    const std::function<void(uint64_t, const std::string&)>& onEvent_;
    const v1::OpenSession open_;
    const uint64_t number_;
    const std::string recording_;
    std::mutex mutex_;  ///< of what is below
    std::shared_ptr<WorkerLine> line_;  ///< to the worker that has the session; null: none has
    uint64_t answered_ = 0;  ///< frames
    std::shared_ptr<SharedMaps> shared_;
};

class WorkerHost final : public SessionHost {
public:
    WorkerHost(Worker& worker, std::function<void(uint64_t, const std::string&)> onEvent) : desk_(worker), onEvent_(std::move(onEvent)) {}

    Result<std::vector<std::string>> worlds() override {
        wire::Request request;
        request.mutable_list_worlds();
        const auto reply = ask(request);
        if (!reply) return reply.error();
        return std::vector<std::string>(reply.value().worlds().names().begin(), reply.value().worlds().names().end());
    }

    Result<v1::WorldInfo> openWorld(const std::string& name) override {
        wire::Request request;
        request.mutable_open_world()->set_name(name);
        const auto reply = ask(request);
        if (!reply) return reply.error();
        return reply.value().world();
    }

    Result<std::unique_ptr<HostedSession>> open(const v1::OpenSession& request, uint64_t number, const std::string& recording,
                                                v1::SessionOpened& opened) override {
        auto session = std::make_unique<WorkerSession>(desk_, onEvent_, request, number, recording);
        auto told = session->open();
        if (!told && fatal(told.error())) told = session->open();  // the worker may have died of something else
        if (!told) return told.error();
        opened = std::move(told.value());
        return std::unique_ptr<HostedSession>(std::move(session));
    }

private:
    Result<wire::Reply> ask(const wire::Request& request) {
        const auto line = desk_.worker().serving();
        if (!line) return line.error();
        return desk_.ask(*line.value(), request);
    }

    Desk desk_;
    const std::function<void(uint64_t, const std::string&)> onEvent_;
};

}  // namespace

std::unique_ptr<SessionHost> makeWorkerHost(Worker& worker, std::function<void(uint64_t, const std::string&)> onEvent) {
    return std::make_unique<WorkerHost>(worker, std::move(onEvent));
}

}  // namespace server
