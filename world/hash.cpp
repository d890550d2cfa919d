#include "world/hash.h"

#include <xxhash.h>

namespace world {

uint64_t hashBytes(std::span<const std::byte> bytes, uint64_t seed) {
    return XXH3_64bits_withSeed(bytes.data(), bytes.size(), seed);
}

}  // namespace world
