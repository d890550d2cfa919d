#include "world/blob.h"

#include <zstd.h>

#include "world/bytes.h"
#include "world/hash.h"

namespace world {
namespace {

constexpr int kZstdLevel = 3;  // the library's own default: near 300 MB/s a core

uint64_t seal(const BlobKey& key, BlobCodec codec, uint64_t rawSize, std::span<const std::byte> data) {
    ByteWriter w;
    w.i32(key.x), w.i32(key.y), w.i32(key.z), w.i32(key.lod);
    w.i32(static_cast<int32_t>(key.kind));
    w.i32(static_cast<int32_t>(codec));
    w.u64(rawSize);
    return hashBytes(data, hashBytes(w.take()));
}

Error bad(const char* what) { return {ErrorCode::kBadData, what}; }

}  // namespace

Result<PackedBlob> packBlob(const BlobKey& key, std::span<const std::byte> raw) {
    if (raw.size() > kMaxBlobBytes)
        return Error{ErrorCode::kLimit, toString(key) + ": " + std::to_string(raw.size() >> 20) +
                                            " MiB in one row, " + std::to_string(kMaxBlobBytes >> 20) +
                                            " is the limit: bake with smaller chunks, or split the mesh"};
    PackedBlob blob;
    blob.rawSize = raw.size();
    blob.data.resize(ZSTD_compressBound(raw.size()));
    const size_t size = ZSTD_compress(blob.data.data(), blob.data.size(), raw.data(), raw.size(), kZstdLevel);
    if (!ZSTD_isError(size) && size < raw.size()) {
        blob.codec = BlobCodec::kZstd;
        blob.data.resize(size);
    } else {
        blob.data.assign(raw.begin(), raw.end());
    }
    blob.checksum = seal(key, blob.codec, blob.rawSize, blob.data);
    return blob;
}

Result<std::vector<std::byte>> unpackBlob(const BlobKey& key, int64_t codec, int64_t rawSize,
                                          uint64_t checksum, std::span<const std::byte> data) {
    const bool zstd = codec == static_cast<int64_t>(BlobCodec::kZstd);
    if (!zstd && codec != static_cast<int64_t>(BlobCodec::kRaw)) return bad("its codec is unknown");
    if (rawSize < 0 || static_cast<uint64_t>(rawSize) > kMaxBlobBytes) return bad("its size is out of range");
    const uint64_t size = static_cast<uint64_t>(rawSize);
    if (seal(key, zstd ? BlobCodec::kZstd : BlobCodec::kRaw, size, data) != checksum)
        return bad("its checksum does not match");
    if (!zstd) {
        if (data.size() != size) return bad("its size is not the one declared");
        return std::vector<std::byte>(data.begin(), data.end());
    }
    // The frame declares its size as well: without agreement nothing is allocated.
    if (ZSTD_getFrameContentSize(data.data(), data.size()) != size)
        return bad("its size is not the one declared");
    std::vector<std::byte> raw(size);
    if (ZSTD_decompress(raw.data(), raw.size(), data.data(), data.size()) != size)
        return bad("it does not decompress");
    return raw;
}

}  // namespace world
