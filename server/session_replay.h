// server/session_replay.h — a recorded session once more, and whether it is answered as it was.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "gpu/device.h"
#include "server/world_folder.h"
#include "world/result.h"

namespace gnomon::v1 {
class FrameReply;
}

namespace server {

struct SessionReplay {
    uint64_t frames = 0;     ///< drawn
    uint64_t compared = 0;   ///< of these, with a recorded reply
    bool torn = false;       ///< the recording ends in the middle of an entry
    std::string difference;  ///< empty, or the first frame that was answered otherwise, and how
};

/// Draws the frames of a recording in a session like the recorded one. With `compare` it stops at the first reply that
/// differs from the recorded one in anything but times. kBadData for a recording that is damaged, or not of that world's
/// content; errors of the session name the frame.
///   onFrame  each reply, in order
world::Result<SessionReplay> replaySession(gpu::Device& device, WorldFolder& worlds, const std::string& recording, bool compare,
                                           const std::function<void(const gnomon::v1::FrameReply&)>& onFrame);

}  // namespace server
