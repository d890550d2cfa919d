#include "tools/report/apng.h"

#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <span>

namespace tools::report {
namespace {

using world::Error;
using world::ErrorCode;
using world::Result;
using Bytes = std::vector<std::byte>;

constexpr size_t kSignature = 8, kHead = 8, kCrc = 4;

void put32(Bytes& out, uint32_t value) {
    for (int shift = 24; shift >= 0; shift -= 8) out.push_back(std::byte(value >> shift));
}
void put16(Bytes& out, uint16_t value) {
    out.push_back(std::byte(value >> 8));
    out.push_back(std::byte(value & 255));
}

struct Chunk {
    std::string type;
    std::span<const std::byte> data;
};

void putChunk(Bytes& out, const std::string& type, std::span<const std::byte> data) {
    put32(out, uint32_t(data.size()));
    const size_t from = out.size();
    for (const char c : type) out.push_back(std::byte(c));
    out.insert(out.end(), data.begin(), data.end());
    put32(out, uint32_t(crc32(0, reinterpret_cast<const Bytef*>(out.data() + from), uInt(out.size() - from))));
}

Result<std::vector<Chunk>> chunksOf(const Bytes& png) {
    const Error broken{ErrorCode::kBadData, "a picture is no PNG, or cut short; run again with --dump"};
    std::vector<Chunk> chunks;
    for (size_t at = kSignature; at < png.size();) {
        if (png.size() - at < kHead + kCrc) return broken;
        uint32_t size = 0;
        std::string type;
        for (size_t k = 0; k < 4; ++k) size = size << 8 | uint32_t(png[at + k]);
        for (size_t k = 4; k < 8; ++k) type += char(png[at + k]);
        if (size > png.size() - at - kHead - kCrc) return broken;
        chunks.push_back({type, std::span(png).subspan(at + kHead, size)});
        at += kHead + size + kCrc;
    }
    if (chunks.empty() || chunks.front().type != "IHDR" || chunks.front().data.size() != 13 || chunks.back().type != "IEND") return broken;
    return chunks;
}

}  // namespace

Result<Bytes> animated(const std::vector<Bytes>& pngs, double seconds) {
    if (pngs.empty()) return Error{ErrorCode::kUsage, "there is no picture; give the replay --dump FOLDER"};
    Bytes out;
    uint32_t sequence = 0;
    std::span<const std::byte> head;
    for (size_t k = 0; k < pngs.size(); ++k) {
        const auto chunks = chunksOf(pngs[k]);
        if (!chunks) return chunks.error();
        const auto& first = chunks.value().front();
        if (k == 0) {
            head = first.data;
            out.assign(pngs[k].begin(), pngs[k].begin() + ptrdiff_t(kSignature));
            putChunk(out, "IHDR", head);
            Bytes frames;
            put32(frames, uint32_t(pngs.size()));
            put32(frames, 0);  // plays without end
            putChunk(out, "acTL", frames);
        } else if (!std::equal(head.begin(), head.end(), first.data.begin(), first.data.end())) {
            return Error{ErrorCode::kUsage, "pictures of several sizes cannot be one animation"};
        }
        Bytes control;
        put32(control, sequence++);
        control.insert(control.end(), head.begin(), head.begin() + 8);  // width and height
        put32(control, 0), put32(control, 0);                           // offsets
        put16(control, uint16_t(std::clamp(std::lround(seconds * 1000), 1L, 65535L)));
        put16(control, 1000);
        put16(control, 0);  // leave the frame, and replace all of it
        putChunk(out, "fcTL", control);
        for (const Chunk& chunk : chunks.value()) {
            if (chunk.type != "IDAT") continue;
            if (k == 0) {
                putChunk(out, "IDAT", chunk.data);
                continue;
            }
            Bytes data;
            put32(data, sequence++);
            data.insert(data.end(), chunk.data.begin(), chunk.data.end());
            putChunk(out, "fdAT", data);
        }
    }
    putChunk(out, "IEND", {});
    return out;
}

}  // namespace tools::report
