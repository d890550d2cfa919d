#include "world/bytes.h"

#include <limits>

namespace world {

void ByteWriter::box(const Box& v) {
    u8(v.empty() ? 1 : 0);
    if (v.empty()) return;
    dvec3(v.min);
    dvec3(v.max);
}

void ByteWriter::string(std::string_view v) {
    CHECK(v.size() <= std::numeric_limits<uint32_t>::max());
    u32(static_cast<uint32_t>(v.size()));
    const size_t at = bytes_.size();
    bytes_.resize(at + v.size());
    if (!v.empty()) std::memcpy(bytes_.data() + at, v.data(), v.size());
}

Box ByteReader::box() {
    const uint8_t empty = u8();
    if (empty > 1) fail("a box is neither empty nor not");
    if (!ok_ || empty == 1) return {};
    Box v;
    v.min = dvec3();
    v.max = dvec3();
    if (ok_ && v.empty()) fail("a box ends before it starts");
    return v;
}

std::string ByteReader::string() {
    const uint32_t size = count(1, "characters");
    std::string v(size, '\0');
    if (size > 0) std::memcpy(v.data(), bytes_.data() + at_, size);
    at_ += size;
    return v;
}

uint32_t ByteReader::count(size_t bytesEach, const char* of) {
    const uint32_t n = u32();
    if (ok_ && n > remaining() / bytesEach)
        fail(std::to_string(n) + " " + of + " declared, " + std::to_string(remaining() / bytesEach) +
             " can follow");
    return ok_ ? n : 0;
}

void ByteReader::fail(const std::string& why) {
    if (!ok_) return;
    ok_ = false;
    why_ = "byte " + std::to_string(at_) + " of " + std::to_string(bytes_.size()) + ": " + why;
}

Result<Done> ByteReader::end() {
    if (ok_ && remaining() > 0) fail(std::to_string(remaining()) + " bytes follow the end");
    if (!ok_) return Error{ErrorCode::kBadData, why_};
    return Done{};
}

}  // namespace world
