// world/streamer.h — which chunks and meshes are in memory.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "world/chunk.h"
#include "world/octree.h"
#include "world/result.h"
#include "world/store.h"

namespace world {

/// What changed in one step. Lists ascend by key or id; a mesh arrives before or with the first
/// chunk that uses it and departs with or after the last.
struct StreamEvents {
    std::vector<std::shared_ptr<const Chunk>> arrivals;
    std::vector<ChunkKey> departures;
    std::vector<uint32_t> meshArrivals, meshDepartures;
    std::vector<Error> errors;  ///< one per chunk or mesh that could not be read; the rest goes on
    uint64_t bytesRead = 0;     ///< decoded bytes of what arrived
};

/// Keeps wanted chunks resident, in lock-step: `advance` returns when all that is wanted is there.
/// A chunk that failed to read is not tried again. One thread at a time; reads run on all of TBB's.
/// Sizes are those of the rows before compression, known before anything is read and equal to the
/// decoded ones but for a few bytes a list.
class Streamer {
public:
    /// `store` must outlive the streamer. `budgetBytes` bounds the decoded chunks and meshes.
    Streamer(const WorldStore& store, uint64_t budgetBytes);

    /// Reads every chunk whose bounds `want`, drops every resident one whose bounds `keep` refuses. What `want`
    /// accepts of a box it must accept of every box around it: so only chunks near what is wanted are asked
    /// about, and those that are resident. A chunk without bounds casts nothing and is never wanted.
    /// `keep` must accept what `want` accepts; the room between them is the hysteresis, which is given
    /// up where the budget needs the room: then all that is not wanted departs.
    /// kLimit, before anything is read or dropped, if the wanted chunks do not fit the budget: it names
    /// both sizes and the option to raise.
    Result<StreamEvents> advance(const std::function<bool(const Box&)>& want,
                                 const std::function<bool(const Box&)>& keep);

    /// Keeps a mesh resident whatever chunks come and go. Reads it now if needed (then it is
    /// in no later meshArrivals). kLimit if it does not fit the budget; errors of the store pass through.
    Result<Done> pin(uint32_t mesh);

    bool resident(ChunkKey key) const;
    size_t residentChunks() const { return resident_.size(); }
    uint64_t residentBytes() const { return bytes_; }
    /// A resident mesh; CHECKs that it is.
    const Mesh& mesh(uint32_t id) const;

private:
    /// One per chunk record, same order.
    struct ChunkState {
        std::shared_ptr<const Chunk> chunk;  ///< null unless resident
        uint64_t bytes = 0;
        bool failed = false;
    };
    struct MeshState {
        std::unique_ptr<const Mesh> mesh;  ///< null unless resident
        std::optional<Error> failure;
        uint32_t users = 0;  ///< resident chunks and pins
        uint64_t bytes = 0;
    };
    /// A step, decided before anything is read. Indices of records, ids of meshes; all ascend.
    struct Step {
        std::vector<uint32_t> in, out;
        std::vector<uint32_t> meshesIn, meshesOut;
        uint64_t bytesAfter = 0;
    };
    Step plan(std::vector<uint32_t> in, std::vector<uint32_t> out) const;
    void drop(const Step& step, StreamEvents& events);
    void read(const Step& step, StreamEvents& events);
    bool arrive(uint32_t record, Result<Chunk> chunk, StreamEvents& events);

    const WorldStore& store_;
    uint64_t budget_ = 0;
    uint64_t bytes_ = 0;
    std::optional<Error> unlisted_;  ///< the rows' sizes could not be read: nothing can be
    std::vector<ChunkState> chunks_;
    Octree places_;  ///< bounds of the records, by index
    std::vector<uint32_t> resident_;  ///< indices of records, ascending
    std::vector<MeshState> meshes_;  ///< index = mesh id
};

}  // namespace world
