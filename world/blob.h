// world/blob.h — one row's bytes on their way into and out of a world file: compressed, measured, and
// sealed with a checksum that is tested before anything is unpacked.
// Source: Collet and Kucherawy, "Zstandard Compression", RFC 8878, 2021 (format).
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "world/result.h"
#include "world/store.h"

namespace world {

constexpr uint64_t kMaxBlobBytes = 1ull << 30;  ///< raw size of a row, at most

enum class BlobCodec : int32_t {
    kRaw = 0,   ///< as it came: it did not shrink
    kZstd = 1,  ///< one zstd frame
};

/// A row without its key.
struct PackedBlob {
    BlobCodec codec = BlobCodec::kRaw;
    uint64_t rawSize = 0;
    uint64_t checksum = 0;        ///< over key, codec, raw size and stored bytes
    std::vector<std::byte> data;  ///< as stored
};

/// kLimit above kMaxBlobBytes. Safe from any thread.
Result<PackedBlob> packBlob(const BlobKey& key, std::span<const std::byte> raw);

/// The raw bytes. `codec` and `rawSize` may be anything; kBadData names what is wrong.
/// Safe from any thread.
Result<std::vector<std::byte>> unpackBlob(const BlobKey& key, int64_t codec, int64_t rawSize,
                                          uint64_t checksum, std::span<const std::byte> data);

}  // namespace world
