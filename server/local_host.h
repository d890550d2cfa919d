// server/local_host.h — sessions drawn in this process, one frame at a time on the whole device, in turns.
#pragma once

#include <memory>
#include <string>

#include "gpu/device.h"
#include "server/live_board.h"
#include "server/session.h"
#include "server/session_host.h"

namespace server {

/// Over the worlds of one folder.
///   device  outlives the host, and so does the board; null: frames are published nowhere
/// kNotFound, kUsage for a path that is no folder.
world::Result<std::unique_ptr<SessionHost>> makeLocalHost(gpu::Device& device, const std::string& worlds,
                                                          const SessionLimits& limits, LiveBoard* board = nullptr);

}  // namespace server
