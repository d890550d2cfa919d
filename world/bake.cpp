#include "world/bake.h"

#include <tbb/parallel_pipeline.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <memory>
#include <span>
#include <tuple>
#include <utility>

#include "world/clusters.h"
#include "world/codec.h"
#include "world/hash.h"
#include "world/program.h"
#include "world/mesh_bounds.h"
#include "world/store.h"

namespace world {
namespace {

struct Row {
    BlobKey key;
    std::vector<std::byte> raw;
};

/// A shared mesh, ready to be written.
struct BakedMesh {
    std::vector<Row> rows;
    MeshRecord record;
};

/// A chunk, ready to be written; no rows if it casts nothing.
struct BakedChunk {
    std::vector<Row> rows;
    ChunkRecord record;
    std::vector<NamedInstance> names;
};

Error bad(const BakeSource& source, const std::string& what) {
    return {ErrorCode::kBadData, source.header.source + ": " + what};
}

/// Makes items first to count - 1 on all threads and takes them in order on one thread at a time; at most two
/// items a thread are in flight, which bounds the memory. The first error in order wins.
template <class Item, class Make, class Take>
Result<Done> inOrder(size_t first, size_t count, const Make& make, const Take& take) {
    using Ticket = std::shared_ptr<Result<Item>>;
    size_t next = first;
    std::atomic<bool> failed = false;
    Result<Done> outcome = Done{};
    const size_t inFlight = static_cast<size_t>(tbb::this_task_arena::max_concurrency()) * 2;
    tbb::parallel_pipeline(
        inFlight,
        tbb::make_filter<void, size_t>(tbb::filter_mode::serial_in_order,
                                       [&](tbb::flow_control& flow) -> size_t {
                                           if (failed || next >= count) {
                                               flow.stop();
                                               return 0;
                                           }
                                           return next++;
                                       }) &
            tbb::make_filter<size_t, Ticket>(
                tbb::filter_mode::parallel,
                [&](size_t i) { return std::make_shared<Result<Item>>(make(i)); }) &
            tbb::make_filter<Ticket, void>(tbb::filter_mode::serial_in_order, [&](const Ticket& ticket) {
                if (failed) return;
                outcome = *ticket ? take(std::move(ticket->value())) : Result<Done>(ticket->error());
                if (!outcome) failed = true;
            }));
    return outcome;
}

bool byName(const NamedInstance& a, const NamedInstance& b) {
    return std::tie(a.name, a.chunk, a.slot) < std::tie(b.name, b.chunk, b.slot);
}

bool finite(const glm::vec3& v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

/// Tests what a source promises of a mesh, then cuts its levels into clusters. Coarse levels of which
/// nothing is left are dropped; the finest stays, empty or not.
Result<Done> cut(const BakeSource& source, const std::string& name, Mesh& mesh) {
    if (mesh.levels.empty() || mesh.levels.size() > kMaxLevels)
        return bad(source, name + " has " + std::to_string(mesh.levels.size()) + " levels of detail");
    float error = 0;
    for (size_t k = 0; k < mesh.levels.size(); ++k) {
        MeshLevel& level = mesh.levels[k];
        const std::string place = name + " level " + std::to_string(k);
        if (!std::all_of(level.positions.begin(), level.positions.end(), finite))
            return bad(source, place + ": a position is not finite");
        if (level.indices.size() % 3 != 0 ||
            std::any_of(level.indices.begin(), level.indices.end(),
                        [&level](uint32_t index) { return index >= level.positions.size(); }))
            return bad(source, place + ": an index names no position, or a triangle is cut short");
        if (!std::isfinite(level.error) || level.error < error || (k == 0 && level.error != 0))
            return bad(source, place + ": its error does not ascend from 0");
        error = level.error;
        buildClusters(level);
        if (k > 0 && level.indices.empty()) {
            mesh.levels.resize(k);
            break;
        }
    }
    mesh.bounds = boundsOf(mesh);
    return Done{};
}

Result<BakedMesh> bakeMesh(const BakeSource& source, size_t id) {
    Mesh mesh = source.meshes[id];
    const Result<Done> done = cut(source, "mesh " + std::to_string(id), mesh);
    if (!done) return done.error();
    BakedMesh baked;
    baked.record.bounds = mesh.bounds;
    for (size_t k = 0; k < mesh.levels.size(); ++k) {
        const MeshLevel& level = mesh.levels[k];
        baked.record.levels.push_back(recordOf(level));
        baked.rows.push_back({{static_cast<int32_t>(id), 0, 0, static_cast<int32_t>(k), BlobKind::kMesh},
                              encodeMeshLevel(level)});
    }
    return baked;
}

bool finite(const Placement& p) {
    return finite(p.linear[0]) && finite(p.linear[1]) && finite(p.linear[2]) &&
           std::isfinite(p.translation.x) && std::isfinite(p.translation.y) && std::isfinite(p.translation.z);
}

/// Takes over the instances that cast; their slots count only those.
Result<Done> bakeInstances(const BakeSource& source, const std::vector<MeshRecord>& meshes, SourceChunk& made,
                           std::vector<Instance>& casting, BakedChunk& baked) {
    const ChunkKey key = baked.record.key;
    if (!made.names.empty() && made.names.size() != made.instances.size())
        return bad(source, "chunk " + toString(key) + ": " + std::to_string(made.names.size()) +
                               " names for " + std::to_string(made.instances.size()) + " instances");
    for (size_t i = 0; i < made.instances.size(); ++i) {
        const Instance& instance = made.instances[i];
        if (instance.mesh >= meshes.size() || !finite(instance.placement))
            return bad(source, "chunk " + toString(key) + " instance " + std::to_string(i) +
                                   ": it names no mesh, or its placement is not finite");
        const Box& bounds = meshes[instance.mesh].bounds;
        if (bounds.empty()) continue;
        if (!made.names.empty() && !made.names[i].empty())
            baked.names.push_back({made.names[i], key, static_cast<uint32_t>(casting.size())});
        baked.record.bounds.add(
            transformed(bounds, glm::dmat3(instance.placement.linear), instance.placement.translation));
        baked.record.meshes.push_back(instance.mesh);
        casting.push_back(instance);
    }
    std::sort(baked.names.begin(), baked.names.end(), byName);
    std::vector<uint32_t>& ids = baked.record.meshes;
    std::sort(ids.begin(), ids.end());
    ids.erase(std::unique(ids.begin(), ids.end()), ids.end());
    ids.shrink_to_fit();  // records of all chunks are in memory
    baked.record.instances = static_cast<uint32_t>(casting.size());
    return Done{};
}

Result<Done> bakeTerrain(const BakeSource& source, TerrainChunk& terrain, BakedChunk& baked) {
    const ChunkKey key = baked.record.key;
    Mesh& mesh = terrain.mesh;
    if (mesh.levels.empty()) return Done{};
    const Result<Done> done = cut(source, "terrain of chunk " + toString(key), mesh);
    if (!done) return done.error();
    if (mesh.levels[0].indices.empty()) return Done{};
    const double edge = source.header.chunkSize;
    baked.record.bounds.add(transformed(mesh.bounds, glm::dmat3(1), {key.x * edge, 0.0, key.z * edge}));
    for (const MeshLevel& level : mesh.levels) {
        const auto k = static_cast<int32_t>(baked.record.terrain.size());
        baked.record.terrain.push_back(recordOf(level));
        baked.rows.push_back({{key.x, key.y, key.z, k, BlobKind::kTerrainMesh}, encodeMeshLevel(level)});
    }
    if (!terrain.levelSet.empty())
        baked.rows.push_back({{key.x, key.y, key.z, 0, BlobKind::kLevelSet}, std::move(terrain.levelSet)});
    return Done{};
}

Result<BakedChunk> bakeChunk(const BakeSource& source, const std::vector<MeshRecord>& meshes, ChunkKey key) {
    Result<SourceChunk> made = source.make(key);
    if (!made) return made.error();
    BakedChunk baked;
    baked.record.key = key;
    std::vector<Instance> casting;
    const Result<Done> instances = bakeInstances(source, meshes, made.value(), casting, baked);
    if (!instances) return instances.error();
    if (made.value().terrain) {
        const Result<Done> terrain = bakeTerrain(source, *made.value().terrain, baked);
        if (!terrain) return terrain.error();
    }
    if (!baked.record.bounds.empty())
        baked.rows.push_back({{key.x, key.y, key.z, 0, BlobKind::kInstances}, encodeInstances(casting)});
    return baked;
}

Result<Done> putAll(WorldWriter& writer, const std::vector<Row>& rows) {
    for (const Row& row : rows) {
        Result<Done> put = writer.put(row.key, row.raw);
        if (!put) return put;
    }
    return Done{};
}

/// Tells this bake from all that would write another world: by the source, and by the program, of which a
/// version to come may make other meshes.
uint64_t workOf(const BakeSource& source) {
    uint64_t hash = hashProgram(hashBytes(encodeHeader(source.header), source.contents));
    for (const Mesh& mesh : source.meshes) {
        for (const MeshLevel& level : mesh.levels) {
            hash = hashValues(std::span<const glm::vec3>(level.positions), hash);
            hash = hashValues(std::span<const uint32_t>(level.indices), hash);
            hash = hashValues(std::span<const float>(&level.error, 1), hash);
        }
        const size_t levels = mesh.levels.size();
        hash = hashValues(std::span<const size_t>(&levels, 1), hash);
    }
    hash = hashValues(std::span<const ChunkKey>(source.chunks), hash);
    return std::max<uint64_t>(hash, 1);
}

/// All of a world but its rows of meshes and chunks: grows by a record for each of them.
struct Tables {
    std::vector<MeshRecord> meshes;
    std::vector<ChunkRecord> chunks;
    std::vector<NamedInstance> names;

    void add(ChunkRecord record, const std::vector<NamedInstance>& named) {
        names.insert(names.end(), named.begin(), named.end());
        chunks.push_back(std::move(record));
    }

    /// What the steps of an earlier bake left: the meshes of the source first, then its chunks.
    Result<Done> restore(const std::vector<WorldWriter::Step>& steps, size_t meshCount) {
        for (const WorldWriter::Step& step : steps) {
            if (meshes.size() < meshCount) {
                Result<std::vector<MeshRecord>> mesh = decodeMeshTable(step.record);
                if (!mesh) return mesh.error();
                meshes.insert(meshes.end(), mesh.value().begin(), mesh.value().end());
            } else {
                Result<std::vector<ChunkRecord>> chunk = decodeDirectory(step.record);
                if (!chunk) return chunk.error();
                const Result<std::vector<NamedInstance>> named = decodeNames(step.names);
                if (!named) return named.error();
                for (ChunkRecord& record : chunk.value()) add(std::move(record), named.value());
            }
        }
        return Done{};
    }

    /// To be called once, at the end.
    std::vector<Row> rows(Header header) {
        header.version = kWorldVersion;
        header.bounds = Box();
        for (const ChunkRecord& chunk : chunks) header.bounds.add(chunk.bounds);
        std::sort(names.begin(), names.end(), byName);
        std::vector<Row> rows;
        rows.push_back({{.kind = BlobKind::kDirectory}, encodeDirectory(chunks)});
        rows.push_back({{.kind = BlobKind::kMeshTable}, encodeMeshTable(meshes)});
        rows.push_back({{.kind = BlobKind::kNames}, encodeNames(names)});
        rows.push_back({{.kind = BlobKind::kHeader}, encodeHeader(header)});
        return rows;
    }
};

BakeStats statsOf(const std::vector<ChunkRecord>& chunks) {
    BakeStats stats;
    stats.chunks = chunks.size();
    for (const ChunkRecord& chunk : chunks) {
        stats.instances += chunk.instances;
        if (!chunk.terrain.empty()) stats.terrainTriangles += chunk.terrain[0].triangles;
    }
    return stats;
}

}  // namespace

Result<BakeStats> bake(const BakeSource& source, const std::string& path, const Progress& progress,
                       const Notice& notice) {
    CHECK(std::adjacent_find(source.chunks.begin(), source.chunks.end(), std::greater_equal<>()) ==
          source.chunks.end());
    if (!(source.header.chunkSize > 0) || !std::isfinite(source.header.chunkSize))
        return bad(source, "its chunk size is not above 0");
    Result<WorldWriter> created = WorldWriter::create(path, workOf(source));
    if (!created) return created.error();
    WorldWriter& writer = created.value();

    // A step for each mesh and then for each chunk.
    const size_t meshCount = source.meshes.size(), chunkCount = source.chunks.size();
    Tables tables;
    std::vector<WorldWriter::Step> before = writer.takeSteps();
    const size_t stepsDone = before.size();
    const Result<Done> known = tables.restore(std::exchange(before, {}), meshCount);
    if (!known || stepsDone > meshCount + chunkCount)
        return bad(source, path + ".baking was damaged and is removed: bake again");
    const size_t meshesDone = tables.meshes.size();
    size_t chunksDone = stepsDone - meshesDone;
    if (notice && writer.startedOver())
        notice(path + ".baking is of another source, other options or another program: begins anew");
    if (notice && stepsDone > 0)
        notice(path + ".baking: goes on after " + std::to_string(chunksDone) + " of " +
               std::to_string(chunkCount) + " chunks");
    if (progress && chunksDone > 0) progress(chunksDone, chunkCount);

    Result<Done> done = inOrder<BakedMesh>(
        meshesDone, meshCount, [&](size_t id) { return bakeMesh(source, id); },
        [&](BakedMesh&& mesh) {
            const Result<Done> put = putAll(writer, mesh.rows);
            if (!put) return put;
            tables.meshes.push_back(std::move(mesh.record));
            return writer.endStep({encodeMeshTable(std::span(&tables.meshes.back(), 1)), {}});
        });
    if (!done) return done.error();
    done = inOrder<BakedChunk>(
        chunksDone, chunkCount, [&](size_t i) { return bakeChunk(source, tables.meshes, source.chunks[i]); },
        [&](BakedChunk&& chunk) {
            Result<Done> put = putAll(writer, chunk.rows);
            if (!put) return put;
            const bool casts = !chunk.rows.empty();
            put = writer.endStep(
                {encodeDirectory(std::span(&chunk.record, casts ? 1 : 0)), encodeNames(chunk.names)});
            if (casts) tables.add(std::move(chunk.record), chunk.names);
            if (progress) progress(++chunksDone, chunkCount);
            return put;
        });
    if (!done) return done.error();
    if (tables.chunks.empty())
        return bad(
            source,
            "nothing in it casts a shadow: choose a source, or bounds, with triangles that are opaque");
    const BakeStats stats = statsOf(tables.chunks);
    done = putAll(writer, tables.rows(source.header));
    if (done) done = writer.finish();
    if (!done) return done.error();
    return stats;
}

}  // namespace world
