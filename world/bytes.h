// world/bytes.h — bounded reader and writer of little-endian fields: no length is trusted, nothing is
// read past the end, and every byte must be accounted for.
#pragma once

#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <glm/glm.hpp>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "world/box.h"
#include "world/result.h"

namespace world {

static_assert(std::endian::native == std::endian::little, "fields are copied as the machine holds them");

/// Appends fields. Floats must be finite: a reader refuses the others.
class ByteWriter {
public:
    void reserve(size_t bytes) { bytes_.reserve(bytes); }
    void u8(uint8_t v) { put(v); }
    void u32(uint32_t v) { put(v); }
    void i32(int32_t v) { put(v); }
    void u64(uint64_t v) { put(v); }
    void f32(float v) { put(v); }
    void f64(double v) { put(v); }
    void vec3(const glm::vec3& v) { f32(v.x), f32(v.y), f32(v.z); }
    void dvec3(const glm::dvec3& v) { f64(v.x), f64(v.y), f64(v.z); }
    void box(const Box& v);
    void string(std::string_view v);

    std::vector<std::byte> take() { return std::move(bytes_); }

private:
    template <class T>
    void put(const T& v) {
        const size_t at = bytes_.size();
        bytes_.resize(at + sizeof(T));
        std::memcpy(bytes_.data() + at, &v, sizeof(T));
    }
    std::vector<std::byte> bytes_;
};

/// Takes fields from the front. The first thing that is wrong sticks: every later read gives zeros, so a
/// decoder tests once, at the end, and loops only over counts that `count` has proven to fit.
class ByteReader {
public:
    /// `bytes` must outlive the reader.
    explicit ByteReader(std::span<const std::byte> bytes) : bytes_(bytes) {}

    uint8_t u8() { return get<uint8_t>(); }
    uint32_t u32() { return get<uint32_t>(); }
    int32_t i32() { return get<int32_t>(); }
    uint64_t u64() { return get<uint64_t>(); }
    float f32() { return finite(get<float>()); }    ///< fails unless finite
    double f64() { return finite(get<double>()); }  ///< fails unless finite
    glm::vec3 vec3() {
        const float x = f32(), y = f32(), z = f32();
        return {x, y, z};
    }
    glm::dvec3 dvec3() {
        const double x = f64(), y = f64(), z = f64();
        return {x, y, z};
    }
    Box box();  ///< fails unless empty or min <= max
    std::string string();

    /// A u32 that counts things of at least `bytesEach` bytes, all of which must still follow: fails,
    /// and gives 0, where they do not fit. `of` names them in the error.
    uint32_t count(size_t bytesEach, const char* of);

    bool ok() const { return ok_; }
    size_t position() const { return at_; }  ///< bytes read so far
    size_t remaining() const { return bytes_.size() - at_; }
    /// Gives up here with `why`, unless something was wrong before.
    void fail(const std::string& why);
    /// kBadData with the first thing that was wrong, bytes left over included.
    Result<Done> end();

private:
    template <class T>
    T get() {
        T v{};
        if (!ok_) return v;
        if (remaining() < sizeof(T)) {
            fail("it ends inside a field");
            return v;
        }
        std::memcpy(&v, bytes_.data() + at_, sizeof(T));
        at_ += sizeof(T);
        return v;
    }
    template <class T>
    T finite(T v) {
        if (std::isfinite(v)) return v;
        fail("a number is not finite");
        return 0;
    }

    std::span<const std::byte> bytes_;
    size_t at_ = 0;
    bool ok_ = true;
    std::string why_;
};

}  // namespace world
