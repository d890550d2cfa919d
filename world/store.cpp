#include "world/store.h"

#include <sys/stat.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <mutex>
#include <optional>

#include "world/blob.h"
#include "world/codec.h"
#include "world/database.h"
#include "world/hash.h"
#include "world/mesh_bounds.h"

namespace world {
namespace {

/// Tells one file from another that took its name.
struct FileIdentity {
    dev_t device = 0;
    ino_t inode = 0;
    off_t bytes = 0;
    int64_t seconds = 0, nanoseconds = 0;  ///< of the last change
    friend bool operator==(const FileIdentity&, const FileIdentity&) = default;
};

std::optional<FileIdentity> identify(const std::string& path) {
    struct stat s {};
    if (::stat(path.c_str(), &s) != 0) return std::nullopt;
    return FileIdentity{s.st_dev, s.st_ino, s.st_size, s.st_mtim.tv_sec, s.st_mtim.tv_nsec};
}

Error bad(const std::string& path, const std::string& what) {
    return {ErrorCode::kBadData, path + ": " + what};
}

Error newer(const std::string& path, uint32_t version) {
    return bad(path, "was written by a newer Gnomon (version " + std::to_string(version) +
                         ", this one reads up to " + std::to_string(kWorldVersion) + "): update Gnomon");
}

/// Reads the file's first 100 bytes as SQLite defines them, before SQLite sees any of it: most files that
/// are not ours, or not whole, are told apart here, in words that fit.
/// Source: "Database File Format", sqlite.org, section 1.3.
Result<Done> screen(const std::string& path) {
    std::error_code problem;
    if (!std::filesystem::exists(path, problem)) return Error{ErrorCode::kNotFound, path + ": no such file; check the name"};
    if (!std::filesystem::is_regular_file(path, problem))
        return bad(path, "is not a file: name a world that 'bake' wrote");
    const uint64_t size = std::filesystem::file_size(path, problem);
    const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path.c_str(), "rb"), &std::fclose);
    if (!file) return Error{ErrorCode::kIo, path + ": cannot be read: check its permissions"};
    std::array<unsigned char, 100> head{};
    const size_t got = std::fread(head.data(), 1, head.size(), file.get());
    const auto at = [&head](size_t i) {
        return uint32_t{head[i]} << 24 | uint32_t{head[i + 1]} << 16 | uint32_t{head[i + 2]} << 8 |
               head[i + 3];
    };
    constexpr std::string_view kMagic("SQLite format 3\0", 16);
    if (got == 0) return bad(path, "is empty, not a world: bake it again");
    const size_t known = std::min(got, kMagic.size());
    if (std::string_view(reinterpret_cast<const char*>(head.data()), known) != kMagic.substr(0, known))
        return bad(path, "is not a world: name a file that 'bake' wrote");
    if (got < head.size()) return bad(path, "is truncated: copy or bake it again");
    if (at(68) != kApplicationId)
        return bad(path, "is a database, but not a world: name a file that 'bake' wrote");
    if (at(60) > kWorldVersion) return newer(path, at(60));
    if (at(60) < kWorldVersion)
        return bad(path, "is of version " + std::to_string(at(60)) + ", which this Gnomon does not read: bake it again");
    const uint32_t pageCode = uint32_t{head[16]} << 8 | head[17];
    const uint64_t whole = uint64_t{pageCode == 1 ? 65536 : pageCode} * at(28);
    if (size < whole)
        return bad(path, "is truncated, " + std::to_string(size) + " of " + std::to_string(whole) +
                             " bytes are there: copy or bake it again");
    if (size > whole)
        return bad(path, std::to_string(size - whole) + " bytes follow its end: copy or bake it again");
    return Done{};
}

/// One thread's connection.
struct Reader {
    Database database;
    Statement one, list;
};

Result<std::unique_ptr<Reader>> openReader(const std::string& path) {
    Result<Database> database = Database::openReadOnly(path);
    if (!database) return database.error();
    // Exactly our table: whatever else a file may bring (views, triggers, virtual tables) is never run.
    const Result<std::vector<std::string>> schema = database.value().schema();
    if (!schema) return schema.error();
    if (schema.value() != std::vector<std::string>{kBlobTable})
        return bad(path, "its tables are not those of a world: bake it again");
    Result<Statement> one = database.value().prepare(
        "SELECT codec, raw_size, checksum, data FROM blob WHERE x=? AND y=? AND z=? AND lod=? AND kind=?");
    if (!one) return one.error();
    Result<Statement> list = database.value().prepare(
        "SELECT x, y, z, lod, kind, raw_size, length(data) FROM blob ORDER BY x, y, z, lod, kind");
    if (!list) return list.error();
    return std::make_unique<Reader>(
        Reader{std::move(database.value()), std::move(one.value()), std::move(list.value())});
}

}  // namespace

const char* toString(BlobKind kind) {
    switch (kind) {
        case BlobKind::kHeader:
            return "header";
        case BlobKind::kDirectory:
            return "directory";
        case BlobKind::kMeshTable:
            return "mesh table";
        case BlobKind::kNames:
            return "names";
        case BlobKind::kMesh:
            return "mesh";
        case BlobKind::kInstances:
            return "instances";
        case BlobKind::kTerrainMesh:
            return "terrain mesh";
        case BlobKind::kLevelSet:
            return "level set";
    }
    return "unknown kind";
}

std::string toString(const BlobKey& key) {
    const std::string kind = toString(key.kind), lod = " level " + std::to_string(key.lod);
    const bool first = key.x == 0 && key.y == 0 && key.z == 0 && key.lod == 0;
    switch (key.kind) {
        case BlobKind::kHeader:
        case BlobKind::kDirectory:
        case BlobKind::kMeshTable:
        case BlobKind::kNames:
            if (first) return kind;
            break;
        case BlobKind::kMesh:
            if (key.y == 0 && key.z == 0) return kind + " " + std::to_string(key.x) + lod;
            break;
        default:
            break;
    }
    return kind + " " + toString(ChunkKey{key.x, key.y, key.z}) + lod;
}

struct WorldStore::Impl {
    std::string path;      ///< as the caller named it
    std::string absolute;  ///< what is opened, whatever becomes of the current folder
    FileIdentity identity;
    Header header;
    std::vector<ChunkRecord> chunks;
    std::vector<MeshRecord> meshes;
    std::mutex mutex;                           ///< guards `idle`
    std::vector<std::unique_ptr<Reader>> idle;  ///< as many as ever read at once

    Error fault(const BlobKey& key, const std::string& what) const {
        return bad(path, toString(key) + ": " + what + ": the file is damaged, copy or bake it again");
    }

    /// Runs `read(Reader&)` on a connection that no other thread has meanwhile.
    template <class T, class Read>
    Result<T> with(Read read) {
        std::unique_ptr<Reader> reader;
        {
            const std::lock_guard lock(mutex);
            if (!idle.empty()) {
                reader = std::move(idle.back());
                idle.pop_back();
            }
        }
        if (!reader) {
            Result<std::unique_ptr<Reader>> opened = openReader(absolute);
            // A world baked anew takes the name: never mix rows of the two.
            if (identify(absolute) != identity)
                return bad(path, "was replaced while it was open: open it again");
            if (!opened) return opened.error();
            reader = std::move(opened.value());
        }
        Result<T> result = read(*reader);
        const std::lock_guard lock(mutex);
        idle.push_back(std::move(reader));
        return result;
    }

    Result<std::vector<std::byte>> read(const BlobKey& key) {
        return with<std::vector<std::byte>>([&](Reader& reader) -> Result<std::vector<std::byte>> {
            Statement& one = reader.one;
            const int64_t fields[] = {key.x, key.y, key.z, key.lod, static_cast<int64_t>(key.kind)};
            for (int i = 0; i < 5; ++i) one.bind(i, fields[i]);
            const Result<bool> row = one.step();
            if (!row) return row.error();
            if (!row.value()) {
                one.reset();
                return Error{ErrorCode::kNotFound, path + ": " + toString(key) + ": there is no such row"};
            }
            Result<std::vector<std::byte>> raw = unpackBlob(
                key, one.integer(0), one.integer(1), static_cast<uint64_t>(one.integer(2)), one.bytes(3));
            one.reset();
            if (!raw) return fault(key, raw.error().what);
            return raw;
        });
    }

    /// A row that the world says it has, decoded.
    template <class T>
    Result<T> decoded(const BlobKey& key, Result<T> (*decode)(std::span<const std::byte>)) {
        const Result<std::vector<std::byte>> raw = read(key);
        if (!raw)
            return raw.error().code == ErrorCode::kNotFound ? fault(key, "the row is missing") : raw.error();
        Result<T> value = decode(raw.value());
        if (!value) return fault(key, value.error().what);
        return value;
    }
};

WorldStore::WorldStore(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
WorldStore::WorldStore(WorldStore&&) noexcept = default;
WorldStore& WorldStore::operator=(WorldStore&&) noexcept = default;
WorldStore::~WorldStore() = default;

Result<WorldStore> WorldStore::open(const std::string& path) {
    const Result<Done> screened = screen(path);
    if (!screened) return screened.error();
    auto impl = std::make_unique<Impl>();
    impl->path = path;
    impl->absolute = std::filesystem::absolute(path).string();
    const std::optional<FileIdentity> identity = identify(impl->absolute);
    if (!identity) return Error{ErrorCode::kNotFound, path + ": no such file; check the name"};
    impl->identity = *identity;

    const BlobKey headerKey{.kind = BlobKind::kHeader}, directoryKey{.kind = BlobKind::kDirectory},
        tableKey{.kind = BlobKind::kMeshTable};
    Result<Header> header = impl->decoded<Header>(headerKey, &decodeHeader);
    if (!header) return header.error();
    if (header.value().version > kWorldVersion) return newer(path, header.value().version);
    impl->header = std::move(header.value());
    Result<std::vector<MeshRecord>> meshes =
        impl->decoded<std::vector<MeshRecord>>(tableKey, &decodeMeshTable);
    if (!meshes) return meshes.error();
    impl->meshes = std::move(meshes.value());
    Result<std::vector<ChunkRecord>> chunks =
        impl->decoded<std::vector<ChunkRecord>>(directoryKey, &decodeDirectory);
    if (!chunks) return chunks.error();
    impl->chunks = std::move(chunks.value());
    for (const ChunkRecord& c : impl->chunks)
        if (!c.meshes.empty() && c.meshes.back() >= impl->meshes.size())
            return impl->fault(directoryKey, "chunk " + toString(c.key) + " uses mesh " +
                                                 std::to_string(c.meshes.back()) + " of " +
                                                 std::to_string(impl->meshes.size()));
    return WorldStore(std::move(impl));
}

const std::string& WorldStore::path() const { return impl_->path; }
const Header& WorldStore::header() const { return impl_->header; }
std::span<const ChunkRecord> WorldStore::chunks() const { return impl_->chunks; }
std::span<const MeshRecord> WorldStore::meshes() const { return impl_->meshes; }

Result<std::vector<NamedInstance>> WorldStore::names() const {
    return impl_->decoded<std::vector<NamedInstance>>({.kind = BlobKind::kNames}, &decodeNames);
}

Result<Chunk> WorldStore::readChunk(ChunkKey key, size_t firstLevel, const Chunk* base) const {
    const std::vector<ChunkRecord>& records = impl_->chunks;
    const auto record = std::lower_bound(records.begin(), records.end(), key,
                                         [](const ChunkRecord& r, ChunkKey k) { return r.key < k; });
    if (record == records.end() || record->key != key)
        return Error{ErrorCode::kNotFound,
                     impl_->path + ": chunk " + toString(key) + ": there is no such chunk"};

    Chunk chunk;
    chunk.key = key;
    chunk.firstLevel = std::min(firstLevel, record->terrain.size());
    size_t end = record->terrain.size();  // of the levels to read
    if (base) {
        CHECK(base->key == key && base->firstLevel >= chunk.firstLevel);
        chunk.instances = base->instances;
        end = base->firstLevel;
    } else {
        const BlobKey rowKey{key.x, key.y, key.z, 0, BlobKind::kInstances};
        Result<std::vector<Instance>> instances =
            impl_->decoded<std::vector<Instance>>(rowKey, &decodeInstances);
        if (!instances) return instances.error();
        chunk.instances = std::move(instances.value());
        // What the directory promised is what readers have made room for.
        if (chunk.instances.size() != record->instances)
            return impl_->fault(rowKey, std::to_string(chunk.instances.size()) +
                                            " instances, the directory says " +
                                            std::to_string(record->instances));
        for (const Instance& instance : chunk.instances)
            if (!std::binary_search(record->meshes.begin(), record->meshes.end(), instance.mesh))
                return impl_->fault(rowKey, "the directory does not say that it uses mesh " +
                                                std::to_string(instance.mesh));
    }
    for (size_t k = chunk.firstLevel; k < end; ++k) {
        const BlobKey levelKey{key.x, key.y, key.z, static_cast<int32_t>(k), BlobKind::kTerrainMesh};
        Result<MeshLevel> level = impl_->decoded<MeshLevel>(levelKey, &decodeMeshLevel);
        if (!level) return level.error();
        if (recordOf(level.value()) != record->terrain[k])
            return impl_->fault(levelKey, "the directory says otherwise of its size or error");
        chunk.terrain.levels.push_back(std::move(level.value()));
    }
    if (base)
        chunk.terrain.levels.insert(chunk.terrain.levels.end(), base->terrain.levels.begin(),
                                    base->terrain.levels.end());
    chunk.terrain.bounds = boundsOf(chunk.terrain);
    return chunk;
}

Result<Mesh> WorldStore::readMesh(uint32_t id) const {
    if (id >= impl_->meshes.size())
        return Error{ErrorCode::kNotFound,
                     impl_->path + ": mesh " + std::to_string(id) + ": there is no such mesh"};
    const MeshRecord& record = impl_->meshes[id];
    Mesh mesh;
    mesh.bounds = record.bounds;
    for (size_t k = 0; k < record.levels.size(); ++k) {
        const BlobKey key{static_cast<int32_t>(id), 0, 0, static_cast<int32_t>(k), BlobKind::kMesh};
        Result<MeshLevel> level = impl_->decoded<MeshLevel>(key, &decodeMeshLevel);
        if (!level) return level.error();
        if (recordOf(level.value()) != record.levels[k])
            return impl_->fault(key, "the mesh table says otherwise of its size or error");
        mesh.levels.push_back(std::move(level.value()));
    }
    return mesh;
}

Result<std::vector<std::byte>> WorldStore::readBlob(const BlobKey& key) const { return impl_->read(key); }

Result<std::vector<BlobInfo>> WorldStore::listBlobs() const {
    return impl_->with<std::vector<BlobInfo>>([this](Reader& reader) -> Result<std::vector<BlobInfo>> {
        std::vector<BlobInfo> blobs;
        for (;;) {
            const Result<bool> row = reader.list.step();
            if (!row) return row.error();
            if (!row.value()) break;
            std::array<int32_t, 5> key{};
            for (int i = 0; i < 5; ++i) {
                const int64_t v = reader.list.integer(i);
                if (v < std::numeric_limits<int32_t>::min() || v > std::numeric_limits<int32_t>::max()) {
                    reader.list.reset();
                    return bad(impl_->path,
                               "a row's key is out of range: the file is damaged, copy or bake it again");
                }
                key[static_cast<size_t>(i)] = static_cast<int32_t>(v);
            }
            const BlobKey blob{key[0], key[1], key[2], key[3], static_cast<BlobKind>(key[4])};
            // A damaged tree may lead to the same page again and again: keys that do not ascend end it.
            if (!blobs.empty() && !(blobs.back().key < blob)) {
                reader.list.reset();
                return impl_->fault(blob, "the row is out of order");
            }
            blobs.push_back({blob, static_cast<uint64_t>(std::max<int64_t>(0, reader.list.integer(5))),
                             static_cast<uint64_t>(std::max<int64_t>(0, reader.list.integer(6)))});
        }
        reader.list.reset();
        return blobs;
    });
}

Result<uint64_t> WorldStore::contentHash() const {
    const Result<std::vector<BlobInfo>> blobs = listBlobs();
    if (!blobs) return blobs.error();
    struct Row {
        uint64_t hash = 0;
        std::optional<Error> error;
    };
    std::vector<Row> rows(blobs.value().size());
    tbb::parallel_for(size_t{0}, rows.size(), [&](size_t i) {
        const Result<std::vector<std::byte>> raw = impl_->read(blobs.value()[i].key);
        if (raw)
            rows[i].hash = hashBytes(raw.value());
        else
            rows[i].error = raw.error();
    });
    uint64_t hash = 0;
    for (size_t i = 0; i < rows.size(); ++i) {
        if (rows[i].error) return *rows[i].error;
        const BlobKey& key = blobs.value()[i].key;
        const int64_t fields[] = {key.x, key.y, key.z, key.lod, static_cast<int64_t>(key.kind)};
        hash = hashValues(std::span<const int64_t>(fields), hash);
        hash = hashValues(std::span<const uint64_t>(&rows[i].hash, 1), hash);
    }
    return hash;
}

}  // namespace world
