// server/oversight.h — for whoever looks after a service: what its sessions came to, and the token by which the operator may
// ask about any of them.
#pragma once

#include <string>

#include "server/gnomon.pb.h"
#include "world/result.h"

namespace server {

/// Adds a frame that was answered to what is told of its session.
void addFrame(gnomon::v1::SessionInfo& info, const gnomon::v1::FrameReply& frame);

/// Makes a file, or replaces one, that only this user can read. kIo names it.
world::Result<world::Done> writeToken(const std::string& path, const std::string& token);

}  // namespace server
