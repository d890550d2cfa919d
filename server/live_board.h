// server/live_board.h — what the sessions of a process do, for whoever watches: the live page and /metrics.
//
// A session's owner opens an entry and publishes each frame from the thread that advances the system:
//     LiveSession live = board.open(name, world);         // closed by its destructor
//     auto report = system->advance(input);  ...  system->finish(report.value());
//     live.publish(*system, input, report.value(), ms);   // ms: wall time of the frame, as its client waits for it
// A frame that nobody watches costs a few additions and a copy of its totals. What is dearer (rectangles, chunks,
// pictures of maps) is made while somebody watches the session, a few times a second, in a twentieth of the time.
// Everything is bounded: old frames and rectangles make room for new ones. Watchers copy, under locks that are held for
// no more than that copy, so that none of them can hold a frame up.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "cache/statistics.h"
#include "server/shadow_system.h"

namespace server {

/// A session's number; given out from 1, never twice.
using LiveId = uint64_t;

constexpr size_t kLiveFrames = 600;     ///< remembered per session
constexpr size_t kLiveMarks = 1024;     ///< rectangles remembered per session
constexpr size_t kLiveChunks = 4096;    ///< told of, those nearest the first camera
constexpr int kLivePictureSide = 256;   ///< texels of a picture of a map, at most

/// One frame: all cascades together.
struct LiveFrame {
    uint64_t number = 0;  ///< of the session's published frames, from 1
    uint64_t frame = 0;   ///< FrameReport::frame
    double time = 0;      ///< of the input [s]
    double ms = 0;        ///< wall time
    double gpuMs = 0;     ///< of it, from submission to fence; 0 where nothing was drawn or nobody waited for it
    std::array<cache::Cost, cache::kCauses> byCause{};  ///< static part
    cache::Cost active;   ///< working maps
    uint64_t residentBytes = 0, geometryBytes = 0;
    uint32_t missingChunks = 0, coarseChunks = 0;
    uint64_t unknownTexels = 0, staleTexels = 0;
    glm::dvec3 eye{0};      ///< of the first camera [m]
    glm::dvec2 heading{0};  ///< its direction of view on the ground, x and z, unit or 0
};

/// A rectangle of a cascade's lattice in which a frame changed something.
struct LiveMark {
    uint64_t number = 0;  ///< of the frame
    int cascade = 0;
    cache::TexelRect rect;
    std::optional<cache::Cause> cause;  ///< none: an active caster
};

/// A cascade as of the last watched frame.
struct LiveCascade {
    int camera = 0;
    double texel = 0, split = 0;  ///< [m]
    cache::Texel window{0};
    bool drawn = false, asleep = false;
    uint64_t unknownTexels = 0, staleTexels = 0, missingTexels = 0;
};

/// A working map, made small: each pixel the depth nearest the sun of the texels that it stands for.
struct LivePicture {
    uint64_t number = 0;  ///< of the frame that it shows
    cache::Texel window{0};
    int side = 0;      ///< [pixels]
    int texels = 0;    ///< that the side stands for
    double near = 0, far = 0;  ///< along the light [m]: what values 1 and 254 stand for
    std::vector<uint8_t> values;  ///< row by row from the window's low corner; 0: unknown, 255: no caster
};

struct LiveChunks {
    double size = 0;       ///< edge of a chunk [m]
    uint32_t away = 0;     ///< of those that are not away, how many are not told of
    std::vector<ChunkPlace> places;
};

/// A line of the configuration.
struct LiveSetting {
    std::string name, value;
};

struct LiveName {
    LiveId id = 0;
    std::string name, world;
    uint64_t frames = 0;  ///< published
};

/// What a watcher has not seen yet.
struct LiveNews {
    LiveName session;
    uint64_t lost = 0;  ///< frames that were published since and are forgotten already
    std::vector<LiveFrame> frames;  ///< ascending
    std::vector<LiveMark> marks;
    std::vector<LiveCascade> cascades;
    std::vector<uint64_t> pictures;  ///< per cascade: number of the frame that its picture shows, 0 for none
    uint64_t chunksNumber = 0;       ///< of the frame that `chunks` shows
    std::shared_ptr<const LiveChunks> chunks;  ///< null before the first
    std::shared_ptr<const std::vector<LiveSetting>> settings;  ///< likewise
    std::vector<std::string> errors;  ///< the last few
    uint64_t errorCount = 0;
    int side = 0;  ///< of the maps [texels]
};

/// Sums over all sessions since the board was made, those that have ended with them.
struct LiveTotals {
    /// Upper bounds of the buckets of frame times [s].
    static constexpr std::array<double, 12> kBuckets{0.0005, 0.001, 0.002, 0.004, 0.008, 0.016,
                                                     0.033,  0.066, 0.125, 0.25,  0.5,   1};
    uint64_t sessionsOpened = 0, sessions = 0, watched = 0;  ///< the last two: right now
    uint64_t frames = 0, framesDrawn = 0, errors = 0;
    std::array<cache::Cost, cache::kCauses> byCause{};
    cache::Cost active;
    std::array<uint64_t, kBuckets.size() + 1> frameTimes{};  ///< frames by bucket, the last without bound
    double frameSeconds = 0;
    uint64_t chunkArrivals = 0, chunkDepartures = 0, bytesRead = 0, bytesUploaded = 0, rays = 0, certificates = 0, edits = 0;
    uint64_t residentBytes = 0, geometryBytes = 0, missingChunks = 0;  ///< of the sessions that there are, right now
};

class LiveBoard;

/// A session's entry on a board, which must outlive it. One thread at a time.
class LiveSession {
public:
    LiveSession(LiveSession&&) noexcept;
    LiveSession& operator=(LiveSession&&) = delete;
    ~LiveSession();

    /// After `advance` of the system, and `finish` where that is called. Never waits for a watcher. While watched, reads
    /// a map back now and then, which waits for the GPU; a map that cannot be read is left out.
    void publish(ShadowSystem& system, const FrameInput& input, const FrameReport& report, double ms);
    LiveId id() const { return id_; }
    /// Somebody asked for it within the last two seconds.
    bool watched() const;

private:
    friend class LiveBoard;
    struct Entry;
    LiveSession(LiveBoard& board, LiveId id, std::shared_ptr<Entry> entry);
    void look(ShadowSystem& system, const FrameReport& report, const glm::dvec3& eye);
    LiveBoard& board_;
    LiveId id_;
    std::shared_ptr<Entry> entry_;  ///< null once moved from
};

/// Any number of threads.
class LiveBoard {
public:
    /// Whether the service takes sessions: what /readyz says. Not before it is first told so.
    void setReady(bool ready);
    bool ready() const;

    /// `name` and `world` are for people, any text.
    LiveSession open(std::string name, std::string world);

    std::vector<LiveName> sessions() const;
    /// What was published after frame number `seen`, and whatever changes without a number. A session counts as
    /// watched for two seconds after it was asked for. Empty for one that does not exist or has ended.
    std::optional<LiveNews> news(LiveId session, uint64_t seen);
    /// Null where there is none.
    std::shared_ptr<const LivePicture> picture(LiveId session, size_t cascade) const;
    LiveTotals totals() const;

private:
    friend class LiveSession;
    std::shared_ptr<LiveSession::Entry> find(LiveId session) const;

    mutable std::mutex mutex_;  ///< held before an entry's own, never after
    std::map<LiveId, std::shared_ptr<LiveSession::Entry>> entries_;
    LiveTotals totals_;  ///< but for what is said of right now
    LiveId next_ = 1;
    bool ready_ = false;
};

/// A map's depths, as readMap gives them, in the order of the window and made small.
///   near, range  z of a stored depth d [m] is near + d * range
LivePicture pictureOf(std::span<const float> depths, int side, cache::Texel window, double near, double range);

}  // namespace server
