#include "server/live_board.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <utility>

#include "cache/frame_plan.h"
#include "server/live_settings.h"
#include "server/stopwatch.h"
#include "world/check.h"

namespace server {
namespace {

using SteadyClock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr milliseconds kWatched{2000};     ///< a session is, for so long after somebody asked
constexpr milliseconds kChunksEvery{400};
constexpr milliseconds kPictureEvery{80};  ///< one cascade's, in turn
constexpr int kPictureShare = 20;          ///< reading pictures back takes at most this part of the time
constexpr size_t kMarksPerFrame = 64;      ///< of one cascade, and as many active casters
constexpr size_t kErrors = 8, kErrorLength = 300;

int64_t ticks(SteadyClock::time_point time) { return time.time_since_epoch().count(); }

/// What `all` grew by.
void addTo(std::array<cache::Cost, cache::kCauses>& all, const std::array<cache::Cost, cache::kCauses>& more) {
    for (size_t c = 0; c < all.size(); ++c) all[c] += more[c];
}

/// The text, cut where it is too long and not within a character of UTF-8.
std::string shortened(const std::string& text) {
    if (text.size() <= kErrorLength) return text;
    size_t end = kErrorLength;
    while (end > 0 && (static_cast<unsigned char>(text[end]) & 0xc0) == 0x80) --end;
    return text.substr(0, end) + " ...";
}

std::shared_ptr<const LiveChunks> chunksAround(const ShadowSystem& system, const glm::dvec3& eye) {
    auto chunks = std::make_shared<LiveChunks>();
    chunks->size = system.chunkSize();
    chunks->places = system.chunks();
    if (chunks->places.size() > kLiveChunks) {
        const auto distance = [&](const ChunkPlace& p) {
            return glm::length((glm::dvec2(p.key.x, p.key.z) + 0.5) * chunks->size - glm::dvec2(eye.x, eye.z));
        };
        std::nth_element(chunks->places.begin(), chunks->places.begin() + kLiveChunks, chunks->places.end(),
                         [&](const ChunkPlace& a, const ChunkPlace& b) {
                             return std::pair(distance(a), a.key) < std::pair(distance(b), b.key);
                         });
        chunks->away = uint32_t(chunks->places.size() - kLiveChunks);
        chunks->places.resize(kLiveChunks);
    }
    return chunks;
}

LiveFrame frameOf(const FrameInput& input, const FrameReport& report, double ms) {
    LiveFrame frame;
    frame.frame = report.frame;
    frame.time = report.time;
    frame.ms = ms;
    frame.gpuMs = report.gpu.wallMs;
    for (const cache::CascadeStatistics& s : report.cascades) {
        addTo(frame.byCause, s.byCause);
        frame.active += s.active;
        frame.unknownTexels += s.unknownTexels;
        frame.staleTexels += s.staleTexels;
    }
    frame.residentBytes = report.residentBytes;
    frame.geometryBytes = report.geometryBytes;
    frame.missingChunks = report.missingChunks;
    frame.coarseChunks = report.coarseChunks;
    frame.eye = input.camera.position;
    const glm::dvec3 ahead = input.camera.orientation * glm::dvec3(0, 0, -1);
    const double length = std::hypot(ahead.x, ahead.z);
    if (length > 1e-6) frame.heading = glm::dvec2(ahead.x, ahead.z) / length;
    return frame;
}

}  // namespace

/// The owner writes, watchers copy, both under the mutex; what only the owner touches comes last.
struct LiveSession::Entry {
    std::atomic<int64_t> askedAt{std::numeric_limits<int64_t>::min()};
    bool watched() const {
        const int64_t asked = askedAt.load(std::memory_order_relaxed);
        return asked >= ticks(SteadyClock::now() - kWatched);
    }

    mutable std::mutex mutex;
    LiveName name;
    std::deque<LiveFrame> frames;
    std::deque<LiveMark> marks;
    std::vector<LiveCascade> cascades;
    std::vector<std::shared_ptr<const LivePicture>> pictures;
    uint64_t chunksNumber = 0;
    std::shared_ptr<const LiveChunks> chunks;
    std::shared_ptr<const std::vector<LiveSetting>> settings;
    std::deque<std::string> errors;
    uint64_t errorCount = 0;
    int side = 0;

    uint64_t published = 0;
    SteadyClock::time_point nextChunks{}, nextPicture{};
    size_t turn = 0;  ///< the cascade whose picture comes next
};

LiveSession::LiveSession(LiveBoard& board, LiveId id, std::shared_ptr<Entry> entry)
    : board_(board), id_(id), entry_(std::move(entry)) {}
LiveSession::LiveSession(LiveSession&&) noexcept = default;

bool LiveSession::watched() const { return entry_->watched(); }

LiveSession::~LiveSession() {
    if (!entry_) return;
    const std::lock_guard lock(board_.mutex_);
    board_.entries_.erase(id_);
}

void LiveSession::publish(ShadowSystem& system, const FrameInput& input, const FrameReport& report, double ms) {
    CHECK(entry_);
    Entry& entry = *entry_;
    LiveFrame frame = frameOf(input, report, ms);
    frame.number = ++entry.published;
    {
        const std::lock_guard lock(entry.mutex);
        entry.frames.push_back(frame);
        if (entry.frames.size() > kLiveFrames) entry.frames.pop_front();
        entry.name.frames = entry.published;
        entry.errorCount += report.errors.size();
        const size_t told = std::min(report.errors.size(), kErrors);
        for (size_t k = report.errors.size() - told; k < report.errors.size(); ++k)
            entry.errors.push_back("frame " + std::to_string(report.frame) + ": " + shortened(report.errors[k].what));
        while (entry.errors.size() > kErrors) entry.errors.pop_front();
    }
    {
        const std::lock_guard lock(board_.mutex_);
        LiveTotals& t = board_.totals_;
        ++t.frames;
        t.framesDrawn += report.submitted;
        t.errors += report.errors.size();
        addTo(t.byCause, frame.byCause);
        t.active += frame.active;
        const auto bucket = std::lower_bound(LiveTotals::kBuckets.begin(), LiveTotals::kBuckets.end(), ms / 1000);
        ++t.frameTimes[size_t(bucket - LiveTotals::kBuckets.begin())];
        t.frameSeconds += ms / 1000;
        t.chunkArrivals += report.chunkArrivals;
        t.chunkDepartures += report.chunkDepartures;
        t.bytesRead += report.bytesRead;
        t.bytesUploaded += report.bytesUploaded;
        t.rays += report.rays;
        t.certificates += report.certificates;
        t.edits += report.edits;
    }
    if (entry.watched()) look(system, report, frame.eye);
}

/// What is made for watchers alone.
void LiveSession::look(ShadowSystem& system, const FrameReport& report, const glm::dvec3& eye) {
    Entry& entry = *entry_;
    const auto now = SteadyClock::now();
    const size_t count = report.cascades.size();
    if (size_t(system.cascades()) != count) return;  // reconfigured since; the next frame tells
    std::vector<LiveMark> marks;
    std::vector<LiveCascade> cascades;
    for (size_t n = 0; n < count; ++n) {
        const cache::CascadeStatistics& s = report.cascades[n];
        const CascadeView view = system.view(int(n));
        cascades.push_back({int(n) / system.config().cascades, view.texel, view.split, view.window, view.drawn, s.asleep,
                            s.unknownTexels, s.staleTexels, s.missingTexels});
        const auto redrawn = system.redrawn(int(n));
        for (size_t k = 0; k < std::min(redrawn.size(), kMarksPerFrame); ++k)
            marks.push_back({entry.published, int(n), redrawn[k].rect, redrawn[k].cause});
        if (s.asleep) continue;
        for (const cache::TexelRect& rect : system.activeRects(int(n), kMarksPerFrame))
            marks.push_back({entry.published, int(n), rect, {}});
    }

    std::shared_ptr<const LiveChunks> chunks;
    std::shared_ptr<const std::vector<LiveSetting>> settings;
    if (now >= entry.nextChunks) {
        entry.nextChunks = now + kChunksEvery;
        chunks = chunksAround(system, eye);
        settings = std::make_shared<std::vector<LiveSetting>>(liveSettings(system.config()));
    }

    std::shared_ptr<const LivePicture> picture;
    const size_t turn = entry.turn % count;
    if (now >= entry.nextPicture) {
        ++entry.turn;
        const CascadeView view = system.view(int(turn));
        if (view.drawn) {
            const auto depths = system.readMap(int(turn), gpu::MapKind::kWorking);
            if (depths) {
                LivePicture made = pictureOf(depths.value(), system.config().side, view.window, view.depthNear, view.depthRange);
                made.number = entry.published;
                picture = std::make_shared<LivePicture>(std::move(made));
            }
        }
        const SteadyClock::duration took = SteadyClock::now() - now;
        entry.nextPicture = now + std::max<SteadyClock::duration>(kPictureEvery, took * kPictureShare);
    }

    const std::lock_guard lock(entry.mutex);
    entry.cascades = std::move(cascades);
    entry.side = system.config().side;
    for (LiveMark& mark : marks) entry.marks.push_back(std::move(mark));
    while (entry.marks.size() > kLiveMarks) entry.marks.pop_front();
    if (chunks) {
        entry.chunks = std::move(chunks);
        entry.chunksNumber = entry.published;
        entry.settings = std::move(settings);
    }
    entry.pictures.resize(count);
    if (picture) entry.pictures[turn] = std::move(picture);
}

void LiveBoard::setReady(bool ready) {
    const std::lock_guard lock(mutex_);
    ready_ = ready;
}

bool LiveBoard::ready() const {
    const std::lock_guard lock(mutex_);
    return ready_;
}

LiveSession LiveBoard::open(std::string name, std::string world) {
    const auto entry = std::make_shared<LiveSession::Entry>();
    const std::lock_guard lock(mutex_);
    const LiveId id = next_++;
    entry->name = {id, std::move(name), std::move(world), 0};
    entries_.emplace(id, entry);
    ++totals_.sessionsOpened;
    return {*this, id, entry};
}

std::shared_ptr<LiveSession::Entry> LiveBoard::find(LiveId session) const {
    const std::lock_guard lock(mutex_);
    const auto found = entries_.find(session);
    return found == entries_.end() ? nullptr : found->second;
}

std::vector<LiveName> LiveBoard::sessions() const {
    std::vector<LiveName> names;
    const std::lock_guard lock(mutex_);
    for (const auto& [id, entry] : entries_) {
        const std::lock_guard own(entry->mutex);
        names.push_back(entry->name);
    }
    return names;
}

std::optional<LiveNews> LiveBoard::news(LiveId session, uint64_t seen) {
    const auto entry = find(session);
    if (!entry) return std::nullopt;
    entry->askedAt.store(ticks(SteadyClock::now()), std::memory_order_relaxed);
    LiveNews news;
    const std::lock_guard lock(entry->mutex);
    news.session = entry->name;
    if (seen > entry->name.frames) seen = 0;  // of another life of the process
    if (!entry->frames.empty() && entry->frames.front().number > seen + 1)
        news.lost = entry->frames.front().number - seen - 1;
    for (const LiveFrame& frame : entry->frames)
        if (frame.number > seen) news.frames.push_back(frame);
    for (const LiveMark& mark : entry->marks)
        if (mark.number > seen) news.marks.push_back(mark);
    news.cascades = entry->cascades;
    for (const auto& picture : entry->pictures) news.pictures.push_back(picture ? picture->number : 0);
    news.chunksNumber = entry->chunksNumber;
    news.chunks = entry->chunks;
    news.settings = entry->settings;
    news.errors.assign(entry->errors.begin(), entry->errors.end());
    news.errorCount = entry->errorCount;
    news.side = entry->side;
    return news;
}

std::shared_ptr<const LivePicture> LiveBoard::picture(LiveId session, size_t cascade) const {
    const auto entry = find(session);
    if (!entry) return nullptr;
    const std::lock_guard lock(entry->mutex);
    return cascade < entry->pictures.size() ? entry->pictures[cascade] : nullptr;
}

LiveTotals LiveBoard::totals() const {
    const std::lock_guard lock(mutex_);
    LiveTotals totals = totals_;
    totals.sessions = entries_.size();
    for (const auto& [id, entry] : entries_) {
        totals.watched += entry->watched();
        const std::lock_guard own(entry->mutex);
        if (entry->frames.empty()) continue;
        totals.residentBytes += entry->frames.back().residentBytes;
        totals.geometryBytes += entry->frames.back().geometryBytes;
        totals.missingChunks += entry->frames.back().missingChunks;
    }
    return totals;
}

LivePicture pictureOf(std::span<const float> depths, int side, cache::Texel window, double near, double range) {
    CHECK(side > 0 && depths.size() == size_t(side) * size_t(side));
    LivePicture picture;
    picture.window = window;
    const int step = (side + kLivePictureSide - 1) / kLivePictureSide;
    picture.side = (side + step - 1) / step;
    picture.texels = side;
    const auto wrapped = [side](int64_t t) { return int(((t % side) + side) % side); };
    // A pixel is unknown where any of its texels is, and empty where all are.
    std::vector<float> nearest(size_t(picture.side) * size_t(picture.side), cache::kEmptyDepth);
    for (int y = 0; y < side; ++y) {
        const float* row = depths.data() + size_t(wrapped(window.y + y)) * size_t(side);
        float* out = nearest.data() + size_t(y / step) * size_t(picture.side);
        int slot = wrapped(window.x);
        for (int x = 0; x < side; ++x) {
            float& pixel = out[x / step];
            pixel = std::min(pixel, row[slot]);
            if (++slot == side) slot = 0;
        }
    }
    float low = cache::kEmptyDepth, high = cache::kUnknownDepth;
    for (const float d : nearest) {
        if (d == cache::kUnknownDepth || d == cache::kEmptyDepth) continue;
        low = std::min(low, d);
        high = std::max(high, d);
    }
    if (low > high) low = high = 0;  // no caster at all
    picture.near = near + double(low) * range;
    picture.far = near + double(high) * range;
    const float scale = high > low ? 253 / (high - low) : 0;
    for (const float d : nearest) {
        const bool caster = d != cache::kUnknownDepth && d != cache::kEmptyDepth;
        picture.values.push_back(caster ? uint8_t(1 + std::lround((d - low) * scale)) : d == cache::kUnknownDepth ? 0 : 255);
    }
    return picture;
}

}  // namespace server
