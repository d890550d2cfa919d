#include "world/bake.h"

#include <tbb/parallel_pipeline.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <memory>
#include <tuple>

#include "world/clusters.h"
#include "world/codec.h"
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

/// Makes items 0 to count - 1 on all threads and takes them in order on one thread at a time; at most two
/// items a thread are in flight, which bounds the memory. The first error in order wins.
template <class Item, class Make, class Take>
Result<Done> inOrder(size_t count, const Make& make, const Take& take) {
    using Ticket = std::shared_ptr<Result<Item>>;
    size_t next = 0;
    std::atomic<bool> failed = false;
    Result<Done> outcome = Done{};
    const size_t inFlight = static_cast<size_t>(tbb::this_task_arena::max_concurrency()) * 2;
    tbb::parallel_pipeline(
        inFlight,
        tbb::make_filter<void, size_t>(tbb::filter_mode::serial_in_order,
                                       [&](tbb::flow_control& flow) -> size_t {
                                           if (failed || next == count) {
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
    std::vector<uint32_t>& ids = baked.record.meshes;
    std::sort(ids.begin(), ids.end());
    ids.erase(std::unique(ids.begin(), ids.end()), ids.end());
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

}  // namespace

Result<BakeStats> bake(const BakeSource& source, const std::string& path, const Progress& progress) {
    CHECK(std::adjacent_find(source.chunks.begin(), source.chunks.end(), std::greater_equal<>()) ==
          source.chunks.end());
    if (!(source.header.chunkSize > 0) || !std::isfinite(source.header.chunkSize))
        return bad(source, "its chunk size is not above 0");
    Result<WorldWriter> created = WorldWriter::create(path);
    if (!created) return created.error();
    WorldWriter& writer = created.value();

    std::vector<MeshRecord> meshes;
    Result<Done> done = inOrder<BakedMesh>(
        source.meshes.size(), [&](size_t id) { return bakeMesh(source, id); },
        [&](BakedMesh&& mesh) {
            meshes.push_back(std::move(mesh.record));
            return putAll(writer, mesh.rows);
        });
    if (!done) return done.error();

    BakeStats stats;
    Header header = source.header;
    header.version = kWorldVersion;
    header.bounds = Box();
    std::vector<ChunkRecord> chunks;
    std::vector<NamedInstance> names;
    size_t asked = 0;
    done = inOrder<BakedChunk>(
        source.chunks.size(), [&](size_t i) { return bakeChunk(source, meshes, source.chunks[i]); },
        [&](BakedChunk&& chunk) {
            if (!chunk.rows.empty()) {
                ++stats.chunks;
                stats.instances += chunk.record.instances;
                if (!chunk.record.terrain.empty()) stats.terrainTriangles += chunk.record.terrain[0].triangles;
                header.bounds.add(chunk.record.bounds);
                names.insert(names.end(), chunk.names.begin(), chunk.names.end());
                chunks.push_back(std::move(chunk.record));
            }
            Result<Done> put = putAll(writer, chunk.rows);
            if (progress) progress(++asked, source.chunks.size());
            return put;
        });
    if (!done) return done.error();
    if (chunks.empty())
        return bad(
            source,
            "nothing in it casts a shadow: choose a source, or bounds, with triangles that are opaque");

    std::sort(names.begin(), names.end(), [](const NamedInstance& a, const NamedInstance& b) {
        return std::tie(a.name, a.chunk, a.slot) < std::tie(b.name, b.chunk, b.slot);
    });
    std::vector<Row> tables;
    tables.push_back({{.kind = BlobKind::kDirectory}, encodeDirectory(chunks)});
    tables.push_back({{.kind = BlobKind::kMeshTable}, encodeMeshTable(meshes)});
    tables.push_back({{.kind = BlobKind::kNames}, encodeNames(names)});
    tables.push_back({{.kind = BlobKind::kHeader}, encodeHeader(header)});
    done = putAll(writer, tables);
    if (done) done = writer.finish();
    if (!done) return done.error();
    return stats;
}

}  // namespace world
