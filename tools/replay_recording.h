// tools/replay_recording.h — `gnomon replay` of a service's recording.
#pragma once

#include <string>

#include "gpu/device.h"
#include "world/result.h"

namespace tools {

struct RecordingOptions {
    std::string recording, worlds;  ///< file; folder of its world, empty: the file's own
    bool compare = false;           ///< with the recorded replies
    gpu::DeviceConfig device;
};

/// Prints what the frames came to. Exit status 1 if a reply differs from the recorded one; what differs is printed.
world::Result<int> replayRecording(const RecordingOptions& options);

}  // namespace tools
