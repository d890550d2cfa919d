#include "world/store.h"

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
#include "world/file_identity.h"
#include "world/hash.h"
#include "world/mesh_bounds.h"

namespace world {
namespace {

Error bad(const std::string& path, const std::string& what) {
    return {ErrorCode::kBadData, path + ": " + what};
}

Error newer(const std::string& path, uint32_t version) {
    return bad(path, "was written by a newer Gnomon (version " + std::to_string(version) +
                         ", this one reads up to " + std::to_string(kWorldVersion) + "): update Gnomon");
}

/// Whether the levels of `base` are the coarsest of the record: not where an edit came between.
bool isPartOf(const Chunk& base, const ChunkRecord& record) {
    const size_t levels = base.terrain.levels.size();
    if (base.firstLevel + levels != record.terrain.size()) return false;
    for (size_t k = 0; k < levels; ++k)
        if (recordOf(base.terrain.levels[k]) != record.terrain[base.firstLevel + k]) return false;
    return true;
}

/// A journal beside the file is of an edit that is being written, or was cut short: SQLite waits for the one and takes
/// back the other, if it may write.
Result<Done> takeBack(const std::string& path) {
    std::error_code problem;
    if (!std::filesystem::exists(path + "-journal", problem)) return Done{};
    Result<Database> database = Database::openEditable(path);
    const Result<Done> read = database ? database.value().run("SELECT 1 FROM sqlite_schema") : database.error();
    if (!read && read.error().code == ErrorCode::kIo) return read.error();
    return Done{};  // what else is wrong is found by those who read it
}

/// Reads the file's first 100 bytes as SQLite defines them, before SQLite sees any of it: most files that
/// are not ours, or not whole, are told apart here, in words that fit.
/// Source: "Database File Format", sqlite.org, section 1.3.
Result<Done> screen(const std::string& path) {
    std::error_code problem;
    if (!std::filesystem::exists(path, problem)) return Error{ErrorCode::kNotFound, path + ": no such file; check the name"};
    if (!std::filesystem::is_regular_file(path, problem))
        return bad(path, "is not a file: name a world that 'bake' wrote");
    Result<Database> opened = Database::openReadOnly(path);
    if (!opened) return Error{ErrorCode::kIo, path + ": cannot be read: check its permissions"};
    Database& database = opened.value();
    Result<FileHead> read = database.head();
    if (!read) return read.error();
    const auto& head = read.value().bytes;
    const auto at = [&head](size_t i) {
        return uint32_t{head[i]} << 24 | uint32_t{head[i + 1]} << 16 | uint32_t{head[i + 2]} << 8 |
               head[i + 3];
    };
    const uint64_t got = std::min<uint64_t>(read.value().size, head.size());
    constexpr std::string_view kMagic("SQLite format 3\0", 16);
    if (got == 0) return bad(path, "is empty, not a world: bake it again");
    const size_t known = std::min<size_t>(got, kMagic.size());
    if (std::string_view(reinterpret_cast<const char*>(head.data()), known) != kMagic.substr(0, known))
        return bad(path, "is not a world: name a file that 'bake' wrote");
    if (got < head.size()) return bad(path, "is truncated: copy or bake it again");
    if (at(68) != kApplicationId)
        return bad(path, "is a database, but not a world: name a file that 'bake' wrote");
    if (at(60) > kWorldVersion) return newer(path, at(60));
    if (at(60) < kWorldVersion)
        return bad(path, "is of version " + std::to_string(at(60)) + ", which this Gnomon does not read: bake it again");
    // Else SQLite would make files beside it.
    if (head[18] != 1 || head[19] != 1) return bad(path, "keeps another journal than worlds do: copy or bake it again");
    const uint32_t pageCode = uint32_t{head[16]} << 8 | head[17];
    const auto pages = [&] { return uint64_t{pageCode == 1 ? 65536 : pageCode} * at(28); };
    if (read.value().size != pages()) {
        // An edit may be at it: looked at again in a transaction, during which the file stays as it is.
        const Result<Done> held = database.run("BEGIN; SELECT 1 FROM sqlite_schema");
        read = database.head();
        if (!read) return held ? read.error() : held.error();
    }
    const uint64_t size = read.value().size, whole = pages();
    if (size < whole)
        return bad(path, "is truncated, " + std::to_string(size) + " of " + std::to_string(whole) +
                             " bytes are there: copy or bake it again");
    if (size > whole)
        return bad(path, std::to_string(size - whole) + " bytes follow its end: copy or bake it again");
    return Done{};
}

/// Index of a chunk's record, or the number of records.
size_t placeOf(std::span<const ChunkRecord> records, ChunkKey key) {
    const auto at = std::lower_bound(records.begin(), records.end(), key,
                                     [](const ChunkRecord& r, ChunkKey k) { return r.key < k; });
    return at == records.end() || at->key != key ? records.size() : static_cast<size_t>(at - records.begin());
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
        case BlobKind::kChunkRecord:
            return "chunk record";
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
        case BlobKind::kChunkRecord:
            if (key.x == kRecordX) return kind + " " + toString(ChunkKey{key.y, key.lod, key.z});
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

    Result<std::vector<std::byte>> read(Reader& reader, const BlobKey& key) const {
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
    }
    Result<std::vector<std::byte>> read(const BlobKey& key) {
        return with<std::vector<std::byte>>([&](Reader& reader) { return read(reader, key); });
    }

    /// A row that the world says it has, decoded.
    template <class T>
    Result<T> decoded(Reader& reader, const BlobKey& key, Result<T> (*decode)(std::span<const std::byte>)) const {
        const Result<std::vector<std::byte>> raw = read(reader, key);
        if (!raw)
            return raw.error().code == ErrorCode::kNotFound ? fault(key, "the row is missing") : raw.error();
        Result<T> value = decode(raw.value());
        if (!value) return fault(key, value.error().what);
        return value;
    }
    template <class T>
    Result<T> decoded(const BlobKey& key, Result<T> (*decode)(std::span<const std::byte>)) {
        return with<T>([&](Reader& reader) { return decoded(reader, key, decode); });
    }

    /// Runs `read(Reader&)` in one transaction: an edit comes before all of it or after.
    template <class T, class Read>
    Result<T> atOnce(Read read) {
        return with<T>([&](Reader& reader) -> Result<T> {
            if (const auto begun = reader.database.run("BEGIN"); !begun) return begun.error();
            Result<T> result = read(reader);
            // A failed statement may have ended it already.
            if (const auto ended = reader.database.run("COMMIT"); !ended && result) return ended.error();
            return result;
        });
    }
    Result<Done> open(Reader& reader);
    Result<ChunkRecord> ownRecord(Reader& reader, ChunkKey key) const;
    Result<Done> applyRecords(Reader& reader);
    Result<Chunk> readChunk(Reader& reader, const ChunkRecord& record, size_t firstLevel, const Chunk* base) const;
};

WorldStore::WorldStore(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
WorldStore::WorldStore(WorldStore&&) noexcept = default;
WorldStore& WorldStore::operator=(WorldStore&&) noexcept = default;
WorldStore::~WorldStore() = default;

/// An edited chunk's record; kNotFound for a chunk that was never edited.
Result<ChunkRecord> WorldStore::Impl::ownRecord(Reader& reader, ChunkKey key) const {
    const auto raw = read(reader, recordKey(key));
    if (!raw) return raw.error();
    Result<std::vector<ChunkRecord>> own = decodeDirectory(raw.value());
    if (!own) return fault(recordKey(key), own.error().what);
    if (own.value().size() != 1 || own.value()[0].key != key) return fault(recordKey(key), "it is of another chunk");
    return std::move(own.value()[0]);
}

/// Puts the records of edited chunks in place of the directory's.
Result<Done> WorldStore::Impl::applyRecords(Reader& reader) {
    Result<Statement> edited = reader.database.prepare("SELECT y, z, lod FROM blob WHERE x=? AND kind=?");
    if (!edited) return edited.error();
    edited.value().bind(0, kRecordX);
    edited.value().bind(1, static_cast<int64_t>(BlobKind::kChunkRecord));
    for (;;) {
        const Result<bool> row = edited.value().step();
        if (!row) return row.error();
        if (!row.value()) return Done{};
        const auto number = [&](int column) { return static_cast<int32_t>(edited.value().integer(column)); };
        const ChunkKey key{number(0), number(2), number(1)};
        const size_t at = placeOf(chunks, key);
        if (at == chunks.size()) return fault(recordKey(key), "there is no such chunk");
        Result<ChunkRecord> own = ownRecord(reader, key);
        if (!own) return own.error();
        chunks[at] = std::move(own.value());
    }
}

Result<Done> WorldStore::Impl::open(Reader& reader) {
    const BlobKey directoryKey{.kind = BlobKind::kDirectory};
    Result<Header> readHeader = decoded<Header>(reader, {.kind = BlobKind::kHeader}, &decodeHeader);
    if (!readHeader) return readHeader.error();
    if (readHeader.value().version > kWorldVersion) return newer(path, readHeader.value().version);
    header = std::move(readHeader.value());
    Result<std::vector<MeshRecord>> table =
        decoded<std::vector<MeshRecord>>(reader, {.kind = BlobKind::kMeshTable}, &decodeMeshTable);
    if (!table) return table.error();
    meshes = std::move(table.value());
    Result<std::vector<ChunkRecord>> directory =
        decoded<std::vector<ChunkRecord>>(reader, directoryKey, &decodeDirectory);
    if (!directory) return directory.error();
    chunks = std::move(directory.value());
    if (const auto applied = applyRecords(reader); !applied) return applied.error();
    for (const ChunkRecord& c : chunks)
        if (!c.meshes.empty() && c.meshes.back() >= meshes.size())
            return fault(directoryKey, "chunk " + toString(c.key) + " uses mesh " + std::to_string(c.meshes.back()) +
                                           " of " + std::to_string(meshes.size()));
    return Done{};
}

Result<WorldStore> WorldStore::open(const std::string& path) {
    if (const auto mended = takeBack(path); !mended) return mended.error();
    const Result<Done> screened = screen(path);
    if (!screened) return screened.error();
    auto impl = std::make_unique<Impl>();
    impl->path = path;
    impl->absolute = std::filesystem::absolute(path).string();
    const std::optional<FileIdentity> identity = identify(impl->absolute);
    if (!identity) return Error{ErrorCode::kNotFound, path + ": no such file; check the name"};
    impl->identity = *identity;
    Impl& world = *impl;
    const Result<Done> opened = world.atOnce<Done>([&](Reader& reader) { return world.open(reader); });
    if (!opened) return opened.error();
    return WorldStore(std::move(impl));
}

const std::string& WorldStore::path() const { return impl_->path; }
const Header& WorldStore::header() const { return impl_->header; }
std::span<const ChunkRecord> WorldStore::chunks() const { return impl_->chunks; }
std::span<const MeshRecord> WorldStore::meshes() const { return impl_->meshes; }

const ChunkRecord* WorldStore::find(ChunkKey key) const {
    const size_t at = placeOf(impl_->chunks, key);
    return at < impl_->chunks.size() ? &impl_->chunks[at] : nullptr;
}

Result<std::vector<NamedInstance>> WorldStore::names() const {
    return impl_->decoded<std::vector<NamedInstance>>({.kind = BlobKind::kNames}, &decodeNames);
}

Result<Chunk> WorldStore::Impl::readChunk(Reader& reader, const ChunkRecord& record, size_t firstLevel,
                                          const Chunk* base) const {
    const ChunkKey key = record.key;
    Chunk chunk;
    chunk.key = key;
    chunk.firstLevel = std::min(firstLevel, record.terrain.size());
    size_t end = record.terrain.size();  // of the levels to read
    if (base && isPartOf(*base, record)) {
        CHECK(base->key == key && base->firstLevel >= chunk.firstLevel);
        chunk.instances = base->instances;
        end = base->firstLevel;
    } else {
        const BlobKey rowKey{key.x, key.y, key.z, 0, BlobKind::kInstances};
        Result<std::vector<Instance>> instances =
            decoded<std::vector<Instance>>(reader, rowKey, &decodeInstances);
        if (!instances) return instances.error();
        chunk.instances = std::move(instances.value());
        // What the directory promised is what readers have made room for.
        if (chunk.instances.size() != record.instances)
            return fault(rowKey, std::to_string(chunk.instances.size()) + " instances, the directory says " +
                                     std::to_string(record.instances));
        for (const Instance& instance : chunk.instances)
            if (!std::binary_search(record.meshes.begin(), record.meshes.end(), instance.mesh))
                return fault(rowKey, "the directory does not say that it uses mesh " +
                                         std::to_string(instance.mesh));
    }
    for (size_t k = chunk.firstLevel; k < end; ++k) {
        const BlobKey levelKey{key.x, key.y, key.z, static_cast<int32_t>(k), BlobKind::kTerrainMesh};
        Result<MeshLevel> level = decoded<MeshLevel>(reader, levelKey, &decodeMeshLevel);
        if (!level) return level.error();
        if (recordOf(level.value()) != record.terrain[k])
            return fault(levelKey, "the directory says otherwise of its size or error");
        chunk.terrain.levels.push_back(std::move(level.value()));
    }
    if (end < record.terrain.size())
        chunk.terrain.levels.insert(chunk.terrain.levels.end(), base->terrain.levels.begin(),
                                    base->terrain.levels.end());
    chunk.terrain.bounds = boundsOf(chunk.terrain);
    return chunk;
}

Result<Chunk> WorldStore::readChunk(ChunkKey key, size_t firstLevel, const Chunk* base) const {
    const ChunkRecord* record = find(key);
    if (!record)
        return Error{ErrorCode::kNotFound,
                     impl_->path + ": chunk " + toString(key) + ": there is no such chunk"};
    return impl_->atOnce<Chunk>([&](Reader& reader) -> Result<Chunk> {
        // It may have been edited since the world was opened.
        const Result<ChunkRecord> own = impl_->ownRecord(reader, key);
        if (!own && own.error().code != ErrorCode::kNotFound) return own.error();
        return impl_->readChunk(reader, own ? own.value() : *record, firstLevel, base);
    });
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
