// world/world_editor.cpp — see world_editor.h. A rollback journal rather than a write-ahead log: between edits the
// world is one file, which can be copied and read where nothing can be written.
#include "world/world_editor.h"

#include <filesystem>
#include <optional>
#include <vector>

#include "world/blob.h"
#include "world/codec.h"
#include "world/database.h"
#include "world/file_identity.h"
#include "world/store.h"

namespace world {

struct WorldEditor::Impl {
    std::string path;      ///< as the caller named it
    std::string absolute;  ///< whatever becomes of the current folder
    FileIdentity identity;
    Header header;
    std::optional<Database> database;
    std::optional<Statement> put, drop;
    bool locked = false;  ///< in a transaction, begun: nobody else edits the file

    Result<Done> begin() {
        const Result<Done> begun = database->run("BEGIN IMMEDIATE");
        if (begun) return begun;
        return Error{ErrorCode::kIo, path + ": cannot be edited: it is read-only, or another editor has it",
                     begun.error().native};
    }
    Result<Done> open();
    Error replaced() const { return {ErrorCode::kIo, path + ": was replaced while it was edited: open it again"}; }
    Result<Done> write(const BlobKey& key, std::span<const std::byte> raw);
    Result<Done> write(const ChangedChunk& chunk);
    Result<Done> writeAll(std::span<const ChangedChunk> chunks);
};

WorldEditor::WorldEditor(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
WorldEditor::WorldEditor(WorldEditor&&) noexcept = default;
WorldEditor& WorldEditor::operator=(WorldEditor&&) noexcept = default;
WorldEditor::~WorldEditor() = default;

Result<Done> WorldEditor::Impl::open() {
    const std::optional<FileIdentity> before = identify(absolute);
    Result<Database> opened = Database::openEditable(absolute);
    if (!opened) return opened.error();
    if (!before || identify(absolute) != before) return replaced();
    identity = *before;
    database.emplace(std::move(opened.value()));
    // From here on nobody else changes the file. The lock is kept between edits; readers do not mind it.
    database->waitAtMost(0);
    if (const Result<Done> begun = begin(); !begun) return begun;
    locked = true;
    database->waitAtMost(kPatienceMs);

    const auto prepare = [this](std::optional<Statement>& statement, const char* sql) -> Result<Done> {
        Result<Statement> prepared = database->prepare(sql);
        if (!prepared) return prepared.error();
        statement.emplace(std::move(prepared.value()));
        return Done{};
    };
    const Result<Done> ready = prepare(put, "INSERT OR REPLACE INTO blob VALUES(?,?,?,?,?,?,?,?,?)");
    if (!ready) return ready;
    return prepare(drop, "DELETE FROM blob WHERE x=? AND y=? AND z=? AND lod>=? AND kind=?");
}

Result<WorldEditor> WorldEditor::open(const std::string& path) {
    auto impl = std::make_unique<Impl>();
    impl->path = path;
    impl->absolute = std::filesystem::absolute(path).string();
    const Result<Done> opened = impl->open();
    const Result<WorldStore> world = WorldStore::open(path);
    if (!world) return world.error();  // says it better
    if (!opened) return opened.error();
    impl->header = world.value().header();
    return WorldEditor(std::move(impl));
}

namespace {

void bindKey(Statement& statement, const BlobKey& key) {
    const int64_t fields[] = {key.x, key.y, key.z, key.lod, static_cast<int64_t>(key.kind)};
    for (int i = 0; i < 5; ++i) statement.bind(i, fields[i]);
}

Result<Done> finished(Statement& statement) {
    const Result<bool> done = statement.step();
    statement.reset();
    if (!done) return done.error();
    return Done{};
}

}  // namespace

Result<Done> WorldEditor::Impl::write(const BlobKey& key, std::span<const std::byte> raw) {
    const Result<PackedBlob> packed = packBlob(key, raw);
    if (!packed) return packed.error();
    const PackedBlob& blob = packed.value();
    bindKey(*put, key);
    put->bind(5, static_cast<int64_t>(blob.codec));
    put->bind(6, static_cast<int64_t>(blob.rawSize));
    put->bind(7, static_cast<int64_t>(blob.checksum));
    put->bind(8, blob.data);
    return finished(*put);
}

Result<Done> WorldEditor::Impl::write(const ChangedChunk& chunk) {
    const ChunkKey at = chunk.record.key;
    const auto levels = static_cast<uint32_t>(chunk.terrain.levels.size());
    const auto row = [at](BlobKind kind, size_t lod) {
        return BlobKey{at.x, at.y, at.z, static_cast<int32_t>(lod), kind};
    };
    Result<Done> done = write(row(BlobKind::kLevelSet, 0), chunk.set);
    for (size_t k = 0; done && k < levels; ++k)
        done = write(row(BlobKind::kTerrainMesh, k), encodeMeshLevel(chunk.terrain.levels[k]));
    if (!done) return done;
    bindKey(*drop, row(BlobKind::kTerrainMesh, levels));
    done = finished(*drop);
    if (!done) return done;
    return write(recordKey(at), encodeDirectory(std::span(&chunk.record, 1)));
}

Result<Done> WorldEditor::Impl::writeAll(std::span<const ChangedChunk> chunks) {
    if (identify(absolute) != identity) return replaced();
    Header grown = header;
    for (const ChangedChunk& chunk : chunks) {
        grown.bounds.add(chunk.record.bounds);
        if (const Result<Done> written = write(chunk); !written) return written;
    }
    if (grown.bounds != header.bounds)
        if (const Result<Done> written = write({.kind = BlobKind::kHeader}, encodeHeader(grown)); !written)
            return written;
    const Result<Done> committed = database->run("COMMIT");
    if (committed) header = std::move(grown);
    return committed;
}

Result<Done> WorldEditor::commit(std::span<const ChangedChunk> chunks) {
    Impl& s = *impl_;
    if (!s.locked)
        if (const Result<Done> begun = s.begin(); !begun) return begun;
    const Result<Done> written = s.writeAll(chunks);
    // Some errors have ended the transaction already.
    if (!written) (void)s.database->run("ROLLBACK");
    s.locked = bool(s.begin());
    return written;
}

}  // namespace world
