#include "world/streamer.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <map>

#include "world/check.h"

namespace world {
namespace {

/// Edge of the octree's smallest cells [chunks]: smaller ones would take more memory than the records.
constexpr double kCellChunks = 4;
constexpr double kLargestCell = 1e9;  // [m]

/// Index of a chunk's record, or the number of records.
size_t find(std::span<const ChunkRecord> records, ChunkKey key) {
    const auto at = std::lower_bound(records.begin(), records.end(), key,
                                     [](const ChunkRecord& r, ChunkKey k) { return r.key < k; });
    if (at == records.end() || at->key != key) return records.size();
    return static_cast<size_t>(at - records.begin());
}

Error overBudget(const std::string& what, uint64_t needed, uint64_t budget) {
    constexpr uint64_t kMiB = 1ull << 20;
    return {ErrorCode::kLimit, what + " need " + std::to_string((needed + kMiB - 1) / kMiB) +
                                   " MiB of memory, the budget is " + std::to_string(budget / kMiB) +
                                   " MiB: raise it (--memory-budget)"};
}

}  // namespace

Streamer::Streamer(const WorldStore& store, uint64_t budgetBytes)
    : store_(store),
      budget_(budgetBytes),
      chunks_(store.chunks().size()),
      places_(store.header().bounds, std::min(kCellChunks * store.header().chunkSize, kLargestCell)),
      meshes_(store.meshes().size()) {
    for (uint32_t i = 0; i < chunks_.size(); ++i)
        if (const Box& bounds = store.chunks()[i].bounds; !bounds.empty()) places_.insert(i, bounds);
    const Result<std::vector<BlobInfo>> rows = store.listBlobs();
    if (!rows) {
        unlisted_ = rows.error();
        return;
    }
    for (const BlobInfo& row : rows.value()) {
        const BlobKey& key = row.key;
        // A row that claims more is refused when it is read; here its claim must not overflow a sum.
        const uint64_t bytes = std::min(row.rawBytes, uint64_t{1} << 32);
        if (key.kind == BlobKind::kMesh && key.x >= 0 && static_cast<size_t>(key.x) < meshes_.size())
            meshes_[static_cast<size_t>(key.x)].bytes += bytes;
        if (key.kind != BlobKind::kInstances && key.kind != BlobKind::kTerrainMesh) continue;
        const size_t record = find(store.chunks(), {key.x, key.y, key.z});
        if (record < chunks_.size()) chunks_[record].bytes += bytes;
    }
}

bool Streamer::resident(ChunkKey key) const {
    const size_t record = find(store_.chunks(), key);
    return record < chunks_.size() && chunks_[record].chunk != nullptr;
}

const Mesh& Streamer::mesh(uint32_t id) const {
    CHECK(id < meshes_.size() && meshes_[id].mesh);
    return *meshes_[id].mesh;
}

Result<StreamEvents> Streamer::advance(const std::function<bool(const Box&)>& want,
                                       const std::function<bool(const Box&)>& keep) {
    if (unlisted_) return *unlisted_;
    const std::span<const ChunkRecord> records = store_.chunks();
    std::vector<uint32_t> in, out;
    places_.accepted([&](const Box& bounds) { return want(bounds); }, in);
    std::erase_if(in, [this](uint32_t i) { return chunks_[i].chunk || chunks_[i].failed; });
    for (const uint32_t i : resident_)
        if (!keep(records[i].bounds)) out.push_back(i);
    StreamEvents events;
    if (in.empty() && out.empty()) return events;

    Step step = plan(std::move(in), std::move(out));
    if (!step.in.empty() && step.bytesAfter > budget_) {
        std::vector<uint32_t> unwanted;
        for (const uint32_t i : resident_)
            if (!want(records[i].bounds)) unwanted.push_back(i);
        step = plan(std::move(step.in), std::move(unwanted));
        if (step.bytesAfter > budget_) return overBudget("the chunks wanted here", step.bytesAfter, budget_);
    }
    drop(step, events);
    read(step, events);
    return events;
}

Streamer::Step Streamer::plan(std::vector<uint32_t> in, std::vector<uint32_t> out) const {
    const std::span<const ChunkRecord> records = store_.chunks();
    Step step;
    step.bytesAfter = bytes_;
    std::map<uint32_t, int64_t> users;  // how many more each mesh gets
    for (const uint32_t i : in) {
        step.bytesAfter += chunks_[i].bytes;
        for (const uint32_t id : records[i].meshes) ++users[id];
    }
    for (const uint32_t i : out) {
        step.bytesAfter -= chunks_[i].bytes;
        for (const uint32_t id : records[i].meshes) --users[id];
    }
    for (const auto& [id, more] : users) {
        const MeshState& m = meshes_[id];
        const bool used = m.users + more > 0;
        if (used && !m.mesh && !m.failure) {
            step.meshesIn.push_back(id);
            step.bytesAfter += m.bytes;
        }
        if (!used && m.mesh) {
            step.meshesOut.push_back(id);
            step.bytesAfter -= m.bytes;
        }
    }
    step.in = std::move(in);
    step.out = std::move(out);
    return step;
}

void Streamer::drop(const Step& step, StreamEvents& events) {
    for (const uint32_t i : step.out) {
        const ChunkRecord& record = store_.chunks()[i];
        events.departures.push_back(record.key);
        for (const uint32_t id : record.meshes) --meshes_[id].users;
        chunks_[i].chunk.reset();
        bytes_ -= chunks_[i].bytes;
    }
    std::erase_if(resident_, [this](uint32_t i) { return !chunks_[i].chunk; });
    // Meshes that only arrivals will use stay, without a user for now.
    for (const uint32_t id : step.meshesOut) {
        meshes_[id].mesh.reset();
        bytes_ -= meshes_[id].bytes;
    }
    events.meshDepartures = step.meshesOut;
}

void Streamer::read(const Step& step, StreamEvents& events) {
    const std::span<const ChunkRecord> records = store_.chunks();
    std::vector<std::optional<Result<Mesh>>> meshes(step.meshesIn.size());
    std::vector<std::optional<Result<Chunk>>> chunks(step.in.size());
    tbb::parallel_for(size_t{0}, meshes.size() + chunks.size(), [&](size_t i) {
        if (i < meshes.size()) {
            meshes[i].emplace(store_.readMesh(step.meshesIn[i]));
            return;
        }
        chunks[i - meshes.size()].emplace(store_.readChunk(records[step.in[i - meshes.size()]].key));
    });

    for (size_t i = 0; i < meshes.size(); ++i) {
        MeshState& m = meshes_[step.meshesIn[i]];
        if (!*meshes[i]) {
            m.failure = meshes[i]->error();
            continue;
        }
        m.mesh = std::make_unique<const Mesh>(std::move(meshes[i]->value()));
        bytes_ += m.bytes;
    }
    const auto stayed = static_cast<std::ptrdiff_t>(resident_.size());
    bool allArrived = true;
    for (size_t i = 0; i < chunks.size(); ++i)
        allArrived &= arrive(step.in[i], std::move(*chunks[i]), events);
    std::inplace_merge(resident_.begin(), resident_.begin() + stayed, resident_.end());

    for (const uint32_t id : step.meshesIn) {
        if (meshes_[id].users == 0 || !meshes_[id].mesh) continue;
        events.meshArrivals.push_back(id);
        events.bytesRead += meshes_[id].bytes;
    }
    if (allArrived) return;
    // Of chunks that did not arrive: new meshes were never announced, older ones have to depart.
    for (const uint32_t i : step.in) {
        for (const uint32_t id : records[i].meshes) {
            MeshState& m = meshes_[id];
            if (m.users > 0 || !m.mesh) continue;
            m.mesh.reset();
            bytes_ -= m.bytes;
            if (!std::binary_search(step.meshesIn.begin(), step.meshesIn.end(), id))
                events.meshDepartures.push_back(id);
        }
    }
    std::sort(events.meshDepartures.begin(), events.meshDepartures.end());
}

/// False, with an error, for a chunk that lacks a part.
bool Streamer::arrive(uint32_t record, Result<Chunk> chunk, StreamEvents& events) {
    const std::vector<uint32_t>& ids = store_.chunks()[record].meshes;
    const auto lacking =
        std::find_if(ids.begin(), ids.end(), [this](uint32_t id) { return !meshes_[id].mesh; });
    if (!chunk || lacking != ids.end()) {
        Error error = chunk ? *meshes_[*lacking].failure : chunk.error();
        error.what = "chunk " + toString(store_.chunks()[record].key) + " is left out: " + error.what;
        events.errors.push_back(std::move(error));
        chunks_[record].failed = true;
        return false;
    }
    for (const uint32_t id : ids) ++meshes_[id].users;
    chunks_[record].chunk = std::make_shared<const Chunk>(std::move(chunk.value()));
    bytes_ += chunks_[record].bytes;
    resident_.push_back(record);
    events.bytesRead += chunks_[record].bytes;
    events.arrivals.push_back(chunks_[record].chunk);
    return true;
}

Result<Done> Streamer::pin(uint32_t id) {
    if (unlisted_) return *unlisted_;
    if (id >= meshes_.size())
        return Error{ErrorCode::kNotFound,
                     store_.path() + ": mesh " + std::to_string(id) + ": there is no such mesh"};
    MeshState& m = meshes_[id];
    if (m.failure) return *m.failure;
    if (!m.mesh) {
        if (bytes_ + m.bytes > budget_)
            return overBudget("the resident chunks and mesh " + std::to_string(id), bytes_ + m.bytes,
                              budget_);
        Result<Mesh> mesh = store_.readMesh(id);
        if (!mesh) {
            m.failure = mesh.error();
            return mesh.error();
        }
        m.mesh = std::make_unique<const Mesh>(std::move(mesh.value()));
        bytes_ += m.bytes;
    }
    ++m.users;
    return Done{};
}

}  // namespace world
