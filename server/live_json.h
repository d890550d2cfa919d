// server/live_json.h — what the live page is told, as JSON.
//
// `hello`, once a connection:  {"started", "causes": [name], "picture": side}
// `news`, a few times a second:
//   sessions  [{"id", "name", "world", "frames"}]
//   session   the one that is followed; null when there is none, and then nothing else is there
//   frames    [{"n", "frame", "t", "ms", "gpu", "texels", "triangles", "resident", "geometry", "missing", "coarse",
//             "unknown", "stale", "eye": [x, y, z], "ahead": [x, z]}]; texels and triangles are by cause, in the order of
//             `causes`, and then of the working maps. Metres, milliseconds, bytes
//   marks     [[n, cascade, cause, x, y, width, height]] in lattice texels; cause -1: an active caster
//   cascades  [{"camera", "texel", "split", "x", "y", "drawn", "asleep", "unknown", "stale", "missing", "picture"}]
//   chunks    {"n", "size", "away", "places": [x, z, phase, ...]}, where they changed; phases as world::ChunkPhase
//   settings  [[name, value]], where they changed
//   errors    {"count", "last": [text]}, lost, side
#pragma once

#include <string>
#include <vector>

#include "server/live_board.h"

namespace server {

/// What one watcher has been told; begins anew with each session.
struct LiveSeen {
    LiveId session = 0;
    uint64_t number = 0;  ///< of the last frame
    uint64_t chunks = 0;
};

/// When the process began tells a page that what it holds is of another one.
///   started  [s] since 1970
std::string helloJson(int64_t started);
/// Text that is not UTF-8 is told with replacement characters. `seen` is brought up to date.
///   news  empty: no such session
std::string newsJson(const std::vector<LiveName>& sessions, const std::optional<LiveNews>& news, LiveSeen& seen);
/// A line of JSON, {"n", "x", "y", "side", "texels", "near", "far"}, and then the picture's bytes.
std::string pictureBody(const LivePicture& picture);

}  // namespace server
