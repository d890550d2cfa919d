#include "server/client.h"

#include <absl/synchronization/mutex.h>
#include <grpcpp/grpcpp.h>

#include <chrono>
#include <utility>

#include "server/gnomon.grpc.pb.h"

namespace server {

namespace v1 = gnomon::v1;
using grpc::StatusCode;
using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

namespace {

std::chrono::system_clock::time_point momentIn(double seconds) {
    return std::chrono::system_clock::now() + std::chrono::milliseconds(int64_t(seconds * 1e3));
}

Error errorOf(const grpc::Status& status) {
    const auto code = [&] {
        switch (status.error_code()) {
            case StatusCode::INVALID_ARGUMENT: return ErrorCode::kUsage;
            case StatusCode::NOT_FOUND: return ErrorCode::kNotFound;
            case StatusCode::DATA_LOSS: return ErrorCode::kBadData;
            case StatusCode::RESOURCE_EXHAUSTED: return ErrorCode::kLimit;
            case StatusCode::INTERNAL: return ErrorCode::kDevice;
            default: return ErrorCode::kIo;
        }
    }();
    return {code, status.error_message().empty() ? "the server ended the call" : status.error_message(), int(status.error_code())};
}

}  // namespace

struct ClientSession::Impl {
    grpc::ClientContext context;
    std::unique_ptr<grpc::ClientReaderWriter<v1::SessionRequest, v1::SessionReply>> stream;
    v1::SessionOpened opened;
    std::optional<grpc::Status> end;

    /// The stream is broken or over: what the server says of it.
    Error over() {
        if (!end) end = stream->Finish();
        return end->ok() ? Error{ErrorCode::kIo, "the session has ended"} : errorOf(*end);
    }
};

ClientSession::ClientSession(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

ClientSession::~ClientSession() {
    if (impl_->end) return;
    impl_->context.TryCancel();
    impl_->over();
}

const v1::SessionOpened& ClientSession::opened() const { return impl_->opened; }

Result<Done> ClientSession::send(const v1::Frame& frame) {
    v1::SessionRequest request;
    *request.mutable_frame() = frame;
    if (impl_->end || !impl_->stream->Write(request))
        return Error{ErrorCode::kIo, "the session takes no more frames; `receive` tells why"};
    return Done{};
}

Result<v1::FrameReply> ClientSession::receive() {
    v1::SessionReply reply;
    if (impl_->end || !impl_->stream->Read(&reply)) return impl_->over();
    if (!reply.has_frame()) return Error{ErrorCode::kBadData, "the server answered a frame with something else"};
    return std::move(*reply.mutable_frame());
}

Result<v1::FrameReply> ClientSession::frame(const v1::Frame& frame) {
    [[maybe_unused]] const auto sent = send(frame);  // what is wrong with a stream only the other direction tells
    return receive();
}

Result<Done> ClientSession::close() {
    if (!impl_->end) {
        impl_->stream->WritesDone();
        v1::SessionReply rest;
        while (impl_->stream->Read(&rest)) {}
        impl_->end = impl_->stream->Finish();
    }
    if (!impl_->end->ok()) return errorOf(*impl_->end);
    return Done{};
}

struct Client::Impl {
    std::shared_ptr<grpc::Channel> channel;
    std::unique_ptr<v1::Gnomon::Stub> stub;
    std::optional<double> patience;  ///< [s]

    /// A call that begins now.
    void begin(grpc::ClientContext& context) const {
        if (patience) context.set_deadline(momentIn(*patience));
    }
};

Client::Client(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Client::Client(Client&&) noexcept = default;
Client& Client::operator=(Client&&) noexcept = default;
Client::~Client() = default;

Result<Client> Client::connect(const std::string& address, const std::optional<TlsFiles>& tls) {
    std::shared_ptr<grpc::ChannelCredentials> credentials = grpc::InsecureChannelCredentials();
    if (tls) {
        const auto texts = readTls(*tls);
        if (!texts) return texts.error();
        credentials = grpc::SslCredentials({texts.value().authority, texts.value().key, texts.value().certificate});
    }
    grpc::ChannelArguments arguments;
    arguments.SetMaxReceiveMessageSize(-1);
    // Each client tries by itself, and soon: not as late as others that had no luck at the address.
    arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
    arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, 100);
    arguments.SetInt(GRPC_ARG_HTTP2_BDP_PROBE, 0);  // as in the service
    // Debian's Abseil looks for deadlocks whenever gRPC takes a lock: 22,000 instructions a frame.
    absl::SetMutexDeadlockDetectionMode(absl::OnDeadlockCycle::kIgnore);
    auto impl = std::make_unique<Impl>();
    impl->channel = grpc::CreateCustomChannel(address, credentials, arguments);
    impl->stub = v1::Gnomon::NewStub(impl->channel);
    return Client(std::move(impl));
}

Result<Done> Client::healthy(double seconds) {
    const auto until = momentIn(seconds);
    if (!impl_->channel->WaitForConnected(until)) return Error{ErrorCode::kIo, "no server answers at that address"};
    grpc::ClientContext context;
    context.set_deadline(until);
    v1::ListWorldsReply reply;
    if (const auto status = impl_->stub->ListWorlds(&context, {}, &reply); !status.ok()) return errorOf(status);
    return Done{};
}

void Client::setPatience(double seconds) { impl_->patience = seconds; }

Result<std::vector<std::string>> Client::worlds() {
    grpc::ClientContext context;
    impl_->begin(context);
    v1::ListWorldsReply reply;
    if (const auto status = impl_->stub->ListWorlds(&context, {}, &reply); !status.ok()) return errorOf(status);
    return std::vector<std::string>(reply.names().begin(), reply.names().end());
}

Result<std::vector<v1::SessionInfo>> Client::sessions() {
    grpc::ClientContext context;
    impl_->begin(context);
    v1::ListSessionsReply reply;
    if (const auto status = impl_->stub->ListSessions(&context, {}, &reply); !status.ok()) return errorOf(status);
    return std::vector<v1::SessionInfo>(reply.sessions().begin(), reply.sessions().end());
}

Result<v1::WorldInfo> Client::openWorld(const std::string& name) {
    grpc::ClientContext context;
    impl_->begin(context);
    v1::OpenWorldRequest request;
    request.set_name(name);
    v1::WorldInfo reply;
    if (const auto status = impl_->stub->OpenWorld(&context, request, &reply); !status.ok()) return errorOf(status);
    return reply;
}

Result<std::unique_ptr<ClientSession>> Client::session(const v1::OpenSession& open) {
    auto impl = std::make_unique<ClientSession::Impl>();
    impl->stream = impl_->stub->Session(&impl->context);
    v1::SessionRequest request;
    *request.mutable_open() = open;
    v1::SessionReply reply;
    if (!impl->stream->Write(request) || !impl->stream->Read(&reply)) return impl->over();
    impl->opened = reply.opened();
    return std::unique_ptr<ClientSession>(new ClientSession(std::move(impl)));
}

Result<v1::QueryShadowReply> Client::query(const v1::QueryShadowRequest& request) {
    grpc::ClientContext context;
    impl_->begin(context);
    v1::QueryShadowReply reply;
    if (const auto status = impl_->stub->QueryShadow(&context, request, &reply); !status.ok()) return errorOf(status);
    return reply;
}

Result<v1::ShadowMask> Client::mask(const v1::GetShadowMaskRequest& request) {
    grpc::ClientContext context;
    impl_->begin(context);
    v1::ShadowMask reply;
    if (const auto status = impl_->stub->GetShadowMask(&context, request, &reply); !status.ok()) return errorOf(status);
    return reply;
}

Result<std::vector<v1::DepthTile>> Client::depthMap(const v1::GetDepthMapRequest& request) {
    grpc::ClientContext context;
    impl_->begin(context);
    const auto reader = impl_->stub->GetDepthMap(&context, request);
    std::vector<v1::DepthTile> tiles;
    for (v1::DepthTile tile; reader->Read(&tile);) tiles.push_back(std::move(tile));
    if (const auto status = reader->Finish(); !status.ok()) return errorOf(status);
    return tiles;
}

}  // namespace server
