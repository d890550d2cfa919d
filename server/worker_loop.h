// server/worker_loop.h — the worker's side: requests in, replies out, one after the other.
#pragma once

#include <string>

#include "server/session_host.h"
#include "world/result.h"

namespace server {

/// A message on a stream socket: its length (u32, little-endian), then itself. kIo at the other side's end.
world::Result<world::Done> sendMessage(int socket, const google::protobuf::MessageLite& message);
world::Result<world::Done> receiveMessage(int socket, google::protobuf::MessageLite& message);

/// Draws for whoever is at the socket's other end, until that ends. kBadData where it is no front end of this build.
world::Result<world::Done> runWorker(SessionHost& host, int socket);

}  // namespace server
