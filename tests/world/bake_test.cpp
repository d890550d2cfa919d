#include "world/bake.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <map>
#include <set>
#include <tuple>

#include "random_world.h"
#include "world/codec.h"
#include "world/store.h"

namespace {

using namespace world;
using world_tests::randomSource;
using world_tests::RandomWorld;
using world_tests::readFile;
using world_tests::TempFolder;
using world_tests::writeFile;

/// The triangles' corners as positions, in an order that clustering does not change.
std::vector<std::array<float, 9>> triangles(const MeshLevel& level) {
    std::vector<std::array<float, 9>> all;
    for (size_t i = 0; i + 2 < level.indices.size(); i += 3) {
        std::array<float, 9> t{};
        for (size_t k = 0; k < 3; ++k)
            for (int axis = 0; axis < 3; ++axis)
                t[k * 3 + static_cast<size_t>(axis)] = level.positions[level.indices[i + k]][axis];
        all.push_back(t);
    }
    std::sort(all.begin(), all.end());
    return all;
}

/// The box of all corners of all levels, placed.
void addPlaced(Box& box, const Mesh& mesh, const Placement& p) {
    for (const MeshLevel& level : mesh.levels)
        for (const glm::vec3& v : level.positions)
            box.add(glm::dmat3(p.linear) * glm::dvec3(v) + p.translation);
}

void holdsItsSource(const RandomWorld& options) {
    TempFolder folder;
    const BakeSource source = randomSource(options);
    std::vector<size_t> steps;
    const Result<BakeStats> stats = bake(source, folder.file("w"), [&](size_t done, size_t total) {
        EXPECT_EQ(total, source.chunks.size());
        steps.push_back(done);
    });
    ASSERT_TRUE(stats) << stats.error().what;
    ASSERT_EQ(steps.size(), source.chunks.size());
    for (size_t i = 0; i < steps.size(); ++i) EXPECT_EQ(steps[i], i + 1);
    EXPECT_EQ(folder.list(), std::vector<std::string>{"w"});

    const Result<WorldStore> opened = WorldStore::open(folder.file("w"));
    ASSERT_TRUE(opened) << opened.error().what;
    const WorldStore& world = opened.value();
    for (const Error& finding : world.check()) ADD_FAILURE() << finding.what;
    EXPECT_EQ(world.header().version, kWorldVersion);
    EXPECT_EQ(world.header().source, source.header.source);
    EXPECT_EQ(world.header().sun, source.header.sun);

    ASSERT_EQ(world.meshes().size(), source.meshes.size());
    for (uint32_t id = 0; id < source.meshes.size(); ++id) {
        const Result<Mesh> mesh = world.readMesh(id);
        ASSERT_TRUE(mesh) << mesh.error().what;
        ASSERT_EQ(mesh.value().levels.size(), source.meshes[id].levels.size());
        for (size_t k = 0; k < mesh.value().levels.size(); ++k) {
            EXPECT_EQ(triangles(mesh.value().levels[k]), triangles(source.meshes[id].levels[k]));
            EXPECT_FALSE(mesh.value().levels[k].clusters.empty());
        }
    }

    Box all;
    size_t at = 0;
    std::vector<std::tuple<std::string, ChunkKey, uint32_t>> names;
    BakeStats expected;
    for (const ChunkKey key : source.chunks) {
        const SourceChunk made = source.make(key).value();
        if (made.instances.empty() && !made.terrain) continue;
        ASSERT_LT(at, world.chunks().size());
        const ChunkRecord& record = world.chunks()[at++];
        ASSERT_EQ(record.key, key);
        EXPECT_EQ(record.instances, made.instances.size());
        EXPECT_EQ(record.terrain.empty(), !made.terrain.has_value());
        const Result<Chunk> chunk = world.readChunk(key);
        ASSERT_TRUE(chunk) << chunk.error().what;
        ASSERT_EQ(chunk.value().instances.size(), made.instances.size());
        std::set<uint32_t> ids;
        Box box;
        for (size_t i = 0; i < made.instances.size(); ++i) {
            EXPECT_EQ(chunk.value().instances[i].mesh, made.instances[i].mesh);
            EXPECT_EQ(chunk.value().instances[i].placement, made.instances[i].placement);
            ids.insert(made.instances[i].mesh);
            addPlaced(box, source.meshes[made.instances[i].mesh], made.instances[i].placement);
            if (!made.names[i].empty()) names.emplace_back(made.names[i], key, static_cast<uint32_t>(i));
        }
        EXPECT_EQ(record.meshes, std::vector<uint32_t>(ids.begin(), ids.end()));
        if (made.terrain) {
            ASSERT_EQ(chunk.value().terrain.levels.size(), made.terrain->mesh.levels.size());
            for (size_t k = 0; k < made.terrain->mesh.levels.size(); ++k)
                EXPECT_EQ(triangles(chunk.value().terrain.levels[k]),
                          triangles(made.terrain->mesh.levels[k]));
            addPlaced(box, made.terrain->mesh,
                      {glm::mat3(1), {key.x * options.chunkSize, 0, key.z * options.chunkSize}});
            expected.terrainTriangles += made.terrain->mesh.levels[0].indices.size() / 3;
        }
        // Moved bounds enclose moved corners up to the rounding of a few sums of doubles.
        const double slack = 1e-12 * (std::abs(box.max.x) + std::abs(box.max.z) + 100);
        EXPECT_TRUE(glm::all(glm::lessThanEqual(record.bounds.min, box.min + slack)));
        EXPECT_TRUE(glm::all(glm::lessThanEqual(box.max - slack, record.bounds.max)));
        all.add(record.bounds);
        ++expected.chunks;
        expected.instances += made.instances.size();
    }
    EXPECT_EQ(at, world.chunks().size());
    EXPECT_EQ(world.header().bounds, all);
    EXPECT_EQ(stats.value().chunks, expected.chunks);
    EXPECT_EQ(stats.value().instances, expected.instances);
    EXPECT_EQ(stats.value().terrainTriangles, expected.terrainTriangles);

    std::sort(names.begin(), names.end());
    const std::vector<NamedInstance> found = world.names().value();
    ASSERT_EQ(found.size(), names.size());
    for (size_t i = 0; i < names.size(); ++i)
        EXPECT_EQ(found[i],
                  (NamedInstance{std::get<0>(names[i]), std::get<1>(names[i]), std::get<2>(names[i])}));
}

TEST(Bake, HoldsItsSource) { holdsItsSource({.seed = 31, .chunksAside = 6}); }
TEST(Bake, HoldsItsSourceFarFromTheOrigin) { holdsItsSource({.seed = 32, .firstChunk = 31250}); }
TEST(Bake, HoldsOneChunk) { holdsItsSource({.seed = 35, .chunksAside = 1, .firstChunk = 0, .meshes = 1}); }

TEST(Bake, IsTheSameForAnyNumberOfThreads) {
    TempFolder folder;
    const BakeSource source = randomSource({.seed = 33, .chunksAside = 8});
    std::set<uint64_t> hashes;
    std::set<std::string> files;
    for (const size_t threads : {1, 2, 5}) {
        const tbb::global_control control(tbb::global_control::max_allowed_parallelism, threads);
        ASSERT_TRUE(bake(source, folder.file("w"), {}));
        hashes.insert(WorldStore::open(folder.file("w")).value().contentHash().value());
        files.insert(readFile(folder.file("w")));
    }
    EXPECT_EQ(hashes.size(), 1u);
    EXPECT_EQ(files.size(), 1u) << "the file itself, byte for byte";
    BakeSource other = randomSource({.seed = 34, .chunksAside = 8});
    ASSERT_TRUE(bake(other, folder.file("w"), {}));
    EXPECT_FALSE(hashes.contains(WorldStore::open(folder.file("w")).value().contentHash().value()));
}

TEST(Bake, PassesTheFirstErrorOnAndLeavesThePathAsItWas) {
    TempFolder folder;
    BakeSource source = randomSource({.seed = 36, .chunksAside = 8});
    ASSERT_TRUE(bake(source, folder.file("w"), {}));
    const std::string before = readFile(folder.file("w"));
    const auto good = source.make;
    source.make = [good](ChunkKey key) -> Result<SourceChunk> {
        if (key.x >= 1) return Error{ErrorCode::kIo, "chunk " + toString(key) + ": tape tangled"};
        return good(key);
    };
    for (int repeat = 0; repeat < 20; ++repeat) {
        const Result<BakeStats> stats = bake(source, folder.file("w"), {});
        ASSERT_FALSE(stats);
        EXPECT_EQ(stats.error().code, ErrorCode::kIo);
        EXPECT_EQ(stats.error().what, "chunk (1,0,-2): tape tangled");
        EXPECT_EQ(folder.list(), std::vector<std::string>{"w"});
        EXPECT_EQ(readFile(folder.file("w")), before);
    }
}

TEST(Bake, RefusesWhatCastsNothing) {
    TempFolder folder;
    BakeSource source = randomSource({.seed = 37});
    const auto refused = [&] {
        const Result<BakeStats> stats = bake(source, folder.file("w"), {});
        ASSERT_FALSE(stats);
        EXPECT_EQ(stats.error().code, ErrorCode::kBadData);
        EXPECT_EQ(stats.error().what.find("random:37: nothing in it casts a shadow: "), 0u)
            << stats.error().what;
        EXPECT_TRUE(folder.list().empty());
    };
    const auto chunks = source.chunks;
    source.chunks.clear();
    refused();
    source.chunks = chunks;
    // Only a mesh without area, only terrain without triangles.
    source.meshes.resize(1);
    MeshLevel line;
    line.positions = {glm::vec3(0), glm::vec3(1), glm::vec3(2)};
    line.indices = {0, 1, 2};
    source.meshes[0].levels.assign(1, line);
    source.make = [](ChunkKey) -> Result<SourceChunk> {
        SourceChunk chunk;
        chunk.instances.resize(3);
        chunk.terrain.emplace();
        chunk.terrain->mesh.levels.resize(1);
        return chunk;
    };
    refused();
}

TEST(Bake, LeavesOutWhatHasNoTriangles) {
    TempFolder folder;
    BakeSource source = randomSource({.seed = 38});
    std::mt19937 rng(38);
    source.chunks = {{0, 0, 0}};
    source.meshes.resize(3);
    source.meshes[0].levels.assign(1, MeshLevel{});
    MeshLevel empty;
    empty.error = 1;
    source.meshes[1].levels = {world_tests::patch(4, 0, rng), empty, world_tests::patch(1, 2, rng)};
    source.make = [](ChunkKey) -> Result<SourceChunk> {
        SourceChunk chunk;
        chunk.instances.resize(4);
        chunk.instances[1].mesh = chunk.instances[3].mesh = 1;
        chunk.names = {"empty", "b", "nothing", "a"};
        return chunk;
    };
    const Result<BakeStats> stats = bake(source, folder.file("w"), {});
    ASSERT_TRUE(stats) << stats.error().what;
    EXPECT_EQ(stats.value().instances, 2u);
    const Result<WorldStore> world = WorldStore::open(folder.file("w"));
    ASSERT_TRUE(world);
    EXPECT_TRUE(world.value().check().empty());
    ASSERT_EQ(world.value().meshes()[1].levels.size(), 1u) << "an empty level ends the list";
    EXPECT_EQ(world.value().meshes()[1].levels[0].triangles, 32u);
    const std::vector<NamedInstance> names = {{"a", {}, 1}, {"b", {}, 0}};
    EXPECT_EQ(world.value().names().value(), names);
}

TEST(Bake, NamesWhatASourceGotWrong) {
    TempFolder folder;
    const BakeSource good = randomSource({.seed = 39});
    const auto refused = [&](const std::string& says, const std::function<void(BakeSource&)>& damage) {
        BakeSource source = good;
        damage(source);
        const Result<BakeStats> stats = bake(source, folder.file("w"), {});
        ASSERT_FALSE(stats) << says;
        EXPECT_EQ(stats.error().code, ErrorCode::kBadData);
        EXPECT_NE(stats.error().what.find(says), std::string::npos) << stats.error().what;
        EXPECT_TRUE(folder.list().empty());
    };
    refused("random:39: mesh 2 level 0", [](BakeSource& s) { s.meshes[2].levels[0].indices[1] = 1u << 30; });
    refused("random:39: mesh 2 level 0", [](BakeSource& s) { s.meshes[2].levels[0].indices.pop_back(); });
    refused("random:39: mesh 1 level 0",
            [](BakeSource& s) { s.meshes[1].levels[0].positions[0].x = std::nanf(""); });
    refused("random:39: mesh 1 level 0", [](BakeSource& s) { s.meshes[1].levels[0].error = 1; });
    refused("random:39: mesh 0 has 0 levels", [](BakeSource& s) { s.meshes[0].levels.clear(); });
    refused("chunk size", [](BakeSource& s) { s.header.chunkSize = 0; });
    const auto withInstance = [](BakeSource& s, Instance instance, size_t names) {
        s.make = [=](ChunkKey) -> Result<SourceChunk> {
            SourceChunk chunk;
            chunk.instances.assign(1, instance);
            chunk.names.resize(names);
            return chunk;
        };
    };
    refused("chunk (-2,0,-2) instance 0", [&](BakeSource& s) { withInstance(s, {77, {}}, 0); });
    refused("chunk (-2,0,-2) instance 0", [&](BakeSource& s) {
        withInstance(s, {0, {glm::mat3(1), {0, 0, std::nan("")}}}, 0);
    });
    refused("2 names for 1 instances", [&](BakeSource& s) { withInstance(s, {}, 2); });
}

/// Every finding of `check` on a world whose rows are `damage`d after an honest bake.
class Check : public ::testing::Test {
protected:
    void SetUp() override {
        ASSERT_TRUE(bake(randomSource({.seed = 40}), folder_.file("w"), {}));
        const Result<WorldStore> world = WorldStore::open(folder_.file("w"));
        ASSERT_TRUE(world);
        const std::vector<BlobInfo> list = world.value().listBlobs().value();
        for (const BlobInfo& info : list) rows_[info.key] = world.value().readBlob(info.key).value();
        for (const ChunkRecord& record : world.value().chunks())
            if (!record.terrain.empty() && record.instances > 1) key_ = record.key;
    }
    /// `says` must be in exactly one finding that also names `row`.
    void finds(const std::string& row, const std::string& says,
               const std::map<BlobKey, std::vector<std::byte>>& rows) {
        Result<WorldWriter> writer = WorldWriter::create(folder_.file("d"));
        for (const auto& [key, bytes] : rows) ASSERT_TRUE(writer.value().put(key, bytes));
        ASSERT_TRUE(writer.value().finish());
        const Result<WorldStore> world = WorldStore::open(folder_.file("d"));
        ASSERT_TRUE(world) << world.error().what;
        int found = 0;
        std::string all;
        for (const Error& e : world.value().check()) {
            EXPECT_EQ(e.code, ErrorCode::kBadData);
            found += e.what.find(row) != std::string::npos && e.what.find(says) != std::string::npos;
            all += e.what + "\n";
        }
        EXPECT_EQ(found, 1) << row << ": " << says << "\n" << all;
    }
    template <class T, class Decode, class Encode>
    std::map<BlobKey, std::vector<std::byte>> with(const BlobKey& key, Decode decode, Encode encode,
                                                   const std::function<void(T&)>& damage) {
        auto rows = rows_;
        T value = decode(rows.at(key)).value();
        damage(value);
        rows[key] = encode(value);
        return rows;
    }
    auto withLevel(const BlobKey& key, const std::function<void(MeshLevel&)>& damage) {
        return with<MeshLevel>(key, decodeMeshLevel, encodeMeshLevel, damage);
    }
    auto withRecord(const std::function<void(ChunkRecord&)>& damage) {
        return with<std::vector<ChunkRecord>>(
            {.kind = BlobKind::kDirectory}, decodeDirectory,
            [](const std::vector<ChunkRecord>& r) { return encodeDirectory(r); },
            [&](std::vector<ChunkRecord>& records) {
                for (ChunkRecord& r : records)
                    if (r.key == key_) damage(r);
            });
    }

    TempFolder folder_;
    std::map<BlobKey, std::vector<std::byte>> rows_;
    ChunkKey key_;
};

TEST_F(Check, FindsWhatRowsSayWronglyOfEachOther) {
    const BlobKey mesh{0, 0, 0, 0, BlobKind::kMesh}, instances{key_.x, 0, key_.z, 0, BlobKind::kInstances},
        terrain{key_.x, 0, key_.z, 0, BlobKind::kTerrainMesh},
        levelSet{key_.x, 0, key_.z, 0, BlobKind::kLevelSet};
    const std::string chunk = toString(key_);
    finds("mesh 0 level 0", "cluster 0 leaves its bounds",
          withLevel(mesh, [](MeshLevel& l) { l.clusters[0].max.x -= 0.5f; }));
    finds("terrain mesh " + chunk + " level 0", "cluster 0 leaves its bounds",
          withLevel(terrain, [](MeshLevel& l) { l.clusters[0].min.y += 0.01f; }));
    finds("terrain mesh " + chunk + " level 0", "leaves the chunk's bounds",
          withLevel(terrain, [](MeshLevel& l) {
              l.positions[l.indices[0]].y = 5000;
              l.clusters[0].max.y = 5000;
          }));
    finds("terrain mesh " + chunk + " level 0", "says otherwise",
          withLevel(terrain, [](MeshLevel& l) { l.error = 1000; }));
    finds("mesh 0 level 0", "bounds are not those of the mesh table", withLevel(mesh, [](MeshLevel& l) {
              l.positions[l.indices[0]].y = 3;
              l.clusters[0].max.y = 3;
          }));
    finds("mesh 0 level 0", "mesh table says otherwise",
          withLevel(mesh, [](MeshLevel& l) { l.positions.emplace_back(0.0f); }));
    finds("mesh 0 level 0", "clusters cover", withLevel(mesh, [](MeshLevel& l) { l.clusters.clear(); }));

    const auto withRow = [&](const std::function<void(std::vector<Instance>&)>& damage) {
        return with<std::vector<Instance>>(instances, decodeInstances, encodeInstances, damage);
    };
    finds("instances " + chunk, "the directory says",
          withRow([](std::vector<Instance>& r) { r.pop_back(); }));
    finds("instances " + chunk, "uses mesh 999", withRow([](std::vector<Instance>& r) { r[0].mesh = 999; }));
    finds("terrain mesh " + chunk, "nothing in the world names this row",
          withRecord([](ChunkRecord& r) { r.terrain.pop_back(); }));
    finds("terrain mesh " + chunk, "the row is missing",
          withRecord([](ChunkRecord& r) { r.terrain.push_back(r.terrain.back()); }));
    finds("instances " + chunk, "leaves the chunk's bounds",
          withRow([](std::vector<Instance>& r) { r[0].placement.translation.y += 1000; }));

    finds("header", "leaves its bounds", withRecord([](ChunkRecord& r) { r.bounds.max.y += 1000; }));
    finds("instances " + chunk, "that no instance uses", withRow([](std::vector<Instance>& r) {
              for (Instance& i : r) i.mesh = r[0].mesh;
          }));
    const auto withNames = [&](const std::function<void(std::vector<NamedInstance>&)>& damage) {
        return with<std::vector<NamedInstance>>(
            {.kind = BlobKind::kNames}, decodeNames,
            [](const std::vector<NamedInstance>& n) { return encodeNames(n); }, damage);
    };
    finds("names", "'zzz' names no instance", withNames([&](auto& names) {
              names.push_back({"zzz", key_, 5000});
          }));
    finds("names", "'zzz' names no instance", withNames([](auto& names) {
              names.push_back({"zzz", {77, 7, 7}, 0});
          }));

    auto rows = rows_;
    rows[levelSet] = std::vector<std::byte>(10);
    finds("level set " + chunk, "", rows);
    rows = rows_;
    rows[{500, 0, 500, 0, BlobKind::kInstances}] = {};
    finds("instances (500,0,500)", "nothing in the world names this row", rows);
    rows = rows_;
    rows[{0, 0, 0, 0, static_cast<BlobKind>(42)}] = {};
    finds("unknown kind", "nothing in the world names this row", rows);
    rows = rows_;
    rows.erase(instances);
    finds("instances " + chunk, "the row is missing", rows);
    rows = rows_;
    rows.erase({.kind = BlobKind::kNames});
    finds("names", "the row is missing", rows);
}

}  // namespace
