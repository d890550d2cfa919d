#include "server/share_socket.h"

#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

namespace server {

using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

namespace {

constexpr size_t kTokenBytes = 32;  ///< of a token, as hexadecimal digits
constexpr timeval kPatience{0, 200'000};  ///< for a client that says no token

Error ioError(const std::string& what) { return {ErrorCode::kIo, what + ": " + std::strerror(errno), errno}; }

Result<sockaddr_un> addressOf(const std::string& path) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    if (path.empty() || path.size() >= sizeof address.sun_path)
        return Error{ErrorCode::kUsage, "share " + path + ": give a path of at most " + std::to_string(sizeof address.sun_path - 1) + " bytes"};
    std::memcpy(address.sun_path, path.data(), path.size());
    return address;
}

/// The place beside a byte that a descriptor takes.
union Control {
    cmsghdr head;
    char bytes[CMSG_SPACE(sizeof(int))];
};

}  // namespace

Result<Done> sendDescriptor(int socket, int descriptor) {
    char one = 1;
    iovec part{&one, 1};
    Control control{};
    msghdr message{};
    message.msg_iov = &part;
    message.msg_iovlen = 1;
    message.msg_control = control.bytes;
    message.msg_controllen = sizeof control.bytes;
    cmsghdr* head = CMSG_FIRSTHDR(&message);
    head->cmsg_level = SOL_SOCKET;
    head->cmsg_type = SCM_RIGHTS;
    head->cmsg_len = CMSG_LEN(sizeof(int));
    std::memcpy(CMSG_DATA(head), &descriptor, sizeof(int));
    if (::sendmsg(socket, &message, MSG_NOSIGNAL) != 1) return ioError("descriptor");
    return Done{};
}

Result<int> receiveDescriptor(int socket) {
    char one = 0;
    iovec part{&one, 1};
    Control control{};
    msghdr message{};
    message.msg_iov = &part;
    message.msg_iovlen = 1;
    message.msg_control = control.bytes;
    message.msg_controllen = sizeof control.bytes;
    const ssize_t got = ::recvmsg(socket, &message, MSG_CMSG_CLOEXEC);
    if (got < 0) return ioError("descriptor");
    const cmsghdr* head = CMSG_FIRSTHDR(&message);
    if (got != 1 || !head || head->cmsg_level != SOL_SOCKET || head->cmsg_type != SCM_RIGHTS || head->cmsg_len != CMSG_LEN(sizeof(int)))
        return Error{ErrorCode::kIo, "descriptor: none came"};
    int descriptor;
    std::memcpy(&descriptor, CMSG_DATA(head), sizeof(int));
    return descriptor;
}

ShareSocket::ShareSocket(int socket, std::string path) : socket_(socket), path_(std::move(path)), thread_([this] { serve(); }) {}

Result<std::unique_ptr<ShareSocket>> ShareSocket::listen(const std::string& path) {
    const auto address = addressOf(path);
    if (!address) return address.error();
    const int socket = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (socket < 0) return ioError("share " + path);
    ::unlink(path.c_str());
    const auto* to = reinterpret_cast<const sockaddr*>(&address.value());
    if (::bind(socket, to, sizeof(sockaddr_un)) != 0 || ::chmod(path.c_str(), 0600) != 0 || ::listen(socket, SOMAXCONN) != 0) {
        const Error error = ioError("share " + path);
        ::close(socket);
        return error;
    }
    return std::unique_ptr<ShareSocket>(new ShareSocket(socket, path));
}

ShareSocket::~ShareSocket() {
    ::shutdown(socket_, SHUT_RDWR);
    thread_.join();
    ::close(socket_);
    ::unlink(path_.c_str());
}

void ShareSocket::offer(const std::string& token, std::shared_ptr<SharedMaps> maps) {
    const std::lock_guard lock(mutex_);
    offers_[token] = std::move(maps);
}

void ShareSocket::withdraw(const std::string& token) {
    const std::lock_guard lock(mutex_);
    offers_.erase(token);
}

void ShareSocket::serve() {
    for (;;) {
        const int client = ::accept4(socket_, nullptr, nullptr, SOCK_CLOEXEC);
        if (client < 0 && (errno == EINTR || errno == ECONNABORTED)) continue;
        if (client < 0 && (errno == EMFILE || errno == ENFILE)) {  // some will be free again
            ::usleep(100'000);
            continue;
        }
        if (client < 0) return;
        answer(client);
        ::close(client);
    }
}

void ShareSocket::answer(int client) {
    ::setsockopt(client, SOL_SOCKET, SO_RCVTIMEO, &kPatience, sizeof kPatience);
    char token[kTokenBytes];
    if (::recv(client, token, sizeof token, MSG_WAITALL) != ssize_t(sizeof token)) return;
    std::shared_ptr<SharedMaps> maps;
    {
        const std::lock_guard lock(mutex_);
        const auto found = offers_.find(std::string(token, sizeof token));
        if (found == offers_.end()) return;
        maps = std::move(found->second);
        offers_.erase(found);
    }
    [[maybe_unused]] const auto sent = sendDescriptor(client, maps->descriptor());  // who is gone has had its chance
}

Result<std::shared_ptr<SharedMaps>> fetchShared(const std::string& path, const std::string& token) {
    const auto address = addressOf(path);
    if (!address) return address.error();
    const int socket = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (socket < 0) return ioError("share " + path);
    const bool asked = ::connect(socket, reinterpret_cast<const sockaddr*>(&address.value()), sizeof(sockaddr_un)) == 0 &&
                       ::send(socket, token.data(), token.size(), MSG_NOSIGNAL) == ssize_t(token.size());
    const auto descriptor = asked ? receiveDescriptor(socket) : Result<int>(ioError("share " + path));
    ::close(socket);
    if (!asked) return descriptor.error();
    if (!descriptor) return Error{ErrorCode::kNotFound, "share " + path + ": the token is good for nothing, or was shown before; take that of the last reply"};
    return SharedMaps::read(descriptor.value());
}

}  // namespace server
