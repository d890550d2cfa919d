#include "server/worker_loop.h"

#include <sys/socket.h>

#include <cerrno>
#include <cstring>
#include <map>
#include <utility>

#include "server/messages.h"
#include "server/share_socket.h"
#include "server/worker.h"
#include "server/worker.pb.h"

namespace server {

namespace wire = gnomon::worker;
using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

namespace {

/// False at the other side's end.
bool sendAll(int socket, const char* bytes, size_t count) {
    while (count > 0) {
        const ssize_t n = ::send(socket, bytes, count, MSG_NOSIGNAL);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) return false;
        bytes += n;
        count -= size_t(n);
    }
    return true;
}

bool receiveAll(int socket, char* bytes, size_t count) {
    while (count > 0) {
        const ssize_t n = ::recv(socket, bytes, count, MSG_WAITALL);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) return false;
        bytes += n;
        count -= size_t(n);
    }
    return true;
}

const Error kEnd{ErrorCode::kIo, "the process at the other end is gone"};

void tell(wire::Reply& reply, const Error& error) {
    reply.mutable_error()->set_code(codeOf(error.code));
    reply.mutable_error()->set_what(error.what);
}

/// The value, or the error.
template <class Value>
void tell(wire::Reply& reply, Value* (wire::Reply::*field)(), Result<Value>&& value) {
    if (value) *(reply.*field)() = std::move(value.value());
    else tell(reply, value.error());
}

class Loop {
public:
    explicit Loop(SessionHost& host) : host_(host) {}

    wire::Reply answer(const wire::Request& request) {
        wire::Reply reply;
        const auto session = sessions_.find(request.session());
        switch (request.what_case()) {
            case wire::Request::kOpen: {
                auto opened = host_.open(request.open(), request.session(), "", *reply.mutable_opened());
                if (!opened) return failed(opened.error());
                shared = opened.value()->shared();
                reply.set_shares(shared != nullptr);
                sessions_[request.session()] = std::move(opened.value());
                return reply;
            }
            case wire::Request::kEnd:
                sessions_.erase(request.session());
                return reply;
            case wire::Request::kListWorlds: {
                const auto names = host_.worlds();
                if (!names) tell(reply, names.error());
                else
                    for (const std::string& name : names.value()) reply.mutable_worlds()->add_names(name);
                return reply;
            }
            case wire::Request::kOpenWorld:
                tell(reply, &wire::Reply::mutable_world, host_.openWorld(request.open_world().name()));
                return reply;
            default:
                break;
        }
        if (session == sessions_.end()) tell(reply, {ErrorCode::kNotFound, "session: there is none of that number"});
        else if (request.has_frame()) tell(reply, &wire::Reply::mutable_frame, session->second->frame(request.frame()));
        else if (request.has_query()) tell(reply, &wire::Reply::mutable_query, session->second->query(request.query()));
        else if (request.has_mask()) tell(reply, &wire::Reply::mutable_mask, session->second->mask(request.mask()));
        else if (request.has_map()) map(*session->second, request.map(), reply);
        else tell(reply, {ErrorCode::kBadData, "worker: a request that it does not know"});
        return reply;
    }

    std::shared_ptr<SharedMaps> shared;  ///< of the session that was opened, to be sent after the reply

private:
    static wire::Reply failed(const Error& error) {
        wire::Reply reply;
        tell(reply, error);
        return reply;
    }
    static void map(HostedSession& session, const gnomon::v1::GetDepthMapRequest& request, wire::Reply& reply) {
        auto map = session.depthMap(request);
        if (!map) return tell(reply, map.error());
        wire::DepthMap& to = *reply.mutable_map();
        *to.mutable_depths() = std::move(map.value().depths);
        to.set_side(map.value().side);
        if (map.value().cascade) *to.mutable_cascade() = *map.value().cascade;
        to.set_frame(map.value().frame);
    }

    SessionHost& host_;
    std::map<uint64_t, std::unique_ptr<HostedSession>> sessions_;
};

}  // namespace

Result<Done> sendMessage(int socket, const google::protobuf::MessageLite& message) {
    std::string bytes(4, '\0');
    if (!message.AppendToString(&bytes)) return Error{ErrorCode::kLimit, "a message of more than 2 GiB"};
    const auto length = uint32_t(bytes.size() - 4);
    std::memcpy(bytes.data(), &length, 4);
    if (!sendAll(socket, bytes.data(), bytes.size())) return kEnd;
    return Done{};
}

Result<Done> receiveMessage(int socket, google::protobuf::MessageLite& message) {
    uint32_t length;
    if (!receiveAll(socket, reinterpret_cast<char*>(&length), sizeof length)) return kEnd;
    std::string bytes(length, '\0');
    if (!receiveAll(socket, bytes.data(), bytes.size())) return kEnd;
    if (!message.ParseFromString(bytes)) return Error{ErrorCode::kBadData, "worker: a message that is none; use one build"};
    return Done{};
}

Result<Done> runWorker(SessionHost& host, int socket) {
    Loop loop(host);
    for (wire::Reply reply;;) {  // the first says that it serves
        if (!sendMessage(socket, reply)) return Done{};
        if (reply.shares() && !sendDescriptor(socket, loop.shared->descriptor())) return Done{};
        loop.shared.reset();
        wire::Request request;
        const auto received = receiveMessage(socket, request);
        if (!received && received.error().code == ErrorCode::kIo) return Done{};
        if (!received) return received.error();
        reply = loop.answer(request);
    }
}

}  // namespace server
