// server/client.h — a client of the service: blocking calls, errors as values.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "server/gnomon.pb.h"
#include "server/pem.h"
#include "world/result.h"

namespace server {

/// One session's stream. One thread sends and one receives, or one does both.
class ClientSession {
public:
    ~ClientSession();  ///< gives the session up if it was not closed

    const gnomon::v1::SessionOpened& opened() const;
    /// kIo where the session has ended.
    world::Result<world::Done> send(const gnomon::v1::Frame& frame);
    /// The next reply. Errors here and below: what the server ended the session with; kIo where it is not reached.
    world::Result<gnomon::v1::FrameReply> receive();
    /// Tells that no frame follows, and waits for the end.
    world::Result<world::Done> close();
    /// Sends and receives.
    world::Result<gnomon::v1::FrameReply> frame(const gnomon::v1::Frame& frame);

private:
    friend class Client;
    struct Impl;
    explicit ClientSession(std::unique_ptr<Impl> impl);
    std::unique_ptr<Impl> impl_;
};

/// Any thread.
class Client {
public:
    /// Where `Service::address` says. With `tls` the server's certificate must be signed by the authority, and its own
    /// are shown. Nothing is asked of the server yet. kNotFound for files. Switches off, in the whole process, the search
    /// for deadlocks of Abseil's locks, which Debian's build begins with.
    static world::Result<Client> connect(const std::string& address, const std::optional<TlsFiles>& tls = {});
    Client(Client&&) noexcept;
    Client& operator=(Client&&) noexcept;
    ~Client();

    /// kIo within `seconds` where the server is not reached or does not serve.
    world::Result<world::Done> healthy(double seconds = 5);
    /// From now on questions below, but for `session`, end with kIo after so long.
    void setPatience(double seconds);
    world::Result<std::vector<std::string>> worlds();
    world::Result<std::vector<gnomon::v1::SessionInfo>> sessions();
    world::Result<gnomon::v1::WorldInfo> openWorld(const std::string& name);
    world::Result<std::unique_ptr<ClientSession>> session(const gnomon::v1::OpenSession& open);
    world::Result<gnomon::v1::QueryShadowReply> query(const gnomon::v1::QueryShadowRequest& request);
    world::Result<gnomon::v1::ShadowMask> mask(const gnomon::v1::GetShadowMaskRequest& request);
    /// All tiles, in order.
    world::Result<std::vector<gnomon::v1::DepthTile>> depthMap(const gnomon::v1::GetDepthMapRequest& request);

private:
    struct Impl;
    explicit Client(std::unique_ptr<Impl> impl);
    std::unique_ptr<Impl> impl_;
};

}  // namespace server
