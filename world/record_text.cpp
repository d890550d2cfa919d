// world/record_text.cpp — numbers go through from_chars and to_chars: exact, and blind to the locale.

#include "world/record_text.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <utility>

namespace world {
namespace {

constexpr std::streamsize kLongestLine = 64 * 1024;  // far above any row; a binary file ends here

}  // namespace

RecordLines::RecordLines(std::string path, std::ifstream in)
    : path_(std::move(path)), in_(std::move(in)), buffer_(static_cast<size_t>(kLongestLine), '\0') {}

Result<RecordLines> RecordLines::open(const std::string& path) {
    std::error_code failed;
    if (!std::filesystem::exists(path, failed)) return Error{ErrorCode::kNotFound, path + ": no such file; check the name"};
    if (std::filesystem::is_directory(path, failed))
        return Error{ErrorCode::kBadData, path + ": is a folder"};
    std::ifstream in(path, std::ios::binary);
    if (!in) return Error{ErrorCode::kIo, path + ": " + std::strerror(errno), errno};
    return RecordLines(path, std::move(in));
}

Result<bool> RecordLines::next(std::string_view& line) {
    in_.getline(buffer_.data(), kLongestLine);
    if (in_.bad())
        return Error{ErrorCode::kIo, path_ + ": reading failed after line " + std::to_string(number_)};
    if (in_.fail() && in_.gcount() == 0) return false;
    ++number_;
    if (in_.fail()) return error("longer than 64 KiB; is this a text file?");
    // The count holds the line's end where there was one.
    size_t size = static_cast<size_t>(in_.gcount());
    if (!in_.eof()) --size;
    line = std::string_view(buffer_).substr(0, size);
    if (line.ends_with('\r')) line.remove_suffix(1);
    if (number_ == 1 && line.starts_with("\xef\xbb\xbf")) line.remove_prefix(3);
    return true;
}

Error RecordLines::error(const std::string& what) const {
    return {ErrorCode::kBadData, path_ + ":" + std::to_string(std::max<size_t>(number_, 1)) + ": " + what};
}

std::string_view trimmed(std::string_view text) {
    const size_t first = text.find_first_not_of(" \t");
    if (first == std::string_view::npos) return {};
    return text.substr(first, text.find_last_not_of(" \t") - first + 1);
}

std::optional<double> finiteNumber(std::string_view text) {
    if (text.starts_with('+') && !text.starts_with("+-")) text.remove_prefix(1);
    double value = 0;
    const char* end = text.data() + text.size();
    const auto [stop, error] = std::from_chars(text.data(), end, value);
    if (error != std::errc() || stop != end || !std::isfinite(value)) return std::nullopt;
    return value;
}

std::optional<glm::dquat> unitQuaternion(double x, double y, double z, double w) {
    constexpr double kTolerance = 1e-3;  // recordings round to 5 digits and more
    constexpr double kRounding = 1e-15;  // what is left of a length after dividing by it: 4 units
    const double length = std::sqrt(x * x + y * y + z * z + w * w);
    if (!(std::abs(length - 1) <= kTolerance)) return std::nullopt;
    if (std::abs(length - 1) <= kRounding) return glm::dquat(w, x, y, z);
    return glm::dquat(w / length, x / length, y / length, z / length);
}

void appendNumber(std::string& text, double value) {
    std::array<char, 32> digits;
    const auto [end, error] = std::to_chars(digits.data(), digits.data() + digits.size(), value);
    CHECK(error == std::errc());
    text.append(digits.data(), end);
}

Result<Done> writeRecord(const std::string& path, std::string_view text) {
    const std::string part = path + ".part";
    std::error_code ignored;
    {
        std::ofstream out(part, std::ios::binary | std::ios::trunc);
        if (!out) return Error{ErrorCode::kIo, path + ": cannot be written: " + std::strerror(errno), errno};
        out.write(text.data(), static_cast<std::streamsize>(text.size()));
        out.close();
        if (!out) {
            const int reason = errno;
            std::filesystem::remove(part, ignored);
            return Error{ErrorCode::kIo, path + ": writing failed: " + std::strerror(reason), reason};
        }
    }
    std::error_code failed;
    std::filesystem::rename(part, path, failed);
    if (failed) {
        std::filesystem::remove(part, ignored);
        return Error{ErrorCode::kIo, path + ": cannot be replaced: " + failed.message(), failed.value()};
    }
    return Done{};
}

}  // namespace world
