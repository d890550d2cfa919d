// world/world_check.cpp — WorldStore::check: reads every row once and compares what rows say of each other.

#include <tbb/parallel_for.h>

#include <algorithm>
#include <map>

#include "world/codec.h"
#include "world/level_set.h"
#include "world/mesh_bounds.h"
#include "world/store.h"

namespace world {
namespace {

bool holds(const Box& outer, const Box& inner) {
    if (inner.empty()) return true;
    return glm::all(glm::lessThanEqual(outer.min, inner.min)) &&
           glm::all(glm::lessThanEqual(inner.max, outer.max));
}

/// What is wrong with one part of a world, in words.
class Findings {
public:
    explicit Findings(const std::string& path) : path_(path) {}
    void add(const BlobKey& row, const std::string& what) {
        errors_.push_back({ErrorCode::kBadData, path_ + ": " + toString(row) + ": " + what});
    }
    void add(const Error& error) { errors_.push_back(error); }
    std::vector<Error> take() { return std::move(errors_); }

private:
    const std::string& path_;
    std::vector<Error> errors_;
};

void checkClusters(const BlobKey& row, const MeshLevel& level, Findings& findings) {
    for (size_t c = 0; c < level.clusters.size(); ++c) {
        const Cluster& cluster = level.clusters[c];
        bool inside = true;
        for (uint32_t i = 0; i < cluster.indexCount; ++i) {
            const glm::vec3& p = level.positions[level.indices[cluster.firstIndex + i]];
            inside = inside && glm::all(glm::lessThanEqual(cluster.min, p)) &&
                     glm::all(glm::lessThanEqual(p, cluster.max));
        }
        if (!inside) findings.add(row, "cluster " + std::to_string(c) + " leaves its bounds");
    }
}

/// `row` is level 0's.
void checkLevels(BlobKey row, const Mesh& mesh, Findings& findings) {
    for (size_t k = 0; k < mesh.levels.size(); ++k) {
        row.lod = static_cast<int32_t>(k);
        checkClusters(row, mesh.levels[k], findings);
    }
}

std::vector<Error> checkMesh(const WorldStore& world, uint32_t id) {
    Findings findings(world.path());
    const Result<Mesh> mesh = world.readMesh(id);
    if (!mesh) {
        findings.add(mesh.error());
        return findings.take();
    }
    const BlobKey row{static_cast<int32_t>(id), 0, 0, 0, BlobKind::kMesh};
    checkLevels(row, mesh.value(), findings);
    if (boundsOf(mesh.value()) != mesh.value().bounds)
        findings.add(row, "its bounds are not those of the mesh table");
    return findings.take();
}

/// A chunk need not have one.
void checkLevelSet(const WorldStore& world, const BlobKey& row, Findings& findings) {
    const Result<std::vector<std::byte>> raw = world.readBlob(row);
    if (!raw) {
        if (raw.error().code != ErrorCode::kNotFound) findings.add(raw.error());
        return;
    }
    const Result<LevelSet> set = decodeLevelSet(raw.value());
    if (!set) findings.add(row, set.error().what);
}

std::vector<Error> checkChunk(const WorldStore& world, const ChunkRecord& record) {
    Findings findings(world.path());
    const Result<Chunk> read = world.readChunk(record.key);
    if (!read) {
        findings.add(read.error());
        return findings.take();
    }
    const Chunk& chunk = read.value();
    const ChunkKey key = record.key;
    const BlobKey row{key.x, key.y, key.z, 0, BlobKind::kInstances},
        terrainRow{key.x, key.y, key.z, 0, BlobKind::kTerrainMesh};
    std::vector<uint32_t> used;
    bool held = true;
    for (const Instance& instance : chunk.instances) {
        used.push_back(instance.mesh);
        held = held && holds(record.bounds, transformed(world.meshes()[instance.mesh].bounds,
                                                        glm::dmat3(instance.placement.linear),
                                                        instance.placement.translation));
    }
    std::sort(used.begin(), used.end());
    used.erase(std::unique(used.begin(), used.end()), used.end());
    if (!held) findings.add(row, "an instance leaves the chunk's bounds");
    if (used != record.meshes) findings.add(row, "the directory names a mesh that no instance uses");
    checkLevels(terrainRow, chunk.terrain, findings);
    const double edge = world.header().chunkSize;
    if (!holds(record.bounds,
               transformed(chunk.terrain.bounds, glm::dmat3(1), {key.x * edge, 0.0, key.z * edge})))
        findings.add(terrainRow, "it leaves the chunk's bounds");
    checkLevelSet(world, {key.x, key.y, key.z, 0, BlobKind::kLevelSet}, findings);
    if (!holds(world.header().bounds, record.bounds))
        findings.add({.kind = BlobKind::kHeader}, "chunk " + toString(key) + " leaves its bounds");
    return findings.take();
}

std::vector<Error> checkNames(const WorldStore& world) {
    Findings findings(world.path());
    const Result<std::vector<NamedInstance>> names = world.names();
    if (!names) {
        findings.add(names.error());
        return findings.take();
    }
    for (const NamedInstance& name : names.value()) {
        const ChunkRecord* record = world.find(name.chunk);
        if (!record || name.slot >= record->instances)
            findings.add({.kind = BlobKind::kNames},
                         "'" + name.name + "' names no instance of chunk " + toString(name.chunk));
    }
    return findings.take();
}

/// Rows that nothing names: left over, or their key is damaged and somebody misses them.
std::vector<Error> checkRows(const WorldStore& world) {
    Findings findings(world.path());
    const Result<std::vector<BlobInfo>> rows = world.listBlobs();
    if (!rows) {
        findings.add(rows.error());
        return findings.take();
    }
    std::map<ChunkKey, size_t> chunks;  // and how many levels of terrain each has
    for (const ChunkRecord& record : world.chunks()) chunks[record.key] = record.terrain.size();
    for (const BlobInfo& info : rows.value()) {
        const BlobKey& row = info.key;
        const ChunkKey key{row.x, row.y, row.z};
        bool expected = false;
        switch (row.kind) {
            case BlobKind::kHeader:
            case BlobKind::kDirectory:
            case BlobKind::kMeshTable:
            case BlobKind::kNames:
                expected = key == ChunkKey() && row.lod == 0;
                break;
            case BlobKind::kMesh:
                expected = row.x >= 0 && static_cast<size_t>(row.x) < world.meshes().size() && row.y == 0 &&
                           row.z == 0 && row.lod >= 0 &&
                           static_cast<size_t>(row.lod) <
                               world.meshes()[static_cast<size_t>(row.x)].levels.size();
                break;
            case BlobKind::kInstances:
                expected = chunks.contains(key) && row.lod == 0;
                break;
            case BlobKind::kTerrainMesh:
                expected = chunks.contains(key) && row.lod >= 0 && static_cast<size_t>(row.lod) < chunks.at(key);
                break;
            case BlobKind::kLevelSet:
                expected = chunks.contains(key) && chunks.at(key) > 0 && row.lod == 0;
                break;
            case BlobKind::kChunkRecord:
                expected = row.x == kRecordX && chunks.contains({row.y, row.lod, row.z});
                break;
        }
        if (!expected) findings.add(row, "nothing in the world names this row");
    }
    return findings.take();
}

}  // namespace

std::vector<Error> WorldStore::check() const {
    const size_t meshCount = meshes().size(), chunkCount = chunks().size();
    std::vector<std::vector<Error>> parts(meshCount + chunkCount + 1);
    tbb::parallel_for(size_t{0}, meshCount + chunkCount, [&](size_t i) {
        parts[i] = i < meshCount ? checkMesh(*this, static_cast<uint32_t>(i))
                                 : checkChunk(*this, chunks()[i - meshCount]);
    });
    std::vector<Error> findings = checkRows(*this);
    parts.back() = checkNames(*this);
    for (const std::vector<Error>& part : parts) findings.insert(findings.end(), part.begin(), part.end());
    return findings;
}

}  // namespace world
