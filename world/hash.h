// world/hash.h — 64-bit hashes (XXH3) for checksums, plans and maps.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace world {

/// XXH3 of the bytes, starting from `seed`; chain calls by passing the last hash as the next seed.
/// Equal on every machine of the same byte order.
uint64_t hashBytes(std::span<const std::byte> bytes, uint64_t seed = 0);

/// The same over the object representation of a span of plain values without padding.
template <class T>
uint64_t hashValues(std::span<const T> values, uint64_t seed = 0) {
    return hashBytes(std::as_bytes(values), seed);
}

}  // namespace world
