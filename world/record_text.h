// world/record_text.h — the text that recorded motion is kept in: lines, finite numbers, unit
// quaternions, and files that are written whole or not at all.
#pragma once

#include <cstddef>
#include <fstream>
#include <glm/glm.hpp>
#include <glm/gtc/quaternion.hpp>
#include <optional>
#include <string>
#include <string_view>

#include "world/result.h"

namespace world {

/// Streams a text file line by line, and names file and line in its errors. One thread at a time.
class RecordLines {
public:
    /// kNotFound, or kIo where the file cannot be opened.
    static Result<RecordLines> open(const std::string& path);

    /// The next line without its end (LF or CRLF) and without a byte order mark; valid until the next
    /// call. False at the end of the file. kBadData for a line above 64 KiB, kIo if reading fails.
    Result<bool> next(std::string_view& line);

    /// kBadData "file:line: what", for the line that `next` gave last (1 before it gave any).
    Error error(const std::string& what) const;

private:
    RecordLines(std::string path, std::ifstream in);
    std::string path_;
    std::ifstream in_;
    std::string buffer_;
    size_t number_ = 0;
};

/// `text` without spaces and tabs at its ends.
std::string_view trimmed(std::string_view text);

/// The finite number that is all of `text`, in decimal or scientific notation; nothing otherwise.
std::optional<double> finiteNumber(std::string_view text);

/// Makes a quaternion within 1e-3 of unit length unit; nothing for any other. A unit one stays as it
/// is in every bit, so that what was written reads back the same.
std::optional<glm::dquat> unitQuaternion(double x, double y, double z, double w);

/// Appends the shortest decimal that reads back as `value`, which is finite.
void appendNumber(std::string& text, double value);

/// Writes `text` to `path` through a file beside it: a reader meets the old file or the new one. kIo.
Result<Done> writeRecord(const std::string& path, std::string_view text);

}  // namespace world
