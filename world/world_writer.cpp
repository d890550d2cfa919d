// world/world_writer.cpp — the writing half of world/store.h: a database beside the final name, locked
// against a second writer, renamed over it when it is whole and on the disk. While it is written it has a
// second table, of the steps that have ended.

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <optional>
#include <utility>

#include "world/blob.h"
#include "world/database.h"
#include "world/store.h"

namespace world {
namespace {

/// Stored bytes per transaction: bounds what a killed bake loses, and the write-ahead log, and with it the
/// disk that a bake needs beyond the world itself.
constexpr uint64_t kTransactionBytes = 8ull << 20;

/// The table of steps; its name says of which work. Ids ascend with the steps.
std::string stepTable(uint64_t work) {
    char name[32];
    std::snprintf(name, sizeof name, "step_%016llx", static_cast<unsigned long long>(work));
    return name;
}
std::string createSteps(uint64_t work) {
    return "CREATE TABLE " + stepTable(work) +
           "(id INTEGER PRIMARY KEY, record BLOB NOT NULL, names BLOB NOT NULL)";
}

Error ioError(const std::string& file, const char* remedy) {
    const int code = errno;
    return {ErrorCode::kIo, file + ": " + std::strerror(code) + ": " + remedy, code};
}

/// A file that this process alone may write: opened and locked. The lock goes with the process, so what a
/// killed bake left behind is taken over.
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
        wasEmpty_ = here.st_size == 0;
        return Done{};
    }
    bool taken() const { return fd_ >= 0; }
    bool wasEmpty() const { return wasEmpty_; }  ///< when it was taken
    bool empty() { return ::ftruncate(fd_, 0) == 0; }
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
    bool wasEmpty_ = true;
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
    Impl(const std::string& name, uint64_t ofWork)
        : path(name), baking(name + ".baking"), work(ofWork), file(baking) {}
    ~Impl() {
        close();
        if (!file.taken() || keep) return;
        removeJournals();
        if (!renamed) ::unlink(baking.c_str());
    }
    void close() {
        insert.reset();
        insertStep.reset();
        database.reset();
    }
    void removeJournals() {
        for (const char* suffix : {"-wal", "-shm", "-journal"}) ::unlink((baking + suffix).c_str());
    }

    Result<Done> open();
    Result<Done> begin();
    Result<bool> goOn();
    Result<Done> prepare();
    Error failed(Error error);

    std::string path, baking;
    uint64_t work;
    LockedFile file;
    std::optional<Database> database;
    std::optional<Statement> insert, insertStep;
    std::vector<Step> before;  ///< steps that ended before this writer came
    int64_t steps = 0;
    uint64_t uncommitted = 0;   ///< bytes
    bool anyCommitted = false;  ///< there are steps in the file
    bool startedOver = false, renamed = false;
    bool keep = false;  ///< the file stays for a writer that goes on
};

Result<Done> WorldWriter::Impl::open() {
    Result<Database> opened = Database::openEmpty(baking);
    if (!opened) return opened.error();
    database.emplace(std::move(opened.value()));
    return database->run("PRAGMA locking_mode=EXCLUSIVE; PRAGMA journal_mode=WAL; PRAGMA synchronous=FULL");
}

/// Starts from an empty file.
Result<Done> WorldWriter::Impl::begin() {
    close();
    removeJournals();
    if (!file.empty()) return ioError(baking, "check its permissions");
    const Result<Done> opened = open();
    if (!opened) return opened;
    return database->run("PRAGMA application_id=" + std::to_string(kApplicationId) +
                         "; PRAGMA user_version=" + std::to_string(kWorldVersion) + "; BEGIN; " + kBlobTable +
                         "; " + (work == 0 ? "" : createSteps(work)));
}

/// Takes the file as it was left; false if it is of another work, no database or one without any step yet.
/// An error is the disk's.
Result<bool> WorldWriter::Impl::goOn() {
    const auto unfit = [this](const Error& error) -> Result<bool> {
        startedOver = error.code == ErrorCode::kBadData;
        keep = !startedOver;
        return startedOver ? Result<bool>(false) : Result<bool>(error);
    };
    const Result<Done> opened = open();
    if (!opened) return unfit(opened.error());
    const Result<std::vector<std::string>> schema = database->schema();
    if (!schema) return unfit(schema.error());
    if (schema.value() != std::vector<std::string>{kBlobTable, createSteps(work)}) {
        startedOver = !schema.value().empty();
        return false;
    }
    Result<Statement> list =
        database->prepare(("SELECT record, names FROM " + stepTable(work) + " ORDER BY id").c_str());
    if (!list) return unfit(list.error());
    for (;;) {
        const Result<bool> row = list.value().step();
        if (!row) return unfit(row.error());
        if (!row.value()) break;
        const auto bytes = [&list](int column) {
            const std::span<const std::byte> all = list.value().bytes(column);
            return std::vector<std::byte>(all.begin(), all.end());
        };
        before.push_back({bytes(0), bytes(1)});
    }
    steps = static_cast<int64_t>(before.size());
    anyCommitted = steps > 0;
    const Result<Done> begun = database->run("BEGIN");
    if (!begun) return unfit(begun.error());
    return true;
}

Result<Done> WorldWriter::Impl::prepare() {
    Result<Statement> row = database->prepare("INSERT INTO blob VALUES(?,?,?,?,?,?,?,?,?)");
    if (!row) return row.error();
    insert.emplace(std::move(row.value()));
    if (work == 0) return Done{};
    Result<Statement> step = database->prepare(("INSERT INTO " + stepTable(work) + " VALUES(?,?,?)").c_str());
    if (!step) return step.error();
    insertStep.emplace(std::move(step.value()));
    return Done{};
}

/// Where it is the disk that failed, the steps in the file stay.
Error WorldWriter::Impl::failed(Error error) {
    keep = error.code == ErrorCode::kIo && anyCommitted;
    if (keep) error.what += "; the same bake then goes on from where it was";
    return error;
}

WorldWriter::WorldWriter(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
WorldWriter::WorldWriter(WorldWriter&&) noexcept = default;
WorldWriter& WorldWriter::operator=(WorldWriter&&) noexcept = default;
WorldWriter::~WorldWriter() = default;

Result<WorldWriter> WorldWriter::create(const std::string& path, uint64_t work) {
    std::error_code ignored;
    if (path.empty() || std::filesystem::is_directory(path, ignored))
        return Error{ErrorCode::kIo, "'" + path + "' is no file name: name the world file to write"};
    auto impl = std::make_unique<Impl>(path, work);
    const Result<Done> taken = impl->file.take();
    if (!taken) return taken.error();
    bool goesOn = false;
    if (work != 0 && !impl->file.wasEmpty()) {
        const Result<bool> fits = impl->goOn();
        if (!fits) return fits.error();
        goesOn = fits.value();
    }
    if (!goesOn) {
        const Result<Done> begun = impl->begin();
        if (!begun) return begun.error();
    }
    const Result<Done> prepared = impl->prepare();
    if (!prepared) return impl->failed(prepared.error());
    return WorldWriter(std::move(impl));
}

std::vector<WorldWriter::Step> WorldWriter::takeSteps() {
    CHECK(impl_);
    return std::exchange(impl_->before, {});
}

bool WorldWriter::startedOver() const {
    CHECK(impl_);
    return impl_->startedOver;
}

Result<Done> WorldWriter::put(const BlobKey& key, std::span<const std::byte> raw) {
    CHECK(impl_);
    const Result<PackedBlob> packed = packBlob(key, raw);
    if (!packed) return dead(packed.error());
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
    if (!inserted) return dead(inserted.error());
    impl_->uncommitted += blob.data.size();
    return Done{};
}

Result<Done> WorldWriter::endStep(const Step& step) {
    CHECK(impl_ && impl_->work != 0);
    Statement& insert = *impl_->insertStep;
    insert.bind(0, ++impl_->steps);
    insert.bind(1, step.record);
    insert.bind(2, step.names);
    const Result<bool> inserted = insert.step();
    insert.reset();
    if (!inserted) return dead(inserted.error());
    impl_->uncommitted += step.record.size() + step.names.size();
    if (impl_->uncommitted <= kTransactionBytes) return Done{};
    const Result<Done> committed = impl_->database->run("COMMIT; BEGIN");
    if (!committed) return dead(committed.error());
    impl_->uncommitted = 0;
    impl_->anyCommitted = true;
    return Done{};
}

Result<Done> WorldWriter::finish() {
    CHECK(impl_);
    const std::unique_ptr<Impl> impl = std::move(impl_);
    impl->insert.reset();
    impl->insertStep.reset();
    // Back to a rollback journal: a finished world is one file, readable where nothing can be written.
    const Result<Done> committed =
        impl->database->run((impl->work == 0 ? "" : "DROP TABLE " + stepTable(impl->work) + "; ") +
                            "COMMIT; PRAGMA wal_checkpoint(TRUNCATE); PRAGMA journal_mode=DELETE");
    if (!committed) return impl->failed(committed.error());
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

Error WorldWriter::dead(const Error& why) {
    Error error = impl_->failed(why);
    impl_.reset();
    return error;
}

}  // namespace world
