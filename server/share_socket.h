// server/share_socket.h — hands shared memory to whoever shows the token that a reply gave: once, over a Unix socket.
#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "server/shared_maps.h"
#include "world/result.h"

namespace server {

/// Sends or takes a descriptor beside one byte over a Unix socket. kIo; -1 is never given.
world::Result<world::Done> sendDescriptor(int socket, int descriptor);
world::Result<int> receiveDescriptor(int socket);

/// Any thread.
class ShareSocket {
public:
    /// Only this user can reach it. kIo, kUsage for a path that is too long for a socket.
    static world::Result<std::unique_ptr<ShareSocket>> listen(const std::string& path);
    ~ShareSocket();
    ShareSocket(const ShareSocket&) = delete;
    ShareSocket& operator=(const ShareSocket&) = delete;

    const std::string& path() const { return path_; }
    /// Gives the memory to the first who shows the token, as long as it is offered.
    void offer(const std::string& token, std::shared_ptr<SharedMaps> maps);
    void withdraw(const std::string& token);

private:
    ShareSocket(int socket, std::string path);
    void serve();
    void answer(int client);

    const int socket_;
    const std::string path_;
    std::mutex mutex_;
    std::map<std::string, std::shared_ptr<SharedMaps>> offers_;
    std::thread thread_;
};

/// A client's side: the memory behind a token. kNotFound for a token that is not, or not any more, good for any.
world::Result<std::shared_ptr<SharedMaps>> fetchShared(const std::string& path, const std::string& token);

}  // namespace server
