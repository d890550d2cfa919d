// world/world_writer.cpp — the writing half of world/store.h: a database beside the final name, locked
// against a second writer, renamed over it when it is whole and on the disk.

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <optional>

#include "world/blob.h"
#include "world/database.h"
#include "world/store.h"

namespace world {
namespace {

/// Stored bytes per transaction: bounds the write-ahead log, and with it the disk that a bake needs
/// beyond the world itself.
constexpr uint64_t kTransactionBytes = 32ull << 20;

Error ioError(const std::string& file, const char* remedy) {
    const int code = errno;
    return {ErrorCode::kIo, file + ": " + std::strerror(code) + ": " + remedy, code};
}

/// A file that this process alone may write: opened, locked and emptied. The lock goes with the process,
/// so what a killed bake left behind is taken over.
class LockedFile {
public:
    explicit LockedFile(std::string path) : path_(std::move(path)) {}
    LockedFile(const LockedFile&) = delete;
    LockedFile& operator=(const LockedFile&) = delete;
    ~LockedFile() {
        if (fd_ >= 0) ::close(fd_);
    }

    Result<Done> take() {
        fd_ = ::open(path_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0666);
        if (fd_ < 0) return ioError(path_, "the folder must exist and be writable");
        struct stat here {
        }, there{};
        const bool locked = ::flock(fd_, LOCK_EX | LOCK_NB) == 0;
        if (!locked && errno != EWOULDBLOCK)
            return giveUp(ioError(path_, "this disk knows no locks: choose another"));
        // The owner may have renamed the file between our open and our lock: then the lock is on its world.
        const bool mine = locked && ::fstat(fd_, &here) == 0 && ::stat(path_.c_str(), &there) == 0 &&
                          here.st_ino == there.st_ino && here.st_dev == there.st_dev;
        if (!mine)
            return giveUp(
                {ErrorCode::kIo, path_ + ": another bake is writing it: wait for its end, then bake again"});
        if (::ftruncate(fd_, 0) != 0) return giveUp(ioError(path_, "check its permissions"));
        return Done{};
    }
    bool taken() const { return fd_ >= 0; }
    bool sync() { return ::fsync(fd_) == 0; }

private:
    /// Not ours: the file must stay as it is.
    Error giveUp(Error error) {
        ::close(fd_);
        fd_ = -1;
        return error;
    }
    std::string path_;
    int fd_ = -1;
};

bool syncFolder(const std::filesystem::path& folder) {
    const int fd = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd < 0) return false;
    const bool synced = ::fsync(fd) == 0;
    ::close(fd);
    return synced;
}

}  // namespace

struct WorldWriter::Impl {
    explicit Impl(const std::string& name) : path(name), baking(name + ".baking"), file(baking) {}
    ~Impl() {
        insert.reset();
        database.reset();
        if (!file.taken()) return;
        removeJournals();
        if (!renamed) ::unlink(baking.c_str());
    }
    void removeJournals() {
        for (const char* suffix : {"-wal", "-shm", "-journal"}) ::unlink((baking + suffix).c_str());
    }

    std::string path, baking;
    LockedFile file;
    std::optional<Database> database;
    std::optional<Statement> insert;
    uint64_t uncommitted = 0;
    bool renamed = false;
};

WorldWriter::WorldWriter(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
WorldWriter::WorldWriter(WorldWriter&&) noexcept = default;
WorldWriter& WorldWriter::operator=(WorldWriter&&) noexcept = default;
WorldWriter::~WorldWriter() = default;

Result<WorldWriter> WorldWriter::create(const std::string& path) {
    std::error_code ignored;
    if (path.empty() || std::filesystem::is_directory(path, ignored))
        return Error{ErrorCode::kIo, "'" + path + "' is no file name: name the world file to write"};
    auto impl = std::make_unique<Impl>(path);
    const Result<Done> taken = impl->file.take();
    if (!taken) return taken.error();
    impl->removeJournals();

    Result<Database> database = Database::openEmpty(impl->baking);
    if (!database) return database.error();
    impl->database.emplace(std::move(database.value()));
    const Result<Done> made = impl->database->run(
        "PRAGMA locking_mode=EXCLUSIVE; PRAGMA journal_mode=WAL; PRAGMA synchronous=FULL; "
        "PRAGMA application_id=" +
        std::to_string(kApplicationId) +
        "; "
        "PRAGMA user_version=" +
        std::to_string(kWorldVersion) + "; " + kBlobTable + "; BEGIN");
    if (!made) return made.error();
    Result<Statement> insert = impl->database->prepare("INSERT INTO blob VALUES(?,?,?,?,?,?,?,?,?)");
    if (!insert) return insert.error();
    impl->insert.emplace(std::move(insert.value()));
    return WorldWriter(std::move(impl));
}

Result<Done> WorldWriter::put(const BlobKey& key, std::span<const std::byte> raw) {
    CHECK(impl_);
    const Result<PackedBlob> packed = packBlob(key, raw);
    if (!packed) {
        Error error = packed.error();
        impl_.reset();
        return error;
    }
    const PackedBlob& blob = packed.value();
    Statement& insert = *impl_->insert;
    const int64_t fields[] = {key.x,
                              key.y,
                              key.z,
                              key.lod,
                              static_cast<int64_t>(key.kind),
                              static_cast<int64_t>(blob.codec),
                              static_cast<int64_t>(blob.rawSize),
                              static_cast<int64_t>(blob.checksum)};
    for (int i = 0; i < 8; ++i) insert.bind(i, fields[i]);
    insert.bind(8, blob.data);
    const Result<bool> inserted = insert.step();
    insert.reset();
    Result<Done> done = inserted ? Result<Done>(Done{}) : Result<Done>(inserted.error());
    impl_->uncommitted += blob.data.size();
    if (done && impl_->uncommitted > kTransactionBytes) {
        impl_->uncommitted = 0;
        done = impl_->database->run("COMMIT; BEGIN");
    }
    if (!done) impl_.reset();
    return done;
}

Result<Done> WorldWriter::finish() {
    CHECK(impl_);
    const std::unique_ptr<Impl> impl = std::move(impl_);
    impl->insert.reset();
    // Back to a rollback journal: a finished world is one file, readable where nothing can be written.
    const Result<Done> committed =
        impl->database->run("COMMIT; PRAGMA wal_checkpoint(TRUNCATE); PRAGMA journal_mode=DELETE");
    if (!committed) return committed.error();
    if (::access((impl->baking + "-wal").c_str(), F_OK) == 0)
        return Error{ErrorCode::kIo, impl->baking + ": its journal does not close: check the disk"};
    impl->database.reset();
    if (!impl->file.sync()) return ioError(impl->baking, "check the disk");
    if (std::rename(impl->baking.c_str(), impl->path.c_str()) != 0)
        return ioError(impl->path, "check its permissions");
    impl->renamed = true;
    if (!syncFolder(std::filesystem::absolute(impl->path).parent_path()))
        return ioError(impl->path, "check the disk");
    return Done{};
}

}  // namespace world
