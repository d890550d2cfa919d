// world/streamer.h — which chunks and meshes are in memory, how finely, and what is read next.
// Source: Ulrich, "Rendering Massive Terrains using Chunked Level of Detail Control", 2002 (coarse
// levels first, refined later); the rest is our own.
#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "world/chunk.h"
#include "world/octree.h"
#include "world/reads.h"
#include "world/result.h"
#include "world/store.h"

namespace world {

/// What is wanted of a chunk.
struct Want {
    double due = 0;       ///< [s] until a map needs it; 0: now; infinite: it may stay, and need not come
    double distance = 0;  ///< [m]; of those that are due at the same time the nearest comes first
    float error = 0;      ///< [m], of terrain: coarser levels than this are approximations
};

/// Says it of a chunk's bounds. What it wants of a box it must want of every box around it, at some time.
using Wants = std::function<std::optional<Want>(const Box&)>;

/// Of a mesh level: decoded, and as the GPU holds it.
constexpr uint64_t memoryBytes(const LevelRecord& l) {
    return uint64_t{l.vertices} * sizeof(glm::vec3) + uint64_t{l.triangles} * 12 + uint64_t{l.clusters} * sizeof(Cluster);
}
constexpr uint64_t geometryBytes(const LevelRecord& l) {
    return (uint64_t{l.vertices} + l.triangles) * sizeof(glm::vec3);
}

/// What placing an instance costs whoever takes it up, in bytes of terrain: chunks that come coarsely have few of those
/// and all of their instances.
constexpr uint64_t kPlacingBytes = 2048;

struct StreamerConfig {
    uint64_t memoryBytes = 4ull << 30;      ///< decoded chunks and meshes, with those being read
    uint64_t geometryBytes = 512ull << 20;  ///< what their levels take on the GPU
    uint64_t handOutBytes = 1ull << 20;     ///< decoded, of the chunks of one step, with kPlacingBytes for each instance
                                            ///< that comes; one chunk may exceed it. Lock-step hands out all
    Clock clock = Clock::kLockStep;
    DiskModel disk{};
};

/// One read that ended.
struct ReadSpan {
    std::optional<uint32_t> mesh;  ///< id; else it was a chunk
    ChunkKey chunk{};
    uint64_t bytes = 0;  ///< decoded
    ReadTimes times;
};

/// What changed in one step, to be taken up in this order. Lists ascend by key or id; a mesh arrives before or
/// with the first chunk that uses it and departs with or after the last.
struct StreamEvents {
    std::vector<ChunkKey> departures;
    std::vector<uint32_t> meshDepartures, meshArrivals;
    /// New ones, and resident ones that come again with other levels of their terrain.
    std::vector<std::shared_ptr<const Chunk>> arrivals;
    std::vector<Error> errors;  ///< one per chunk or mesh that cannot be read; the rest goes on
    std::vector<ReadSpan> reads;  ///< that ended, as they were asked for; with the live clock as they ended
    uint64_t bytesRead = 0;     ///< decoded
    uint64_t bytesAgain = 0;    ///< of these, had been read before
};

/// A chunk that a map needs now and lacks.
struct Lack {
    uint32_t record = 0;    ///< in WorldStore::chunks
    bool absent = false;    ///< else it is there, and too coarse
    float error = 0;        ///< [m], of the finest level that is there
    double since = 0;       ///< [s]
};

/// Where a chunk stands.
enum class ChunkPhase : uint8_t {
    kAway,      ///< not in memory, and nothing asks for it
    kWanted,    ///< should be read, or a map needs it and there is no room
    kLoading,   ///< being read
    kCoarse,    ///< in memory, more coarsely than a map needs
    kResident,  ///< in memory
    kFailed,    ///< cannot be read
};

/// Keeps what is wanted resident as far as memory goes: nearest first, and coarse levels of all before fine ones
/// of any. What is not wanted any more stays while there is room. One thread at a time.
///
/// Sizes are those that the directory names: known before anything is read, and tested when it is.
/// In lock-step a step ends when all that is wanted and fits is there. Otherwise chunks come when they have been
/// read: first in the coarsest level of their terrain, then as finely as they are wanted.
class Streamer {
public:
    /// `store` must outlive the streamer.
    Streamer(const WorldStore& store, const StreamerConfig& config);

    /// Decides what should be resident; the next steps make it so. In steps between it need not be said again.
    void want(const Wants& wants, double now);
    /// One step. Cheap while nothing is under way and nothing was wanted anew.
    StreamEvents advance(double now);
    /// The chunk of the last step's arrivals does not fit the GPU: it stays as it was before (`held`, null if it
    /// was not there), and nothing more is handed out until something has left.
    void refuse(ChunkKey key, std::shared_ptr<const Chunk> held, double now);

    /// So much of the memory is taken by somebody else from now on. To be followed by `want`.
    void setAside(uint64_t bytes) { aside_ = bytes; }

    /// Keeps a mesh resident whatever chunks come and go. Reads it now if needed (then it is
    /// in no later meshArrivals). kLimit if it does not fit the budget; errors of the store pass through.
    Result<Done> pin(uint32_t mesh);

    /// A chunk of the store casts within these bounds from now on [m], not those of its record.
    void rebound(ChunkKey key, const Box& bounds);
    /// Of a record's chunk [m].
    const Box& boundsOf(uint32_t record) const;

    bool resident(ChunkKey key) const;
    ChunkPhase phaseOf(uint32_t record) const;
    size_t residentChunks() const { return resident_.size(); }
    uint64_t residentBytes() const { return bytes_ + aside_; }  ///< decoded, with what is being read and set aside
    uint64_t geometryBytes() const { return geometry_; }  ///< of what is resident
    uint64_t peakBytes() const { return peak_; }
    /// A resident mesh; CHECKs that it is.
    const Mesh& mesh(uint32_t id) const;
    /// What maps need now and lack, by record. Chunks that cannot be read are among them for ever.
    std::span<const Lack> lacking() const { return lacking_; }
    /// Nothing is being read and nothing waits to be.
    bool settled() const { return reads_->underWay() == 0 && ready_.empty() && !unread_; }

private:
    static constexpr uint8_t kAbsent = 255;
    /// One per chunk record, same order. Levels are the directory's; those from one on are meant.
    struct ChunkState {
        std::shared_ptr<const Chunk> chunk;  ///< null unless resident
        uint8_t first = kAbsent;    ///< resident
        uint8_t reading = kAbsent;  ///< being read, or ready
        uint8_t goal = kAbsent;     ///< should be resident
        uint8_t everRead = kAbsent;
        uint8_t attempts = 0;
        bool failed = false;
        double retryAt = 0;       ///< [s]
        double lackingSince = -1; ///< [s]; below 0: it lacks nothing
    };
    struct MeshState {
        std::unique_ptr<const Mesh> mesh;  ///< null unless read
        std::optional<Error> failure;
        uint32_t users = 0;    ///< chunks resident or being read, and its pin
        uint32_t mark = 0;     ///< of the last fit that counted it
        uint8_t attempts = 0;
        bool reading = false, announced = false, everRead = false, pinned = false;
        uint64_t bytes = 0, geometry = 0;
    };
    struct Wanted {
        uint32_t record = 0;
        Want want;
        uint8_t level = 0;  ///< the coarsest that is fine enough
    };
    uint64_t memoryLimit() const { return config_.memoryBytes - std::min(config_.memoryBytes, aside_); }
    uint8_t coarsest(uint32_t record) const;
    /// Of a chunk with the levels from `first` on; none for kAbsent. Without its meshes.
    uint64_t memoryOf(uint32_t record, uint8_t first) const;
    uint64_t geometryOf(uint32_t record, uint8_t first) const;
    void fit();
    void drop(uint32_t record, StreamEvents& events);
    void release(uint32_t record);
    void askAll(double now);
    bool ask(const Wanted& wanted, bool coarse, double now);
    void take(FinishedRead done, double now, StreamEvents& events);
    void fail(uint32_t record, const Error& error, double now, StreamEvents& events);
    bool handOver(FinishedRead& ready, double now, StreamEvents& events);
    void sweepMeshes(StreamEvents& events);
    void findLacking(double now);

    const WorldStore& store_;
    StreamerConfig config_;
    std::unique_ptr<Reads> reads_;
    uint64_t bytes_ = 0, peak_ = 0, geometry_ = 0;
    uint64_t aside_ = 0;
    uint64_t geometryLimit_;  ///< less than the budget after a refusal
    uint64_t largestChunk_ = 0;  ///< [bytes]: room in which one can be exchanged for a finer one
    uint32_t fits_ = 0;
    std::vector<ChunkState> chunks_;
    std::map<uint32_t, Box> rebound_;  ///< by index of the record
    Octree places_;  ///< bounds of the chunks, by index of the record
    std::vector<uint32_t> resident_;  ///< indices of records, ascending
    std::vector<MeshState> meshes_;  ///< index = mesh id
    std::vector<uint32_t> pinned_;
    std::vector<Wanted> wanted_;     ///< in the order in which they should come
    std::vector<uint32_t> marked_;   ///< records with a goal
    std::vector<FinishedRead> ready_;  ///< read and not handed out, chunks alone
    std::vector<Lack> lacking_;
    bool unread_ = false;  ///< something that has a goal waits to be read
    bool changed_ = false; ///< since goals were last acted upon
};

}  // namespace world
