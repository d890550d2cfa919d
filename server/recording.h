// server/recording.h — what a session was asked and answered, message by message, as a file that replays it.
// Source: our own.
//
// A file is kRecordingMagic, then entries: a byte that says which kind, the message's length (u32), XXH3 of kind, length
// and message (u64), the message itself; little-endian. The first two are OpenSession and SessionOpened.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "world/result.h"

namespace server {

constexpr std::string_view kRecordingMagic = "gnomonrec1\n";
constexpr const char* kRecordingEnding = ".gnomonrec";
/// Longer messages are neither written nor read [bytes].
constexpr uint32_t kLongestMessage = 256u << 20;

enum class EntryKind : uint8_t {
    kRequest = 1,  ///< SessionRequest
    kReply = 2,    ///< SessionReply
};

/// Appends to a new file. What was added is the file's at once, whatever happens to the process; a power cut takes what
/// the system had not written yet. One thread at a time.
class RecordingWriter {
public:
    /// kIo names the file and why; an existing file is an error.
    static world::Result<RecordingWriter> create(const std::string& path);
    RecordingWriter(RecordingWriter&&) noexcept;
    RecordingWriter& operator=(RecordingWriter&&) noexcept;
    ~RecordingWriter();

    /// kIo, a full disk for one: the file then ends with the entry before, and the writer takes no more.
    world::Result<world::Done> add(EntryKind kind, std::string_view message);
    const std::string& path() const { return path_; }

private:
    RecordingWriter(int file, std::string path) : file_(file), path_(std::move(path)) {}
    int file_ = -1;
    std::string path_;
    uint64_t size_ = 0;  ///< of whole entries [bytes]
};

struct Entry {
    EntryKind kind = EntryKind::kRequest;
    std::string message;
};

/// Reads entries in order. One thread at a time.
class RecordingReader {
public:
    /// kNotFound, kIo, kBadData for a file that is no recording.
    static world::Result<RecordingReader> open(const std::string& path);
    RecordingReader(RecordingReader&&) noexcept;
    RecordingReader& operator=(RecordingReader&&) noexcept;
    ~RecordingReader();

    /// None at the end. An entry that is cut short at the end of the file is the end: `torn` then says so. kBadData for
    /// one whose checksum fails, naming its number: nothing behind it can be trusted.
    world::Result<std::optional<Entry>> next();
    bool torn() const { return torn_; }

private:
    RecordingReader(int file, std::string path) : file_(file), path_(std::move(path)) {}
    int file_ = -1;
    std::string path_;
    uint64_t entries_ = 0;
    bool torn_ = false;
};

}  // namespace server
