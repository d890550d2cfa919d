#include "server/service.h"

#include <absl/synchronization/mutex.h>
#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/grpcpp.h>
#include <sys/random.h>
#include <zstd.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cstring>
#include <filesystem>
#include <thread>
#include <vector>

#include "server/gnomon.grpc.pb.h"
#include "server/oversight.h"
#include "server/recording.h"
#include "server/session.h"
#include "server/session_stream.h"
#include "server/share_socket.h"

namespace server {

namespace v1 = gnomon::v1;
using grpc::Status;
using grpc::StatusCode;
using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

namespace {

using Clock = std::chrono::steady_clock;

/// Of a watch over idle sessions and replies that nobody reads.
constexpr auto kWatchPeriod = std::chrono::milliseconds(100);
constexpr uint32_t kTile = 256, kLeastTile = 16, kMostTile = 1024;  // [texels]
constexpr int kZstdLevel = 1;  // depths of a frame are read once

Status statusOf(const Error& error) {
    switch (error.code) {
        case ErrorCode::kUsage: return {StatusCode::INVALID_ARGUMENT, error.what};
        case ErrorCode::kNotFound: return {StatusCode::NOT_FOUND, error.what};
        case ErrorCode::kBadData: return {StatusCode::DATA_LOSS, error.what};
        case ErrorCode::kIo: return {StatusCode::UNAVAILABLE, error.what};
        case ErrorCode::kDevice: return {StatusCode::INTERNAL, error.what};
        case ErrorCode::kLimit: return {StatusCode::RESOURCE_EXHAUSTED, error.what};
    }
    return {StatusCode::INTERNAL, error.what};
}

/// 128 random bits, as 32 hexadecimal digits.
std::string secret() {
    unsigned char bytes[16];
    CHECK(::getrandom(bytes, sizeof bytes, 0) == ssize_t(sizeof bytes));
    std::string text;
    for (const unsigned char b : bytes) {
        text += "0123456789abcdef"[b >> 4];
        text += "0123456789abcdef"[b & 15];
    }
    return text;
}

/// Whether only this machine can reach an address.
bool local(const std::string& listen) {
    return listen.starts_with("unix:") || listen.starts_with("127.") || listen.starts_with("localhost:") ||
           listen.starts_with("[::1]:");
}

Result<std::shared_ptr<grpc::ServerCredentials>> credentialsOf(const ServiceConfig& config) {
    if (!config.tls) {
        if (local(config.listen)) return grpc::InsecureServerCredentials();
        return Error{ErrorCode::kUsage, "listen " + config.listen + ": others can reach that address; give certificate, key and the "
                                        "clients' authority (mutual TLS), or listen on 127.0.0.1 or unix:PATH"};
    }
    const auto texts = readTls(*config.tls);
    if (!texts) return texts.error();
    grpc::SslServerCredentialsOptions options(GRPC_SSL_REQUEST_AND_REQUIRE_CLIENT_CERTIFICATE_AND_VERIFY);
    options.pem_root_certs = texts.value().authority;
    options.pem_key_cert_pairs.push_back({texts.value().key, texts.value().certificate});
    return grpc::SslServerCredentials(options);
}

/// A session that is open, or being opened.
struct Live {
    Live(grpc::CallbackServerContext* context, const StreamLimits& limits) : stream(context, limits) {}
    SessionStream stream;
    uint64_t number = 0;
    std::string secret;
    std::shared_ptr<HostedSession> session;  ///< under the service's lock; null until it is open, and again at its end
    v1::SessionInfo info;  ///< under the service's lock
    Clock::time_point opened;
    bool gone = false;  ///< gRPC has let go of the stream
};

void cut(const HostedMap& map, uint32_t x, uint32_t y, uint32_t tile, v1::DepthTile& answer) {
    const uint32_t width = std::min(tile, map.side - x), height = std::min(tile, map.side - y);
    answer.set_x(x);
    answer.set_y(y);
    answer.set_width(width);
    answer.set_height(height);
    std::string& bytes = *answer.mutable_depths();
    bytes.clear();
    for (uint32_t j = 0; j < height; ++j)
        bytes.append(map.depths, (size_t(y + j) * map.side + x) * sizeof(float), width * sizeof(float));
}

void compress(std::string& bytes) {
    const std::string raw = std::move(bytes);
    bytes.resize(ZSTD_compressBound(raw.size()));
    bytes.resize(ZSTD_compress(bytes.data(), bytes.size(), raw.data(), raw.size(), kZstdLevel));
}

/// Without the name of the folder.
Status unrecorded(const std::string& file, const Error& error) {
    return {StatusCode::RESOURCE_EXHAUSTED, "recording " + std::filesystem::path(file).filename().string() + ": " + std::strerror(error.native)};
}

/// A session's recording, if it has one.
struct Recorder {
    /// A session that cannot be recorded ends: a recording that has a hole is worse than one that ends.
    Status keep(EntryKind kind, const google::protobuf::MessageLite& message) {
        if (!writer || (temporary && kind == EntryKind::kReply)) return Status::OK;  // only what is to be repeated
        const auto kept = writer->add(kind, message.SerializeAsString());
        return kept ? Status::OK : unrecorded(writer->path(), kept.error());
    }
    ~Recorder() {
        std::error_code gone;
        if (writer && temporary) std::filesystem::remove(writer->path(), gone);
    }
    std::optional<RecordingWriter> writer;
    bool temporary = false;  ///< not needed beyond the session
};

/// A session's maps on offer, until somebody fetched them or the session ends.
struct Offer {
    void renew(std::shared_ptr<SharedMaps> now, v1::FrameReply& reply) {
        if (now == maps) return;
        if (!token.empty()) socket->withdraw(token);
        maps = std::move(now);
        token = secret();
        socket->offer(token, maps);
        reply.set_share_token(token);
    }
    ~Offer() {
        if (!token.empty()) socket->withdraw(token);
    }
    ShareSocket* socket;
    std::string token;
    std::shared_ptr<SharedMaps> maps;
};

}  // namespace

struct Service::Impl final : v1::Gnomon::WithCallbackMethod_Session<v1::Gnomon::Service> {
    Impl(SessionHost& h, const ServiceConfig& c, std::function<void(const ServiceEvent&)> e)
        : host(h), config(c), onEvent(std::move(e)) {}

    void tell(const ServiceEvent& event) {
        const std::lock_guard lock(eventMutex);
        if (onEvent) onEvent(event);
    }

    Status ListWorlds(grpc::ServerContext*, const v1::ListWorldsRequest*, v1::ListWorldsReply* reply) override {
        const auto names = host.worlds();
        if (!names) return statusOf(names.error());
        for (const std::string& name : names.value()) reply->add_names(name);
        return Status::OK;
    }

    Status OpenWorld(grpc::ServerContext*, const v1::OpenWorldRequest* request, v1::WorldInfo* reply) override {
        auto world = host.openWorld(request->name());
        if (!world) return statusOf(world.error());
        *reply = std::move(world.value());
        return Status::OK;
    }

    grpc::ServerBidiReactor<v1::SessionRequest, v1::SessionReply>* Session(grpc::CallbackServerContext* context) override {
        const std::lock_guard lock(mutex);
        const auto live = std::make_shared<Live>(context, StreamLimits{config.waitingFrames, config.messageBytes});
        if (stopping || lives.size() >= config.sessions) {
            const Error error = stopping ? Error{ErrorCode::kIo, "the server stops; try again later"}
                                         : Error{ErrorCode::kLimit, "sessions: " + std::to_string(config.sessions) +
                                                                        " are open, and no more are served; try again later"};
            tell({"refused", 0, error.what, 0});
            auto* refusal = new Refusal;
            refusal->Finish(statusOf(error));
            return refusal;
        }
        live->number = ++numbers;
        live->secret = secret();
        lives.push_back(live);
        live->stream.start([this, l = live.get()](SessionStream&) { return serve(*l); },
                           [this, l = live.get()] {
                               const std::lock_guard guard(mutex);
                               l->gone = true;
                               changed.notify_all();
                           });
        return &live->stream;
    }

    /// A stream that is told why it is not served.
    struct Refusal final : grpc::ServerBidiReactor<v1::SessionRequest, v1::SessionReply> {
        void OnDone() override { delete this; }
    };

    /// A session from its first request to its end, on its own thread.
    Status serve(Live& live) {
        Status status = run(live);
        if (const Status verdict = live.stream.verdict(); !verdict.ok()) status = verdict;
        std::shared_ptr<HostedSession> session;  // ends after the lock
        {
            const std::lock_guard lock(mutex);
            session = std::move(live.session);
        }
        session.reset();
        tell({"ended", live.number, status.ok() ? "by the client" : status.error_message(), live.info.frames()});
        return status;
    }

    Status ListSessions(grpc::ServerContext*, const v1::ListSessionsRequest*, v1::ListSessionsReply* reply) override {
        const std::lock_guard lock(mutex);
        for (const auto& live : lives) {
            if (!live->session) continue;
            v1::SessionInfo* info = reply->add_sessions();
            *info = live->info;
            info->set_open_seconds(std::chrono::duration<double>(Clock::now() - live->opened).count());
        }
        return Status::OK;
    }

    Status QueryShadow(grpc::ServerContext*, const v1::QueryShadowRequest* request, v1::QueryShadowReply* reply) override {
        return answer(request->session(), [&](HostedSession& session) { return moved(session.query(*request), *reply); });
    }

    Status GetShadowMask(grpc::ServerContext*, const v1::GetShadowMaskRequest* request, v1::ShadowMask* reply) override {
        return answer(request->session(), [&](HostedSession& session) { return moved(session.mask(*request), *reply); });
    }

    Status GetDepthMap(grpc::ServerContext*, const v1::GetDepthMapRequest* request,
                       grpc::ServerWriter<v1::DepthTile>* writer) override {
        const uint32_t tile = request->tile() == 0 ? kTile : request->tile();
        if (!std::has_single_bit(tile) || tile < kLeastTile || tile > kMostTile)
            return {StatusCode::INVALID_ARGUMENT, "tile: give a power of two from 16 to 1024 texels"};
        HostedMap map;
        const Status read = answer(request->session(), [&](HostedSession& session) { return moved(session.depthMap(*request), map); });
        if (!read.ok()) return read;
        v1::DepthTile answer;
        if (map.cascade) *answer.mutable_cascade() = *map.cascade;
        answer.set_frame(map.frame);
        for (uint32_t y = 0; y < map.side; y += tile)
            for (uint32_t x = 0; x < map.side; x += tile) {
                cut(map, x, y, tile, answer);
                if (request->zstd()) compress(*answer.mutable_depths());
                if (!writer->Write(answer)) return Status::CANCELLED;
                answer.clear_cascade();
            }
        return Status::OK;
    }

    /// What an open session says.
    Status answer(const std::string& name, const std::function<Result<Done>(HostedSession&)>& ask) {
        std::shared_ptr<HostedSession> session;
        {
            const std::lock_guard lock(mutex);
            const auto found = std::find_if(lives.begin(), lives.end(), [&](const auto& live) {
                return live->session && (live->secret == name || (!token.empty() && std::to_string(live->number) + "@" + token == name));
            });
            if (found == lives.end()) return {StatusCode::NOT_FOUND, "session: none of that name is open; give what SessionOpened told"};
            session = (*found)->session;
        }
        const auto answered = ask(*session);
        return answered ? Status::OK : statusOf(answered.error());
    }

    template <class Message>
    static Result<Done> moved(Result<Message>&& from, Message& to) {
        if (!from) return from.error();
        to = std::move(from.value());
        return Done{};
    }

    Status run(Live& live) {
        auto first = live.stream.next(false);
        if (first.empty()) return {StatusCode::INVALID_ARGUMENT, "the stream ended before its session was opened"};
        if (!first.front().has_open()) return {StatusCode::INVALID_ARGUMENT, "the first request of a session opens it; give `open`"};
        const bool shares = first.front().open().share_maps();
        if (shares && !sharing) return {StatusCode::INVALID_ARGUMENT, "share_maps: the server shares no memory; start it with --share"};
        fillDefaults(*first.front().mutable_open(), config.maps);  // and so it is recorded
        v1::SessionReply reply;
        const std::string file = config.record.empty() ? "" : config.record + "/" + std::to_string(started) + "-" + std::to_string(live.number) + kRecordingEnding;
        auto session = host.open(first.front().open(), live.number, file, *reply.mutable_opened());
        if (!session) {
            tell({"refused", live.number, session.error().what, 0});
            return statusOf(session.error());
        }
        {
            const std::lock_guard lock(mutex);
            live.session = std::move(session.value());
            live.opened = Clock::now();
            live.info.set_number(live.number);
            live.info.set_world(reply.opened().world().name());
        }
        tell({"opened", live.number, reply.opened().world().name(), 0});
        Recorder recorder;
        if (!file.empty()) {
            auto made = RecordingWriter::create(file);
            if (!made) return unrecorded(file, made.error());
            recorder.writer = std::move(made.value());
            recorder.temporary = !config.keepRecordings;
        }
        if (const Status kept = recorder.keep(EntryKind::kRequest, first.front()); !kept.ok()) return kept;
        if (const Status kept = recorder.keep(EntryKind::kReply, reply); !kept.ok()) return kept;
        reply.mutable_opened()->set_session(live.secret);
        if (shares) reply.mutable_opened()->set_share_socket(sharing->path());
        Offer offer{sharing.get(), {}, {}};
        if (!live.stream.write(reply)) return Status::CANCELLED;
        const bool latest = first.front().open().latest_pose_wins();
        for (;;) {
            auto requests = live.stream.next(latest);
            if (requests.empty()) return Status::OK;
            for (const v1::SessionRequest& request : requests)
                if (!request.has_frame()) return {StatusCode::INVALID_ARGUMENT, "after the first request of a session come frames; give `frame`"};
            v1::SessionRequest request = std::move(requests.front());
            for (size_t i = 1; i < requests.size(); ++i) mergeFrames(*request.mutable_frame(), std::move(*requests[i].mutable_frame()));
            if (const Status kept = recorder.keep(EntryKind::kRequest, request); !kept.ok()) return kept;
            auto frame = live.session->frame(request.frame());
            if (!frame) return statusOf(frame.error());
            *reply.mutable_frame() = std::move(frame.value());
            {
                const std::lock_guard lock(mutex);
                addFrame(live.info, reply.frame());
            }
            framesDrawn.fetch_add(1, std::memory_order_relaxed);
            reply.mutable_frame()->set_answers(uint32_t(requests.size()));
            if (const Status kept = recorder.keep(EntryKind::kReply, reply); !kept.ok()) return kept;
            if (shares) offer.renew(live.session->shared(), *reply.mutable_frame());
            if (!live.stream.write(reply)) return Status::CANCELLED;
        }
    }

    /// Ends sessions that ask nothing, whose replies nobody reads, or that have no frame under way while the service
    /// stops; and buries those that have ended.
    void watch() {
        std::unique_lock lock(mutex);
        while (!watchEnds) {
            const auto now = Clock::now();
            const auto over = [now](const std::optional<Clock::time_point>& since, double seconds) {
                return since && std::chrono::duration<double>(now - *since).count() > seconds;
            };
            std::vector<std::shared_ptr<Live>> hopeless;
            for (const auto& live : lives) {
                const SessionStream::Wait waits = live->stream.waits();
                const bool unread = over(waits.writing, config.unreadSeconds);
                if (unread) live->stream.end({StatusCode::DEADLINE_EXCEEDED, "nobody reads the session's replies"});
                else if (over(waits.asking, config.idleSeconds))
                    live->stream.end({StatusCode::DEADLINE_EXCEEDED, "the session was idle for too long; open another"});
                else if (stopping) live->stream.end({StatusCode::UNAVAILABLE, "the server stops; open a session again later"});
                if (unread || (stopping && now > lastMoment)) hopeless.push_back(live);
            }
            std::vector<std::shared_ptr<Live>> ended;
            std::erase_if(lives, [&](const auto& live) {
                if (live->gone) ended.push_back(live);
                return live->gone;
            });
            lock.unlock();
            for (const auto& live : hopeless) live->stream.cancel();
            for (const auto& live : ended) live->stream.join();
            lock.lock();
            changed.notify_all();
            if (ended.empty()) changed.wait_for(lock, kWatchPeriod);
        }
    }

    SessionHost& host;
    const ServiceConfig config;
    const std::function<void(const ServiceEvent&)> onEvent;
    std::mutex eventMutex;
    std::mutex mutex;
    std::condition_variable changed;
    std::vector<std::shared_ptr<Live>> lives;
    uint64_t numbers = 0;
    std::atomic<uint64_t> framesDrawn{0};
    bool stopping = false, watchEnds = false;
    Clock::time_point lastMoment;
    int64_t started = 0;  ///< [s] since 1970, for names of recordings
    std::thread watcher;
    std::string address;
    std::unique_ptr<ShareSocket> sharing;  ///< null: no memory is shared
    std::string token;  ///< the operator's; empty: none
    std::unique_ptr<grpc::Server> server;
};

Service::Service(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

Service::~Service() { stop(std::chrono::milliseconds(0)); }

Result<std::unique_ptr<Service>> Service::start(SessionHost& host, const ServiceConfig& config,
                                                std::function<void(const ServiceEvent&)> onEvent) {
    if (config.sessions == 0 || config.messageBytes == 0 || config.waitingFrames == 0 || !(config.idleSeconds > 0) ||
        !(config.unreadSeconds > 0) || !(config.silentSeconds > 0) || config.messageBytes > kLongestMessage)
        return Error{ErrorCode::kUsage, "limits of the service: give more than 0 of each, and messages of at most 256 MiB"};
    auto impl = std::make_unique<Impl>(host, config, std::move(onEvent));
    if (!config.record.empty() && !std::filesystem::is_directory(config.record))
        return Error{ErrorCode::kNotFound, config.record + ": no folder; make the one that recordings go to"};
    const auto credentials = credentialsOf(config);
    if (!credentials) return credentials.error();
    if (!config.share.empty()) {
        auto sharing = ShareSocket::listen(config.share);
        if (!sharing) return sharing.error();
        impl->sharing = std::move(sharing.value());
    }
    impl->started = std::chrono::duration_cast<std::chrono::seconds>(std::chrono::system_clock::now().time_since_epoch()).count();
    if (!config.operatorFile.empty()) impl->token = secret();

    // As in the client: a search for deadlocks at each lock that gRPC takes.
    absl::SetMutexDeadlockDetectionMode(absl::OnDeadlockCycle::kIgnore);
    grpc::EnableDefaultHealthCheckService(true);
    grpc::reflection::InitProtoReflectionServerBuilderPlugin();
    grpc::ServerBuilder builder;
    int port = 0;
    builder.AddListeningPort(config.listen, credentials.value(), &port);
    builder.SetMaxReceiveMessageSize(int(config.messageBytes));
    builder.AddChannelArgument(GRPC_ARG_ALLOW_REUSEPORT, 0);  // a second server is told that the address is taken
    const int silent = int(std::clamp(config.silentSeconds * 1e3, 1.0, 1e9));
    for (const char* argument : {GRPC_ARG_KEEPALIVE_TIME_MS, GRPC_ARG_KEEPALIVE_TIMEOUT_MS, GRPC_ARG_SERVER_HANDSHAKE_TIMEOUT_MS})
        builder.AddChannelArgument(argument, silent);
    builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
    builder.AddChannelArgument(GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA, 0);
    builder.AddChannelArgument(GRPC_ARG_HTTP2_BDP_PROBE, 0);  // a ping for each message, in a frame's way
    builder.RegisterService(impl.get());
    impl->server = builder.BuildAndStart();
    if (!impl->server || (port == 0 && !config.listen.starts_with("unix:")))
        return Error{ErrorCode::kIo, "listen " + config.listen + ": that address cannot be had; is another server on it?"};
    if (!config.operatorFile.empty())
        if (const auto written = writeToken(config.operatorFile, impl->token); !written) return written.error();
    const size_t colon = config.listen.rfind(':');
    impl->address = config.listen.starts_with("unix:") ? config.listen : config.listen.substr(0, colon + 1) + std::to_string(port);
    impl->watcher = std::thread([i = impl.get()] { i->watch(); });
    impl->tell({"listening", 0, impl->address, 0});
    return std::unique_ptr<Service>(new Service(std::move(impl)));
}

const std::string& Service::address() const { return impl_->address; }

size_t Service::sessions() const {
    const std::lock_guard lock(impl_->mutex);
    return impl_->lives.size();
}

uint64_t Service::frames() const { return impl_->framesDrawn.load(std::memory_order_relaxed); }

void Service::stop(std::chrono::milliseconds patience) {
    Impl& s = *impl_;
    if (!s.server) return;
    {
        std::unique_lock lock(s.mutex);
        s.stopping = true;
        s.lastMoment = Clock::now() + patience;
        s.changed.notify_all();
        s.changed.wait(lock, [&s] { return s.lives.empty(); });  // the watch ends them
    }
    s.server->Shutdown(std::chrono::system_clock::now() + std::chrono::milliseconds(500));
    {
        const std::lock_guard lock(s.mutex);
        s.watchEnds = true;
        s.changed.notify_all();
    }
    s.watcher.join();
    s.server.reset();
    s.tell({"stopped", 0, s.address, s.framesDrawn});
}

}  // namespace server
