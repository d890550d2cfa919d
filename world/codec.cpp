#include "world/codec.h"

#include <algorithm>
#include <functional>
#include <tuple>

#include "world/bytes.h"
#include "world/store.h"

namespace world {
namespace {

constexpr size_t kBoxBytes = 1;  // an empty one
constexpr size_t kLevelRecordBytes = 4 * 4;
constexpr size_t kRecordBytes = 3 * 4 + kBoxBytes + 4 + 4 + 4;
constexpr size_t kMeshRecordBytes = 4 + kLevelRecordBytes + kBoxBytes;
constexpr size_t kNameBytes = 4 + 3 * 4 + 4;
constexpr size_t kInstanceBytes = 4 + 9 * 4 + 3 * 8;
constexpr size_t kPositionBytes = 3 * 4, kIndexBytes = 4, kClusterBytes = 2 * 4 + 6 * 4;

/// Far more than rounding leaves of a unit vector that was normalised in double.
constexpr double kUnitTolerance = 1e-6;

void putKey(ByteWriter& w, ChunkKey key) { w.i32(key.x), w.i32(key.y), w.i32(key.z); }

ChunkKey getKey(ByteReader& r) {
    const int32_t x = r.i32(), y = r.i32(), z = r.i32();
    return {x, y, z};
}

void putLevels(ByteWriter& w, std::span<const LevelRecord> levels) {
    w.u32(static_cast<uint32_t>(levels.size()));
    for (const LevelRecord& l : levels) {
        w.u32(l.triangles);
        w.u32(l.vertices);
        w.u32(l.clusters);
        w.f32(l.error);
    }
}

/// Errors ascend from 0.
std::vector<LevelRecord> getLevels(ByteReader& r) {
    std::vector<LevelRecord> levels(r.count(kLevelRecordBytes, "levels"));
    if (levels.size() > kMaxLevels) r.fail(std::to_string(levels.size()) + " levels");
    float error = 0;
    for (LevelRecord& l : levels) {
        l.triangles = r.u32();
        l.vertices = r.u32();
        l.clusters = r.u32();
        l.error = r.f32();
        if (l.error < error || (&l == levels.data() && l.error != 0))
            r.fail("the errors of levels do not ascend from 0");
        error = l.error;
    }
    return levels;
}

template <class T>
Result<T> whole(ByteReader& r, T&& value) {
    const Result<Done> end = r.end();
    if (!end) return end.error();
    return std::move(value);
}

auto order(const NamedInstance& n) { return std::tie(n.name, n.chunk, n.slot); }

}  // namespace

std::vector<std::byte> encodeHeader(const Header& header) {
    ByteWriter w;
    w.u32(header.version);
    w.f64(header.chunkSize);
    w.box(header.bounds);
    w.dvec3(header.sun);
    w.f64(header.voxel);
    w.string(header.source);
    return w.take();
}

Result<Header> decodeHeader(std::span<const std::byte> bytes) {
    ByteReader r(bytes);
    Header h;
    h.version = r.u32();
    if (r.ok() && h.version > kWorldVersion) return h;
    if (h.version == 0) r.fail("there is no version 0");
    h.chunkSize = r.f64();
    if (!(h.chunkSize > 0)) r.fail("the chunk size is not above 0");
    h.bounds = r.box();
    h.sun = r.dvec3();
    const double length = glm::length(h.sun);
    if (length != 0 && !(std::abs(length - 1) <= kUnitTolerance))
        r.fail("the sun's direction is not of unit length");
    h.voxel = r.f64();
    if (h.voxel < 0) r.fail("the voxel edge is negative");
    h.source = r.string();
    return whole(r, std::move(h));
}

std::vector<std::byte> encodeDirectory(std::span<const ChunkRecord> chunks) {
    ByteWriter w;
    w.u32(static_cast<uint32_t>(chunks.size()));
    for (const ChunkRecord& c : chunks) {
        putKey(w, c.key);
        w.box(c.bounds);
        w.u32(c.instances);
        putLevels(w, c.terrain);
        w.u32(static_cast<uint32_t>(c.meshes.size()));
        for (const uint32_t id : c.meshes) w.u32(id);
    }
    return w.take();
}

Result<std::vector<ChunkRecord>> decodeDirectory(std::span<const std::byte> bytes) {
    ByteReader r(bytes);
    std::vector<ChunkRecord> chunks(r.count(kRecordBytes, "chunks"));
    for (size_t i = 0; i < chunks.size() && r.ok(); ++i) {
        ChunkRecord& c = chunks[i];
        c.key = getKey(r);
        if (i > 0 && !(chunks[i - 1].key < c.key)) r.fail("chunk " + toString(c.key) + " is out of order");
        c.bounds = r.box();
        c.instances = r.u32();
        c.terrain = getLevels(r);
        c.meshes.resize(r.count(sizeof(uint32_t), "mesh ids"));
        for (uint32_t& id : c.meshes) id = r.u32();
        if (std::adjacent_find(c.meshes.begin(), c.meshes.end(), std::greater_equal<>()) != c.meshes.end())
            r.fail("the mesh ids of chunk " + toString(c.key) + " do not ascend");
    }
    return whole(r, std::move(chunks));
}

std::vector<std::byte> encodeMeshTable(std::span<const MeshRecord> meshes) {
    ByteWriter w;
    w.u32(static_cast<uint32_t>(meshes.size()));
    for (const MeshRecord& m : meshes) {
        putLevels(w, m.levels);
        w.box(m.bounds);
    }
    return w.take();
}

Result<std::vector<MeshRecord>> decodeMeshTable(std::span<const std::byte> bytes) {
    ByteReader r(bytes);
    std::vector<MeshRecord> meshes(r.count(kMeshRecordBytes, "meshes"));
    for (size_t i = 0; i < meshes.size() && r.ok(); ++i) {
        MeshRecord& m = meshes[i];
        m.levels = getLevels(r);
        if (m.levels.empty()) r.fail("mesh " + std::to_string(i) + " has no levels");
        m.bounds = r.box();
    }
    return whole(r, std::move(meshes));
}

std::vector<std::byte> encodeNames(std::span<const NamedInstance> names) {
    ByteWriter w;
    w.u32(static_cast<uint32_t>(names.size()));
    for (const NamedInstance& n : names) {
        w.string(n.name);
        putKey(w, n.chunk);
        w.u32(n.slot);
    }
    return w.take();
}

Result<std::vector<NamedInstance>> decodeNames(std::span<const std::byte> bytes) {
    ByteReader r(bytes);
    std::vector<NamedInstance> names(r.count(kNameBytes, "names"));
    for (size_t i = 0; i < names.size() && r.ok(); ++i) {
        names[i].name = r.string();
        names[i].chunk = getKey(r);
        names[i].slot = r.u32();
        if (i > 0 && !(order(names[i - 1]) < order(names[i])))
            r.fail("name " + std::to_string(i) + " is out of order");
    }
    return whole(r, std::move(names));
}

std::vector<std::byte> encodeInstances(std::span<const Instance> instances) {
    ByteWriter w;
    w.reserve(4 + instances.size() * kInstanceBytes);
    w.u32(static_cast<uint32_t>(instances.size()));
    for (const Instance& i : instances) {
        w.u32(i.mesh);
        for (int column = 0; column < 3; ++column) w.vec3(i.placement.linear[column]);
        w.dvec3(i.placement.translation);
    }
    return w.take();
}

Result<std::vector<Instance>> decodeInstances(std::span<const std::byte> bytes) {
    ByteReader r(bytes);
    std::vector<Instance> instances(r.count(kInstanceBytes, "instances"));
    for (Instance& i : instances) {
        i.mesh = r.u32();
        for (int column = 0; column < 3; ++column) i.placement.linear[column] = r.vec3();
        i.placement.translation = r.dvec3();
    }
    return whole(r, std::move(instances));
}

std::vector<std::byte> encodeMeshLevel(const MeshLevel& level) {
    ByteWriter w;
    w.reserve(16 + level.positions.size() * kPositionBytes + level.indices.size() * kIndexBytes +
              level.clusters.size() * kClusterBytes);
    w.f32(level.error);
    w.u32(static_cast<uint32_t>(level.positions.size()));
    for (const glm::vec3& p : level.positions) w.vec3(p);
    w.u32(static_cast<uint32_t>(level.indices.size()));
    for (const uint32_t index : level.indices) w.u32(index);
    w.u32(static_cast<uint32_t>(level.clusters.size()));
    for (const Cluster& c : level.clusters) {
        w.u32(c.firstIndex);
        w.u32(c.indexCount);
        w.vec3(c.min);
        w.vec3(c.max);
    }
    return w.take();
}

Result<MeshLevel> decodeMeshLevel(std::span<const std::byte> bytes) {
    ByteReader r(bytes);
    MeshLevel level;
    level.error = r.f32();
    if (level.error < 0) r.fail("the error of the level is negative");
    level.positions.resize(r.count(kPositionBytes, "positions"));
    for (glm::vec3& p : level.positions) p = r.vec3();
    level.indices.resize(r.count(kIndexBytes, "indices"));
    uint32_t highest = 0;
    for (uint32_t& index : level.indices) highest = std::max(highest, index = r.u32());
    if (!level.indices.empty() && highest >= level.positions.size())
        r.fail("index " + std::to_string(highest) + " names none of " +
               std::to_string(level.positions.size()) + " positions");
    level.clusters.resize(r.count(kClusterBytes, "clusters"));
    size_t covered = 0;
    for (Cluster& c : level.clusters) {
        c.firstIndex = r.u32();
        c.indexCount = r.u32();
        c.min = r.vec3();
        c.max = r.vec3();
        if (c.firstIndex != covered || c.indexCount == 0 || c.indexCount % 3 != 0 ||
            c.indexCount > 3 * kClusterTriangles)
            r.fail("a cluster holds indices " + std::to_string(c.firstIndex) + " and " +
                   std::to_string(c.indexCount) + " more, " + std::to_string(covered) +
                   " are covered so far");
        covered += c.indexCount;
    }
    if (covered != level.indices.size())
        r.fail("the clusters cover " + std::to_string(covered) + " of " +
               std::to_string(level.indices.size()) + " indices");
    return whole(r, std::move(level));
}

}  // namespace world
