#include "gpu/geometry_store.h"

#include <algorithm>
#include <cstring>
#include <string>

#include "world/check.h"

namespace gpu {
namespace {

using cache::GeometryId;
using world::Error;
using world::ErrorCode;
using world::Result;

/// The arena counts in positions, so that a mesh level's first one has a whole number; an index is a
/// third of a unit.
constexpr uint64_t kUnitBytes = sizeof(glm::vec3);
constexpr uint64_t kIndicesPerUnit = kUnitBytes / sizeof(uint32_t);
/// Index numbers are 32 bits and base vertices are signed: this many units keep both in range.
constexpr uint64_t kMostUnits = UINT32_MAX / kIndicesPerUnit;

std::string mebibytes(uint64_t bytes) { return std::to_string((bytes + (1 << 20) - 1) >> 20) + " MiB"; }

}  // namespace

Result<GeometryStore> GeometryStore::create(Device::Impl& device, uint64_t bytes) {
    const uint64_t units = std::max<uint64_t>(1, bytes / kUnitBytes);
    const uint64_t mostUnits = std::min(kMostUnits, device.maxAllocationBytes / kUnitBytes);
    if (units > mostUnits)
        return Error{ErrorCode::kLimit, "geometry arena of " + mebibytes(bytes) + ": '" + device.name +
                                            "' allows at most " + mebibytes(mostUnits * kUnitBytes) +
                                            " in one piece; lower --gpu-budget"};
    auto buffer = createBuffer(device, units * kUnitBytes,
                               VK_BUFFER_USAGE_VERTEX_BUFFER_BIT | VK_BUFFER_USAGE_INDEX_BUFFER_BIT,
                               Home::kUpload, "geometry arena");
    if (!buffer) return buffer.error();
    GeometryStore store(static_cast<uint32_t>(units));
    store.buffer_ = std::move(buffer.value());
    return store;
}

Result<GeometryId> GeometryStore::upload(const world::MeshLevel& level, const Await& await) {
    // The GPU reads where an index points without asking.
    for (const uint32_t index : level.indices) CHECK(index < level.positions.size());

    Slot slot{.live = true};
    ArenaRange range;
    const uint64_t positionUnits = level.positions.size();
    const uint64_t indexUnits = (level.indices.size() + kIndicesPerUnit - 1) / kIndicesPerUnit;
    const uint64_t units = positionUnits + indexUnits;
    if (!level.indices.empty()) {
        const auto offset =
            units <= arena_.capacity() ? arena_.allocate(static_cast<uint32_t>(units)) : std::nullopt;
        if (!offset)
            return Error{ErrorCode::kLimit,
                         "geometry arena: a mesh level of " + std::to_string(units * kUnitBytes) +
                             " bytes does not fit; of " + mebibytes(arena_.capacity() * kUnitBytes) + ", " +
                             mebibytes(arena_.used() * kUnitBytes) + " are used and the largest gap has " +
                             std::to_string(arena_.largestFree() * kUnitBytes) + " bytes; raise --gpu-budget"};
        uint64_t reader = 0;
        for (const Retired& r : retired_)
            if (r.offset < *offset + units && *offset < r.offset + r.units) reader = std::max(reader, r.lastReader);
        if (reader > 0) {
            if (const auto finished = await(reader); !finished) {
                arena_.release(*offset, static_cast<uint32_t>(units));
                return finished.error();
            }
            forgetReaders(reader);
        }
        slot.offset = *offset;
        slot.units = static_cast<uint32_t>(units);
        range = {.baseVertex = static_cast<int32_t>(*offset),
                 .firstIndex = static_cast<uint32_t>((*offset + positionUnits) * kIndicesPerUnit),
                 .indexCount = static_cast<uint32_t>(level.indices.size())};
        std::byte* const at = buffer_.mapped + *offset * kUnitBytes;
        std::memcpy(at, level.positions.data(), positionUnits * kUnitBytes);
        std::memcpy(at + positionUnits * kUnitBytes, level.indices.data(),
                    level.indices.size() * sizeof(uint32_t));
        uploaded_ += positionUnits * kUnitBytes + level.indices.size() * sizeof(uint32_t);
    }
    GeometryId id = static_cast<GeometryId>(slots_.size());
    if (freeIds_.empty()) {
        slots_.push_back(slot);
        ranges_.push_back(range);
    } else {
        id = freeIds_.back();
        freeIds_.pop_back();
        slots_[id] = slot;
        ranges_[id] = range;
    }
    return id;
}

void GeometryStore::release(GeometryId id, uint64_t lastReader) {
    CHECK(live(id));
    if (const Slot& slot = slots_[id]; slot.units > 0) {
        arena_.release(slot.offset, slot.units);
        if (lastReader > 0) retired_.push_back({lastReader, slot.offset, slot.units});
    }
    slots_[id] = {};
    ranges_[id] = {};
    freeIds_.push_back(id);
}

void GeometryStore::forgetReaders(uint64_t finished) {
    std::erase_if(retired_, [finished](const Retired& r) { return r.lastReader <= finished; });
}

uint64_t GeometryStore::bytesUsed() const { return arena_.used() * kUnitBytes; }

}  // namespace gpu
