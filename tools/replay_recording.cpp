#include "tools/replay_recording.h"

#include <cinttypes>
#include <cstdio>
#include <filesystem>

#include "server/gnomon.pb.h"
#include "server/session_replay.h"

namespace tools {

using world::Result;

Result<int> replayRecording(const RecordingOptions& options) {
    const std::filesystem::path beside = std::filesystem::path(options.recording).parent_path();
    const std::string folder = !options.worlds.empty() ? options.worlds : beside.empty() ? "." : beside.string();
    auto worlds = server::WorldFolder::create(folder);
    if (!worlds) return worlds.error();
    auto device = gpu::Device::create(options.device);
    if (!device) return device.error();
    uint64_t texels = 0, triangles = 0, plan = 0, errors = 0;
    const auto replay = server::replaySession(*device.value(), *worlds.value(), options.recording, options.compare,
                                              [&](const gnomon::v1::FrameReply& reply) {
                                                  for (const auto& c : reply.cascades()) {
                                                      texels += c.total().texels();
                                                      triangles += c.total().triangles();
                                                  }
                                                  plan = reply.plan_hash();
                                                  errors += uint64_t(reply.errors_size());
                                              });
    if (!replay) return replay.error();
    const server::SessionReplay& r = replay.value();
    std::printf("%s: %" PRIu64 " frames, %" PRIu64 " texels and %" PRIu64 " triangles for static casters, %" PRIu64
                " errors of items; last plan %016" PRIx64 "\n",
                options.recording.c_str(), r.frames, texels, triangles, errors, plan);
    if (r.torn) std::printf("The recording ends in the middle of an entry: its writer was cut off\n");
    if (options.compare) std::printf("%" PRIu64 " replies compared%s\n", r.compared, r.difference.empty() ? ", none differs" : "");
    if (r.difference.empty()) return 0;
    std::printf("%s", r.difference.c_str());
    return 1;
}

}  // namespace tools
