#include "server/recording.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <span>
#include <utility>

#include "world/bytes.h"
#include "world/hash.h"

namespace server {

using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

namespace {

constexpr size_t kHeadBytes = 1 + 4 + 8;

Error ioError(const std::string& path, int number) {
    return {number == ENOENT ? ErrorCode::kNotFound : ErrorCode::kIo, path + ": " + std::strerror(number), number};
}

std::span<const std::byte> bytesOf(std::string_view text) { return std::as_bytes(std::span(text.data(), text.size())); }

uint64_t checksum(EntryKind kind, std::string_view message) {
    world::ByteWriter head;
    head.u8(uint8_t(kind));
    head.u32(uint32_t(message.size()));
    return world::hashBytes(bytesOf(message), world::hashBytes(head.take()));
}

/// Bytes read, fewer only at the end of the file; -1 with errno.
ssize_t readAll(int file, char* to, size_t bytes) {
    size_t got = 0;
    while (got < bytes) {
        const ssize_t n = ::read(file, to + got, bytes - got);
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) return -1;
        if (n == 0) break;
        got += size_t(n);
    }
    return ssize_t(got);
}

bool writeAll(int file, std::string_view bytes) {
    while (!bytes.empty()) {
        const ssize_t n = ::write(file, bytes.data(), bytes.size());
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) return false;
        bytes.remove_prefix(size_t(n));
    }
    return true;
}

}  // namespace

Result<RecordingWriter> RecordingWriter::create(const std::string& path) {
    const int file = ::open(path.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, 0600);
    if (file < 0) return ioError(path, errno);
    RecordingWriter writer(file, path);
    if (!writeAll(file, kRecordingMagic)) return ioError(path, errno);
    writer.size_ = kRecordingMagic.size();
    return writer;
}

RecordingWriter::RecordingWriter(RecordingWriter&& o) noexcept
    : file_(std::exchange(o.file_, -1)), path_(std::move(o.path_)), size_(o.size_) {}

RecordingWriter& RecordingWriter::operator=(RecordingWriter&& o) noexcept {
    std::swap(file_, o.file_);
    std::swap(path_, o.path_);
    std::swap(size_, o.size_);
    return *this;
}

RecordingWriter::~RecordingWriter() {
    if (file_ >= 0) ::close(file_);
}

Result<Done> RecordingWriter::add(EntryKind kind, std::string_view message) {
    if (file_ < 0) return Error{ErrorCode::kIo, path_ + ": the recording ended with an error"};
    if (message.size() > kLongestMessage) return Error{ErrorCode::kLimit, path_ + ": a message of more than 256 MiB"};
    world::ByteWriter head;
    head.u8(uint8_t(kind));
    head.u32(uint32_t(message.size()));
    head.u64(checksum(kind, message));
    const std::vector<std::byte> bytes = head.take();
    std::string entry(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    entry.append(message);  // one call of the system's
    if (writeAll(file_, entry)) {
        size_ += entry.size();
        return Done{};
    }
    const Error error = ioError(path_, errno);
    // If the torn entry cannot be cut off either, the reader does.
    [[maybe_unused]] const int cut = ::ftruncate(file_, off_t(size_));
    ::close(std::exchange(file_, -1));
    return error;
}

Result<RecordingReader> RecordingReader::open(const std::string& path) {
    const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
    if (file < 0) return ioError(path, errno);
    RecordingReader reader(file, path);
    char magic[kRecordingMagic.size()];
    const ssize_t got = readAll(file, magic, sizeof magic);
    if (got < 0) return ioError(path, errno);
    if (std::string_view(magic, size_t(got)) != kRecordingMagic)
        return Error{ErrorCode::kBadData, path + ": no recording of a session, or one of another version"};
    return reader;
}

RecordingReader::RecordingReader(RecordingReader&& o) noexcept
    : file_(std::exchange(o.file_, -1)), path_(std::move(o.path_)), entries_(o.entries_), torn_(o.torn_) {}

RecordingReader& RecordingReader::operator=(RecordingReader&& o) noexcept {
    std::swap(file_, o.file_);
    std::swap(path_, o.path_);
    std::swap(entries_, o.entries_);
    std::swap(torn_, o.torn_);
    return *this;
}

RecordingReader::~RecordingReader() {
    if (file_ >= 0) ::close(file_);
}

Result<std::optional<Entry>> RecordingReader::next() {
    if (torn_) return std::optional<Entry>{};
    const auto bad = [this](const std::string& why) {
        return Error{ErrorCode::kBadData, path_ + ": entry " + std::to_string(entries_) + ": " + why};
    };
    char head[kHeadBytes];
    const ssize_t got = readAll(file_, head, sizeof head);
    if (got < 0) return ioError(path_, errno);
    if (got == 0) return std::optional<Entry>{};
    torn_ = size_t(got) < sizeof head;
    if (torn_) return std::optional<Entry>{};
    uint32_t length;
    uint64_t sum;
    std::memcpy(&length, head + 1, sizeof length);
    std::memcpy(&sum, head + 5, sizeof sum);
    Entry entry{EntryKind(head[0]), {}};
    if (entry.kind != EntryKind::kRequest && entry.kind != EntryKind::kReply) return bad("neither a request nor a reply");
    if (length > kLongestMessage) return bad("a message of more than 256 MiB");
    // A length is believed only as far as there are bytes: read in pieces.
    constexpr size_t kPiece = 1 << 20;
    while (entry.message.size() < length) {
        const size_t at = entry.message.size(), piece = std::min(kPiece, length - at);
        entry.message.resize(at + piece);
        const ssize_t n = readAll(file_, entry.message.data() + at, piece);
        if (n < 0) return ioError(path_, errno);
        torn_ = size_t(n) < piece;
        if (torn_) return std::optional<Entry>{};
    }
    if (checksum(entry.kind, entry.message) != sum) return bad("its checksum fails");
    ++entries_;
    return std::optional<Entry>(std::move(entry));
}

}  // namespace server
