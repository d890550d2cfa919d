// tools/replay.h — the loop that drives a ShadowSystem along a recorded path and hands out each frame.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "server/shadow_system.h"
#include "tools/mover_feed.h"
#include "tools/options.h"
#include "world/path.h"

namespace tools {

class Dump;

/// Hashes of one cascade's maps.
struct MapHashes {
    uint64_t cache = 0, working = 0;
};

/// One frame of a replay.
struct ReplayFrame {
    uint64_t number = 0;  ///< in the replay, counted from the path's first pose
    glm::dvec3 eye{0};    ///< of the first camera [m]
    server::FrameReport report;
    server::RedrawCosts redraw;                  ///< the static part drawn whole, counted without drawing
    std::optional<server::VerifyReport> verify;  ///< where the maps were redrawn and compared
    std::vector<MapHashes> hashes;  ///< per cascade on verified frames and the last one, else empty
    std::vector<server::CasterCost> dearest;  ///< of static casters, all or none; dearest first
    double advanceMs = 0;           ///< wall time of ShadowSystem::advance; not deterministic
};

struct ReplayInput {
    std::vector<world::Pose> poses;  ///< one per frame, ascending in time, not empty
    std::vector<std::vector<world::Pose>> others;  ///< the same of each further camera; times are those of `poses`
    uint64_t firstNumber = 0;        ///< of poses.front() in the replay
    /// Every so many frames, counted from frame 0, the maps are redrawn and compared; > 0. Frames that
    /// are dumped always are.
    uint64_t verifyEvery = 1;
    double verticalFov = 0;  ///< of the recorded camera [rad]; 0: not known
    bool foresight = false;  ///< the system is told where the path leads, kForesight seconds ahead
    bool live = false;       ///< frames wait for the path's own time
    bool dearest = false;    ///< each frame names its static casters and their costs
    double daySeconds = 0;   ///< above 0: from the first frame on the sun runs through a day in so long
};

/// The sun of a made-up day, direction of light travel: at 0 in the east and 5 degrees high, at 0.5 in the
/// south and 60 degrees high, at 1 in the west.
glm::dvec3 sunOfDay(double share);

/// How far ahead a path is told [s].
constexpr double kForesight = 4;

/// Of the recorded camera, where its field of view is given.
constexpr double kAspect = 16.0 / 9;

/// Timestamps of a cascade; zero where the frame was idle: it submits nothing and lists none.
gpu::CascadeTimes timesOf(const gpu::GpuTimes& times, size_t cascade);

/// Poses of a replay: the path's own or, if fps > 0, the path resampled at firstTime + k / fps; then
/// cut to `range`. kUsage for a range that reaches past the end (the text names the count) and for an
/// fps that is negative, not finite or gives more than 10 million frames.
world::Result<std::vector<world::Pose>> replayPoses(const std::vector<world::Pose>& path, double fps,
                                                    const std::optional<FrameRange>& range);

/// kUsage, naming both extents, if no pose is within `bounds` grown by `farDistance` [m] in x and z:
/// no caster of the world could then reach any map.
world::Result<world::Done> requirePathInWorld(const std::vector<world::Pose>& poses, const world::Box& bounds,
                                              double farDistance);

/// Which frames are redrawn to time them when nobody asked to verify: about 60 of `frames`.
uint64_t samplingStep(uint64_t frames);

/// What the cameras see in a frame; nothing else of it is filled in.
///   others  replaced: the further cameras, to which the answer refers
server::FrameInput camerasAt(const ReplayInput& input, size_t index, std::vector<server::Camera>& others);

/// Plays the input into the system. `movers` and `dump` may be null. `onFrame` gets each frame in
/// order and can end the replay with an error. Errors of the system pass through, with the frame's
/// number. One thread at a time.
world::Result<world::Done> replay(
    server::ShadowSystem& system, const ReplayInput& input, MoverFeed* movers, Dump* dump,
    const std::function<world::Result<world::Done>(const ReplayFrame&)>& onFrame);

}  // namespace tools
