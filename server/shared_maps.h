// server/shared_maps.h — a session's working maps in memory that a client on the same host maps: its layout, who writes it, and
// how a reader knows that what it read belongs together.
// Source: Boehm, "Can Seqlocks Get Along With Programming Language Memory Models?", 2012.
//
// A page of SharedHeader, then a map of each cascade, camera by camera, side * side texels as they are stored (float, or units
// of 1/65535), row by row in stored order, each from a multiple of 4 KiB on.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "world/result.h"

namespace server {

constexpr uint64_t kSharedPage = 4096;
constexpr char kSharedMagic[16] = "gnomon maps 1";

struct SharedShape {
    uint32_t cascades = 0;    ///< of all cameras
    uint32_t side = 0;        ///< [texels]
    uint32_t texelBytes = 4;  ///< 4 or 2

    uint64_t mapBytes() const { return (uint64_t(side) * side * texelBytes + kSharedPage - 1) / kSharedPage * kSharedPage; }
    uint64_t bytes() const { return kSharedPage + cascades * mapBytes(); }
    friend bool operator==(const SharedShape&, const SharedShape&) = default;
};

/// At the memory's begin. All but `sequence` and `frame` stay as they are.
struct SharedHeader {
    char magic[16];
    SharedShape shape;
    uint32_t reserved = 0;
    std::atomic<uint64_t> sequence;  ///< odd while maps are written
    std::atomic<uint64_t> frame;     ///< after which the maps are; of the session
};
static_assert(std::atomic<uint64_t>::is_always_lock_free);

/// Memory of a file descriptor, mapped; either side's.
class SharedMaps {
public:
    /// New memory that nobody may shrink or grow. kIo, kLimit where there is none.
    static world::Result<std::shared_ptr<SharedMaps>> create(const SharedShape& shape);
    /// To be written to. Takes the descriptor over. kIo, kBadData for one that is none.
    static world::Result<std::shared_ptr<SharedMaps>> write(int descriptor);
    /// To be read. Takes the descriptor over. Errors likewise.
    static world::Result<std::shared_ptr<SharedMaps>> read(int descriptor);
    ~SharedMaps();
    SharedMaps(const SharedMaps&) = delete;
    SharedMaps& operator=(const SharedMaps&) = delete;

    int descriptor() const { return descriptor_; }
    const SharedShape& shape() const { return header().shape; }
    uint64_t frame() const { return header().frame.load(std::memory_order_relaxed); }
    std::span<const std::byte> map(int cascade) const;

    // Who writes:
    /// From here on nobody else can begin to write.
    world::Result<world::Done> seal();
    std::span<std::byte> memory() { return memory_; }
    uint64_t offset(int cascade) const { return kSharedPage + uint64_t(cascade) * shape().mapBytes(); }
    void begin();
    void end(uint64_t frame);

    // Who reads: what was read between two equal numbers belongs to one frame. None while it is written.
    std::optional<uint64_t> sequence() const;

private:
    SharedMaps(int descriptor, std::span<std::byte> memory) : descriptor_(descriptor), memory_(memory) {}
    static world::Result<std::shared_ptr<SharedMaps>> open(int descriptor, bool writes);
    SharedHeader& header() const { return *reinterpret_cast<SharedHeader*>(memory_.data()); }

    int descriptor_;
    std::span<std::byte> memory_;
};

}  // namespace server
