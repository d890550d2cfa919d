#include "world/streamer.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

#include "world/check.h"

namespace world {
namespace {

/// Edge of the octree's smallest cells [chunks]: smaller ones would take more memory than the records.
constexpr double kCellChunks = 4;
constexpr double kLargestCell = 1e9;  // [m]

/// Reads under way at once, but in lock-step: enough to keep a disk and the decoders busy, few enough
/// that what is suddenly needed does not queue for long.
constexpr size_t kMostReads = 16;
/// A read that fails for reasons of the disk is tried so often, at first after this time [s], which doubles.
constexpr uint8_t kAttempts = 5;
constexpr double kRetrySeconds = 0.125;
/// A resident chunk is given up for one that is nearer than this share of its distance: those that are equally
/// near do not take turns.
constexpr double kStay = 0.8;

/// Index of a chunk's record, or the number of records.
size_t find(std::span<const ChunkRecord> records, ChunkKey key) {
    const auto at = std::lower_bound(records.begin(), records.end(), key,
                                     [](const ChunkRecord& r, ChunkKey k) { return r.key < k; });
    if (at == records.end() || at->key != key) return records.size();
    return static_cast<size_t>(at - records.begin());
}

Error overBudget(const std::string& what, uint64_t needed, uint64_t budget, const char* option) {
    constexpr uint64_t kMiB = 1ull << 20;
    return {ErrorCode::kLimit, what + " need " + std::to_string((needed + kMiB - 1) / kMiB) +
                                   " MiB, the budget is " + std::to_string(budget / kMiB) +
                                   " MiB: raise it (" + option + ")"};
}

}  // namespace

Streamer::Streamer(const WorldStore& store, const StreamerConfig& config)
    : store_(store),
      config_(config),
      reads_(makeReads(config.clock, store, config.disk)),
      geometryLimit_(config.geometryBytes),
      chunks_(store.chunks().size()),
      places_(store.header().bounds, std::min(kCellChunks * store.header().chunkSize, kLargestCell)),
      meshes_(store.meshes().size()) {
    for (uint32_t i = 0; i < chunks_.size(); ++i) {
        if (const Box& bounds = store.chunks()[i].bounds; !bounds.empty()) places_.insert(i, bounds);
        largestChunk_ = std::max(largestChunk_, memoryOf(i, 0));
    }
    for (size_t id = 0; id < meshes_.size(); ++id) {
        for (const LevelRecord& level : store.meshes()[id].levels) {
            meshes_[id].bytes += memoryBytes(level);
            meshes_[id].geometry += world::geometryBytes(level);
        }
    }
}

bool Streamer::resident(ChunkKey key) const {
    const size_t record = find(store_.chunks(), key);
    return record < chunks_.size() && chunks_[record].chunk != nullptr;
}

ChunkPhase Streamer::phaseOf(uint32_t record) const {
    CHECK(record < chunks_.size());
    const ChunkState& c = chunks_[record];
    if (c.chunk) return c.lackingSince >= 0 ? ChunkPhase::kCoarse : ChunkPhase::kResident;
    if (c.failed) return ChunkPhase::kFailed;
    if (c.reading != kAbsent) return ChunkPhase::kLoading;
    return c.goal != kAbsent || c.lackingSince >= 0 ? ChunkPhase::kWanted : ChunkPhase::kAway;
}

const Mesh& Streamer::mesh(uint32_t id) const {
    CHECK(id < meshes_.size() && meshes_[id].mesh);
    return *meshes_[id].mesh;
}

const Box& Streamer::boundsOf(uint32_t record) const {
    const auto moved = rebound_.find(record);
    return moved != rebound_.end() ? moved->second : store_.chunks()[record].bounds;
}

void Streamer::rebound(ChunkKey key, const Box& bounds) {
    const size_t record = find(store_.chunks(), key);
    CHECK(record < chunks_.size() && !bounds.empty());
    const auto i = static_cast<uint32_t>(record);
    if (!boundsOf(i).empty()) places_.remove(i);
    places_.insert(i, bounds);
    rebound_[i] = bounds;
}

uint8_t Streamer::coarsest(uint32_t record) const {
    const size_t levels = store_.chunks()[record].terrain.size();
    return static_cast<uint8_t>(levels == 0 ? 0 : levels - 1);
}

uint64_t Streamer::memoryOf(uint32_t record, uint8_t first) const {
    if (first == kAbsent) return 0;
    const ChunkRecord& r = store_.chunks()[record];
    uint64_t bytes = uint64_t{r.instances} * sizeof(Instance);
    for (size_t k = first; k < r.terrain.size(); ++k) bytes += memoryBytes(r.terrain[k]);
    return bytes;
}

uint64_t Streamer::geometryOf(uint32_t record, uint8_t first) const {
    if (first == kAbsent) return 0;
    const ChunkRecord& r = store_.chunks()[record];
    uint64_t bytes = 0;
    for (size_t k = first; k < r.terrain.size(); ++k) bytes += world::geometryBytes(r.terrain[k]);
    return bytes;
}

void Streamer::want(const Wants& wants, double now) {
    std::vector<uint32_t> near;
    places_.accepted([&](const Box& bounds) { return wants(bounds).has_value(); }, near);
    wanted_.clear();
    for (const uint32_t i : near) {
        const auto want = wants(boundsOf(i));
        if (!want) continue;
        const auto& levels = store_.chunks()[i].terrain;
        uint8_t level = coarsest(i);
        while (level > 0 && levels[level].error > want->error) --level;
        wanted_.push_back({i, *want, level});
    }
    const auto order = [this](const Wanted& w) {
        const double distance = w.want.distance * (chunks_[w.record].chunk ? kStay : 1);
        return std::tuple(w.want.due, distance, w.record);
    };
    std::sort(wanted_.begin(), wanted_.end(),
              [&](const Wanted& a, const Wanted& b) { return order(a) < order(b); });
    fit();
    const std::vector<Lack> before = std::move(lacking_);
    findLacking(now);
    for (const Lack& lack : before) {
        const auto still = std::lower_bound(lacking_.begin(), lacking_.end(), lack.record,
                                            [](const Lack& l, uint32_t record) { return l.record < record; });
        if (still == lacking_.end() || still->record != lack.record) chunks_[lack.record].lackingSince = -1;
    }
    changed_ = true;
}

/// Goals for what is wanted, as far as the budgets go.
void Streamer::fit() {
    for (const uint32_t record : marked_) chunks_[record].goal = kAbsent;
    marked_.clear();
    ++fits_;
    uint64_t memory = 0, geometry = 0;
    const uint64_t mostMemory = memoryLimit() - std::min(memoryLimit() / 2, largestChunk_);
    std::vector<uint32_t> fresh;
    const auto count = [&](uint32_t id) {
        meshes_[id].mark = fits_;
        memory += meshes_[id].bytes;
        geometry += meshes_[id].geometry;
    };
    for (const uint32_t id : pinned_) count(id);
    const auto raise = [&](uint32_t record, uint8_t level) {
        ChunkState& chunk = chunks_[record];
        if (level >= chunk.goal) return true;
        uint64_t moreMemory = memoryOf(record, level) - memoryOf(record, chunk.goal);
        uint64_t moreGeometry = geometryOf(record, level) - geometryOf(record, chunk.goal);
        fresh.clear();
        if (chunk.goal == kAbsent) {
            for (const uint32_t id : store_.chunks()[record].meshes) {
                if (meshes_[id].mark == fits_) continue;
                fresh.push_back(id);
                moreMemory += meshes_[id].bytes;
                moreGeometry += meshes_[id].geometry;
            }
        }
        if (memory + moreMemory > mostMemory || geometry + moreGeometry > geometryLimit_) return false;
        for (const uint32_t id : fresh) meshes_[id].mark = fits_;
        memory += moreMemory;
        geometry += moreGeometry;
        if (chunk.goal == kAbsent) marked_.push_back(record);
        chunk.goal = level;
        return true;
    };
    const auto stays = [](const Wanted& w) { return std::isinf(w.want.due); };
    for (const Wanted& w : wanted_)
        if (!stays(w) && !chunks_[w.record].failed) raise(w.record, coarsest(w.record));
    for (const Wanted& w : wanted_) {
        if (stays(w) || chunks_[w.record].goal == kAbsent) continue;
        for (uint8_t level = w.level; !raise(w.record, level); ++level) {
        }
    }
    // What is there already is kept, while there is room.
    for (const Wanted& w : wanted_) {
        const ChunkState& chunk = chunks_[w.record];
        if (!chunk.failed || chunk.chunk) raise(w.record, std::min(chunk.first, chunk.reading));
    }
}

StreamEvents Streamer::advance(double now) {
    StreamEvents events;
    if (!changed_ && settled()) return events;
    if (std::exchange(changed_, false)) {
        std::vector<uint32_t> leaving;
        for (const uint32_t i : resident_)
            if (chunks_[i].goal == kAbsent) leaving.push_back(i);
        for (const uint32_t i : leaving) drop(i, events);
        leaving.clear();
        uint64_t over = bytes_ - std::min(bytes_, memoryLimit());  // more was set aside: what is too fine comes again
        for (const uint32_t i : resident_) {
            const ChunkState& chunk = chunks_[i];
            if (over == 0) break;
            if (chunk.goal <= chunk.first || chunk.reading != kAbsent) continue;
            over -= std::min(over, memoryOf(i, chunk.first));
            leaving.push_back(i);
        }
        for (const uint32_t i : leaving) drop(i, events);
        for (const uint32_t i : resident_) {
            ChunkState& chunk = chunks_[i];
            if (chunk.goal <= chunk.first || chunk.reading != kAbsent) continue;
            if (bytes_ + memoryOf(i, chunk.goal) > memoryLimit()) {  // after others have shrunk
                changed_ = true;
                break;
            }
            auto coarser = std::make_shared<Chunk>(
                Chunk{chunk.chunk->key, chunk.chunk->instances, {}, static_cast<size_t>(chunk.goal)});
            const auto& levels = chunk.chunk->terrain.levels;
            coarser->terrain.levels.assign(levels.begin() + (chunk.goal - chunk.first), levels.end());
            coarser->terrain.bounds = chunk.chunk->terrain.bounds;
            chunk.reading = chunk.goal;
            bytes_ += memoryOf(i, chunk.goal);
            ready_.push_back({.request = {.mesh = {}, .record = i, .firstLevel = chunk.goal, .base = {}, .bytes = 0},
                              .times = {}, .chunk = std::move(coarser), .mesh = {}, .error = {}});
        }
    }
    const bool waits = config_.clock == Clock::kLockStep;
    uint64_t handed = 0;
    std::vector<FinishedRead> finished;
    do {
        askAll(now);
        finished.clear();
        reads_->collect(now, finished);
        for (FinishedRead& done : finished) {
            const ReadRequest& r = done.request;
            events.reads.push_back({r.mesh, r.mesh ? ChunkKey{} : store_.chunks()[r.record].key, r.bytes, done.times});
            take(std::move(done), now, events);
        }
        for (auto at = ready_.begin(); at != ready_.end();) {
            const ChunkState& chunk = chunks_[at->request.record];
            const uint64_t held = memoryOf(at->request.record, chunk.first);
            uint64_t more = std::max(memoryOf(at->request.record, chunk.reading), held) - held;
            if (chunk.first == kAbsent) more += kPlacingBytes * store_.chunks()[at->request.record].instances;
            if (!waits && handed > 0 && handed + more > config_.handOutBytes) break;
            if (!handOver(*at, now, events)) {
                ++at;
                continue;
            }
            handed += more;
            at = ready_.erase(at);
        }
    } while (waits && !finished.empty());
    sweepMeshes(events);
    findLacking(now);
    peak_ = std::max(peak_, bytes_);
    std::sort(events.meshArrivals.begin(), events.meshArrivals.end());
    std::sort(events.arrivals.begin(), events.arrivals.end(),
              [](const auto& a, const auto& b) { return a->key < b->key; });
    return events;
}

void Streamer::drop(uint32_t record, StreamEvents& events) {
    ChunkState& chunk = chunks_[record];
    events.departures.push_back(store_.chunks()[record].key);
    bytes_ -= memoryOf(record, chunk.first);
    geometry_ -= geometryOf(record, chunk.first);
    chunk.chunk.reset();
    chunk.first = kAbsent;
    if (chunk.reading == kAbsent) release(record);
    resident_.erase(std::lower_bound(resident_.begin(), resident_.end(), record));
    geometryLimit_ = config_.geometryBytes;
}

/// The chunk uses its meshes no more.
void Streamer::release(uint32_t record) {
    for (const uint32_t id : store_.chunks()[record].meshes) --meshes_[id].users;
}

/// What maps need now comes first, coarsely, then finely; then what they will need.
void Streamer::askAll(double now) {
    unread_ = false;
    const bool staged = config_.clock != Clock::kLockStep;
    for (const bool refine : {false, true}) {
        for (const Wanted& w : wanted_) {
            if (w.want.due > 0) break;
            if (!ask(w, staged && !refine, now)) return;
        }
    }
    for (const Wanted& w : wanted_)
        if (w.want.due > 0 && !ask(w, staged && chunks_[w.record].first == kAbsent, now)) return;
}

/// False if nothing more can be asked for in this step.
bool Streamer::ask(const Wanted& wanted, bool coarse, double now) {
    const uint32_t record = wanted.record;
    ChunkState& chunk = chunks_[record];
    if (chunk.failed || chunk.goal >= std::min(chunk.first, chunk.reading)) return true;
    unread_ = true;
    if (chunk.reading != kAbsent || now < chunk.retryAt || (coarse && chunk.first != kAbsent)) return true;
    if (config_.clock != Clock::kLockStep && reads_->underWay() >= kMostReads) return false;
    const uint8_t level = coarse ? std::max(chunk.goal, coarsest(record)) : chunk.goal;
    uint64_t need = memoryOf(record, level);
    if (chunk.first == kAbsent)
        for (const uint32_t id : store_.chunks()[record].meshes)
            if (const MeshState& m = meshes_[id]; !m.mesh && !m.reading) need += m.bytes;
    if (bytes_ + need > memoryLimit()) return false;
    bytes_ += need;
    peak_ = std::max(peak_, bytes_);
    chunk.reading = level;
    if (chunk.first == kAbsent) {
        for (const uint32_t id : store_.chunks()[record].meshes) {
            MeshState& m = meshes_[id];
            ++m.users;
            if (m.mesh || m.reading) continue;
            m.reading = true;
            reads_->ask({.mesh = id, .record = 0, .firstLevel = 0, .base = {}, .bytes = m.bytes}, now);
        }
    }
    reads_->ask({.mesh = {}, .record = record, .firstLevel = level, .base = chunk.chunk,
                 .bytes = memoryOf(record, level) - memoryOf(record, chunk.first)},
                now);
    return true;
}

void Streamer::take(FinishedRead done, double now, StreamEvents& events) {
    const ReadRequest& request = done.request;
    if (request.mesh) {
        MeshState& m = meshes_[*request.mesh];
        if (done.error && done.error->code == ErrorCode::kIo && config_.clock != Clock::kLockStep &&
            ++m.attempts < kAttempts) {
            reads_->ask(std::move(done.request), now);
            return;
        }
        m.reading = false;
        if (m.mesh) return;  // pinned meanwhile
        if (done.error) {
            m.failure = done.error;
            bytes_ -= m.bytes;
            return;
        }
        m.mesh = std::move(done.mesh);
        events.bytesRead += m.bytes;
        if (std::exchange(m.everRead, true)) events.bytesAgain += m.bytes;
        return;
    }
    ChunkState& chunk = chunks_[request.record];
    if (done.error) {
        fail(request.record, *done.error, now, events);
        return;
    }
    events.bytesRead += request.bytes;
    if (chunk.everRead != kAbsent) {
        const auto base = request.base ? static_cast<uint8_t>(request.base->firstLevel) : kAbsent;
        const uint8_t known = std::max(chunk.everRead, static_cast<uint8_t>(request.firstLevel));
        if (known < base) events.bytesAgain += memoryOf(request.record, known) - memoryOf(request.record, base);
    }
    chunk.everRead = std::min(chunk.everRead, static_cast<uint8_t>(request.firstLevel));
    ready_.push_back(std::move(done));
}

/// The chunk's read came to nothing. What is there of it stays.
void Streamer::fail(uint32_t record, const Error& error, double now, StreamEvents& events) {
    ChunkState& chunk = chunks_[record];
    bytes_ -= memoryOf(record, chunk.reading);
    chunk.reading = kAbsent;
    if (chunk.first == kAbsent) release(record);
    if (error.code == ErrorCode::kIo && config_.clock != Clock::kLockStep && ++chunk.attempts < kAttempts) {
        chunk.retryAt = now + kRetrySeconds * double(1 << chunk.attempts);
        unread_ = true;
        return;
    }
    chunk.failed = true;
    const char* what = chunk.first == kAbsent ? " is left out: " : " stays coarse: ";
    events.errors.push_back({error.code, "chunk " + toString(store_.chunks()[record].key) + what + error.what, error.native});
}

/// False while the chunk must wait for a mesh, or for room on the GPU.
bool Streamer::handOver(FinishedRead& ready, double now, StreamEvents& events) {
    const uint32_t record = ready.request.record;
    ChunkState& chunk = chunks_[record];
    const std::vector<uint32_t>& ids = store_.chunks()[record].meshes;
    uint64_t geometry = geometry_ - geometryOf(record, chunk.first) + geometryOf(record, chunk.reading);
    if (chunk.first == kAbsent)
        for (const uint32_t id : ids) geometry += meshes_[id].announced ? 0 : meshes_[id].geometry;
    const bool fits = geometry <= config_.geometryBytes;
    if (chunk.goal == kAbsent || (!fits && chunk.reading < chunk.goal)) {  // not wanted any more, or not so finely
        bytes_ -= memoryOf(record, chunk.reading);
        chunk.reading = kAbsent;
        if (chunk.first == kAbsent) release(record);
        return true;
    }
    if (!fits) return false;
    if (chunk.first == kAbsent) {
        for (const uint32_t id : ids) {
            if (meshes_[id].reading) return false;
            if (meshes_[id].mesh) continue;
            fail(record, *meshes_[id].failure, now, events);
            chunk.failed = true;
            return true;
        }
        for (const uint32_t id : ids) {
            MeshState& m = meshes_[id];
            if (std::exchange(m.announced, true)) continue;
            geometry_ += m.geometry;
            events.meshArrivals.push_back(id);
        }
        resident_.insert(std::lower_bound(resident_.begin(), resident_.end(), record), record);
    }
    bytes_ -= memoryOf(record, chunk.first);
    geometry_ += geometryOf(record, chunk.reading) - geometryOf(record, chunk.first);
    chunk.first = std::exchange(chunk.reading, kAbsent);
    chunk.chunk = std::move(ready.chunk);
    chunk.attempts = 0;
    events.arrivals.push_back(chunk.chunk);
    return true;
}

void Streamer::refuse(ChunkKey key, std::shared_ptr<const Chunk> held, double now) {
    const auto record = static_cast<uint32_t>(find(store_.chunks(), key));
    ChunkState& chunk = chunks_[record];
    const uint8_t before = held ? static_cast<uint8_t>(held->firstLevel) : kAbsent;
    bytes_ = bytes_ - memoryOf(record, chunk.first) + memoryOf(record, before);
    geometry_ = geometry_ - geometryOf(record, chunk.first) + geometryOf(record, before);
    chunk.chunk = std::move(held);
    chunk.first = chunk.goal = before;
    if (before == kAbsent) {
        release(record);
        resident_.erase(std::lower_bound(resident_.begin(), resident_.end(), record));
    }
    geometryLimit_ = geometry_;
    for (const uint32_t id : store_.chunks()[record].meshes)
        if (meshes_[id].users == 0 && meshes_[id].announced) geometryLimit_ -= meshes_[id].geometry;
    changed_ = true;
    findLacking(now);
}

/// Meshes that nothing uses leave.
void Streamer::sweepMeshes(StreamEvents& events) {
    for (uint32_t id = 0; id < meshes_.size(); ++id) {
        MeshState& m = meshes_[id];
        if (m.users > 0 || !m.mesh) continue;
        m.mesh.reset();
        bytes_ -= m.bytes;
        if (!std::exchange(m.announced, false)) continue;
        geometry_ -= m.geometry;
        events.meshDepartures.push_back(id);
    }
}

void Streamer::findLacking(double now) {
    lacking_.clear();
    for (const Wanted& w : wanted_) {
        if (w.want.due > 0) break;
        ChunkState& chunk = chunks_[w.record];
        if (chunk.first <= w.level) {
            chunk.lackingSince = -1;
            continue;
        }
        if (chunk.lackingSince < 0) chunk.lackingSince = now;
        const bool absent = chunk.first == kAbsent;
        lacking_.push_back({w.record, absent, absent ? 0 : store_.chunks()[w.record].terrain[chunk.first].error,
                            chunk.lackingSince});
    }
    std::sort(lacking_.begin(), lacking_.end(), [](const Lack& a, const Lack& b) { return a.record < b.record; });
}

Result<Done> Streamer::pin(uint32_t id) {
    if (id >= meshes_.size())
        return Error{ErrorCode::kNotFound,
                     store_.path() + ": mesh " + std::to_string(id) + ": there is no such mesh"};
    MeshState& m = meshes_[id];
    if (m.failure) return *m.failure;
    if (!m.announced && geometry_ + m.geometry > config_.geometryBytes)
        return overBudget("the resident levels and mesh " + std::to_string(id), geometry_ + m.geometry,
                          config_.geometryBytes, "--gpu-budget");
    if (!m.mesh) {
        if (bytes_ + m.bytes > memoryLimit())
            return overBudget("the resident chunks and mesh " + std::to_string(id), residentBytes() + m.bytes,
                              config_.memoryBytes, "--memory-budget");
        Result<Mesh> mesh = store_.readMesh(id);
        if (!mesh) {
            m.failure = mesh.error();
            return mesh.error();
        }
        m.mesh = std::make_unique<const Mesh>(std::move(mesh.value()));
        if (!m.reading) bytes_ += m.bytes;
    }
    if (!std::exchange(m.announced, true)) geometry_ += m.geometry;
    if (!std::exchange(m.pinned, true)) {
        ++m.users;
        pinned_.push_back(id);
    }
    return Done{};
}

}  // namespace world
