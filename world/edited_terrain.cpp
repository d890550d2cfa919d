#include "world/edited_terrain.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <optional>
#include <string>

#include "world/level_set.h"
#include "world/mesh_changes.h"
#include "world/streamer.h"

namespace world {
namespace {

using EditedPointer = std::shared_ptr<const EditedChunk>;

Error bad(const WorldStore& store, ChunkKey key, const std::string& what) {
    return {ErrorCode::kBadData, store.path() + ": chunk " + toString(key) + ": " + what + "; bake the world again"};
}

std::vector<Box> changesBetween(const Mesh& before, const Mesh& after) {
    const size_t both = std::min(before.levels.size(), after.levels.size());
    std::vector<Box> changes(std::max(before.levels.size(), after.levels.size()));
    for (size_t k = 0; k < changes.size(); ++k) {
        if (k < both) {
            changes[k] = changedBox(before.levels[k], after.levels[k]);
        } else {
            changes[k] = before.bounds;
            changes[k].add(after.bounds);
        }
    }
    return changes;
}

/// What grew while it was made has room to grow on, an eighth of it in the mean. Edited chunks stay.
void shrink(EditedChunk& chunk) {
    chunk.set.shrink_to_fit();
    for (MeshLevel& level : chunk.terrain.levels) {
        level.positions.shrink_to_fit();
        level.indices.shrink_to_fit();
        level.clusters.shrink_to_fit();
    }
}

/// Null if the edit changes nothing of the chunk.
Result<EditedPointer> changed(const WorldStore& store, const EditedChunk& before, const TerrainEdit& edit) {
    const ChunkKey key = before.record.key;
    const Result<LevelSet> known = decodeLevelSet(before.set);
    CHECK(known);
    const Result<LevelSet> set = edited(known.value(), key, edit);
    if (!set) return set.error();
    if (set.value() == known.value()) return EditedPointer();
    auto after = std::make_shared<EditedChunk>();
    after->set = encodeLevelSet(set.value());
    if (!set.value().leaves.empty()) after->terrain = terrainMesh(set.value());
    if (after->terrain.levels.empty()) return bad(store, key, "no surface is left of its terrain");
    shrink(*after);
    after->changes = changesBetween(before.terrain, after->terrain);
    after->record = before.record;
    after->instanceBounds = before.instanceBounds;
    const double edge = store.header().chunkSize;
    after->record.terrain.clear();
    for (const MeshLevel& level : after->terrain.levels) after->record.terrain.push_back(recordOf(level));
    after->record.bounds = before.instanceBounds;
    after->record.bounds.add(transformed(after->terrain.bounds, glm::dmat3(1), {key.x * edge, 0.0, key.z * edge}));
    return EditedPointer(std::move(after));
}

}  // namespace

uint64_t memoryBytes(const EditedChunk& chunk) {
    uint64_t bytes = chunk.set.size();
    for (const LevelRecord& level : chunk.record.terrain) bytes += memoryBytes(level);
    return bytes;
}

std::vector<ChunkKey> EditedTerrain::terrainWithin(const TerrainEdit& edit) const {
    std::vector<ChunkKey> keys = chunksWithin(edit, store_.header());
    std::erase_if(keys, [this](ChunkKey key) {
        const ChunkRecord* record = store_.find(key);
        return !record || record->terrain.empty();
    });
    return keys;
}

Result<Done> EditedTerrain::require(const TerrainEdit& edit) const {
    if (const Result<Done> good = requireEdit(edit, store_.header()); !good) return good.error();
    if (terrainWithin(edit).empty())
        return Error{ErrorCode::kNotFound, "terrain edit: there is no terrain within its reach; move it to where some is"};
    return Done{};
}

Result<EditedPointer> EditedTerrain::current(ChunkKey key) const {
    if (const auto known = chunks_.find(key); known != chunks_.end()) return known->second;
    Result<Chunk> chunk = store_.readChunk(key);
    if (!chunk) return chunk.error();
    auto raw = store_.readBlob({key.x, key.y, key.z, 0, BlobKind::kLevelSet});
    if (!raw) return raw.error();
    const Result<LevelSet> set = decodeLevelSet(raw.value());
    if (!set) return bad(store_, key, set.error().what);
    const Header& header = store_.header();
    if (set.value().leaves.empty() || set.value().voxel != header.voxel ||
        std::abs(set.value().side * header.voxel - header.chunkSize) > 0.5 * header.voxel)
        return bad(store_, key, "its level set is not of this world");
    auto state = std::make_shared<EditedChunk>();
    state->record = *store_.find(key);
    for (const Instance& instance : chunk.value().instances)
        state->instanceBounds.add(transformed(store_.meshes()[instance.mesh].bounds,
                                              glm::dmat3(instance.placement.linear), instance.placement.translation));
    state->set = std::move(raw.value());
    state->terrain = std::move(chunk.value().terrain);
    return EditedPointer(std::move(state));
}

Result<std::vector<EditedPointer>> EditedTerrain::apply(const TerrainEdit& edit) {
    if (const Result<Done> good = require(edit); !good) return good.error();
    const std::vector<ChunkKey> keys = terrainWithin(edit);
    std::vector<std::optional<Result<EditedPointer>>> made(keys.size());
    tbb::parallel_for(size_t{0}, keys.size(), [&](size_t i) {
        const Result<EditedPointer> before = current(keys[i]);
        made[i].emplace(before ? changed(store_, *before.value(), edit) : before);
    });
    std::vector<EditedPointer> chunks;
    std::vector<ChangedChunk> rows;
    uint64_t bytes = bytes_;
    for (const auto& result : made) {
        if (!*result) return result->error();
        const EditedPointer& chunk = result->value();
        if (!chunk) continue;
        chunks.push_back(chunk);
        bytes += memoryBytes(*chunk);
        if (const auto known = chunks_.find(chunk->record.key); known != chunks_.end()) bytes -= memoryBytes(*known->second);
        rows.push_back({chunk->record, chunk->set, chunk->terrain});
    }
    if (bytes > mostBytes_)
        return Error{ErrorCode::kLimit, "terrain edit: edited chunks would take " + std::to_string(bytes) +
                                            " bytes of memory and may take " + std::to_string(mostBytes_) +
                                            ", half of its budget; raise --memory-budget"};
    if (editor_ && !rows.empty())
        if (const Result<Done> committed = editor_->commit(rows); !committed) return committed.error();
    for (const EditedPointer& chunk : chunks) chunks_[chunk->record.key] = chunk;
    bytes_ = bytes;
    return chunks;
}

}  // namespace world
