#include "gpu/shadow_maps.h"

#include <algorithm>
#include <chrono>
#include <cstring>

#include "gpu/arena.h"
#include "gpu/depth_pass.h"
#include "gpu/device_impl.h"
#include "gpu/draw_list.h"
#include "gpu/frame.h"
#include "world/check.h"

namespace gpu {
namespace {

using cache::CascadePlan;
using cache::FramePlan;
using cache::GeometryId;
using cache::StoreRect;
using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

/// The arena counts in positions, so that a mesh level's first one has a whole number; an index is a
/// third of a unit.
constexpr uint64_t kUnitBytes = sizeof(glm::vec3);
constexpr uint64_t kIndicesPerUnit = kUnitBytes / sizeof(uint32_t);
/// Index numbers are 32 bits and base vertices are signed: this many units keep both in range.
constexpr uint64_t kMostUnits = UINT32_MAX / kIndicesPerUnit;
/// First size of a frame's buffers: a few hundred casters.
constexpr uint64_t kFirstBytes = 64 << 10;
/// After a cascade's static passes, its restores and its active passes; one more starts the frame.
/// Each costs a software driver 0.05 to 0.1 ms, so none is taken twice.
constexpr uint32_t kStampsPerCascade = 3;

struct CascadeMaps {
    DepthMap cacheMap, working;
};

/// What the arena holds for one GeometryId.
struct Slot {
    uint32_t offset = 0, units = 0;  ///< units 0: an empty mesh level, nothing in the arena
    bool live = false;
};

/// Where one cascade's draws are, and the timestamps that end its parts; the one before starts them.
struct CascadeWork {
    std::vector<DepthPass::Draws> staticDraws, activeDraws;
    uint32_t staticEnd = 0, restoreEnd = 0, activeEnd = 0;
};

std::string mebibytes(uint64_t bytes) { return std::to_string((bytes + (1 << 20) - 1) >> 20) + " MiB"; }

bool drawsStatic(const CascadePlan& plan) {
    return !plan.unknowns.empty() || !plan.clears.empty() || !plan.staticPasses.empty();
}

double msSince(std::chrono::steady_clock::time_point start) {
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace

struct ShadowMaps::Impl {
    Device::Impl& device;
    ShadowMapsConfig config;
    DepthPass pass;
    Arena arena;
    Buffer geometry;
    GrowingBuffer transforms, instances, commands;
    Buffer readback;                         ///< made at the first read
    std::vector<CascadeMaps> maps, scratch;  ///< scratch: made at first use
    std::vector<Slot> slots;                 ///< by GeometryId
    std::vector<ArenaRange> ranges;          ///< likewise
    std::vector<GeometryId> freeIds;
    DrawList drawList;
    std::vector<CascadeWork> work;  ///< kept for its memory
    std::vector<VkImageCopy> copies;
    uint64_t uploaded = 0;
    Frame frame;  ///< last, so that its destructor waits before anything that it uses goes

    Result<std::vector<CascadeMaps>> makeMaps(const std::string& prefix);
    Result<Done> needScratch();
    void check(const FramePlan& plan) const;
    Result<Done> fill(const FramePlan& plan);
    void record(VkCommandBuffer commandBuffer, const FramePlan& plan, std::vector<CascadeMaps>& target);
    void recordRestores(VkCommandBuffer commandBuffer, const CascadePlan& plan, const CascadeMaps& target);
    Result<GpuTimes> run(const FramePlan& plan, std::vector<CascadeMaps>& target);
};

Result<std::unique_ptr<ShadowMaps>> ShadowMaps::create(Device& device, const ShadowMapsConfig& config) {
    CHECK(config.cascades > 0 && config.side > 0);
    Device::Impl& d = device.impl();
    if (static_cast<uint32_t>(config.side) > d.maxSide)
        return Error{ErrorCode::kLimit, "shadow maps of " + std::to_string(config.side) +
                                            " texels a side: '" + d.name + "' draws at most " +
                                            std::to_string(d.maxSide) + "; lower --resolution"};
    const uint64_t units = std::max<uint64_t>(1, config.geometryBytes / kUnitBytes);
    const uint64_t mostUnits = std::min(kMostUnits, d.maxAllocationBytes / kUnitBytes);
    if (units > mostUnits)
        return Error{ErrorCode::kLimit, "geometry arena of " + mebibytes(config.geometryBytes) + ": '" +
                                            d.name + "' allows at most " + mebibytes(mostUnits * kUnitBytes) +
                                            " in one piece; lower --gpu-budget"};

    auto pass = DepthPass::create(d, static_cast<uint32_t>(config.side), config.format);
    if (!pass) return pass.error();
    auto geometry = createBuffer(d, units * kUnitBytes,
                                 VK_BUFFER_USAGE_VERTEX_BUFFER_BIT | VK_BUFFER_USAGE_INDEX_BUFFER_BIT,
                                 Home::kUpload, "geometry arena");
    if (!geometry) return geometry.error();
    auto transforms = GrowingBuffer::create(d, kFirstBytes, VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, "transforms");
    if (!transforms) return transforms.error();
    auto instances = GrowingBuffer::create(d, kFirstBytes, VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, "instances");
    if (!instances) return instances.error();
    auto commands =
        GrowingBuffer::create(d, kFirstBytes, VK_BUFFER_USAGE_INDIRECT_BUFFER_BIT, "indirect draws");
    if (!commands) return commands.error();
    auto frame =
        Frame::create(d, 1 + kStampsPerCascade * static_cast<uint32_t>(config.cascades), "shadow maps frame");
    if (!frame) return frame.error();

    std::unique_ptr<Impl> impl(
        new Impl{.device = d,
                 .config = config,
                 .pass = std::move(pass.value()),
                 .arena = Arena(static_cast<uint32_t>(units)),
                 .geometry = std::move(geometry.value()),
                 .transforms = std::move(transforms.value()),
                 .instances = std::move(instances.value()),
                 .commands = std::move(commands.value()),
                 .readback = {},
                 .maps = {},
                 .scratch = {},
                 .slots = {},
                 .ranges = {},
                 .freeIds = {},
                 .drawList = {},
                 .work = std::vector<CascadeWork>(static_cast<size_t>(config.cascades)),
                 .copies = {},
                 .uploaded = 0,
                 .frame = std::move(frame.value())});
    impl->pass.bind(impl->transforms.buffer(), impl->instances.buffer());
    auto maps = impl->makeMaps("");
    if (!maps) return maps.error();
    impl->maps = std::move(maps.value());
    return std::unique_ptr<ShadowMaps>(new ShadowMaps(std::move(impl)));
}

ShadowMaps::ShadowMaps(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
ShadowMaps::~ShadowMaps() = default;

Result<std::vector<CascadeMaps>> ShadowMaps::Impl::makeMaps(const std::string& prefix) {
    if (const auto settled = frame.settle(); !settled) return settled.error();
    std::vector<CascadeMaps> made(static_cast<size_t>(config.cascades));
    for (size_t c = 0; c < made.size(); ++c) {
        const std::string number = " map " + std::to_string(c);
        for (auto [map, kind] :
             {std::pair(&made[c].cacheMap, "cache"), std::pair(&made[c].working, "working")}) {
            auto image = createDepthImage(device, static_cast<uint32_t>(config.side), config.format,
                                          prefix + kind + number);
            if (!image) return image.error();
            map->image = std::move(image.value());
        }
    }
    const auto commandBuffer = frame.begin();
    if (!commandBuffer) return commandBuffer.error();
    for (CascadeMaps& maps_ : made) {
        frame.need(maps_.cacheMap, Use::kAttachment);
        frame.need(maps_.working, Use::kAttachment);
    }
    frame.barrier();
    for (const CascadeMaps& maps_ : made) {
        pass.recordNew(commandBuffer.value(), maps_.cacheMap.image);
        pass.recordNew(commandBuffer.value(), maps_.working.image);
    }
    if (const auto submitted = frame.submitAndWait(); !submitted) return submitted.error();
    return made;
}

Result<Done> ShadowMaps::Impl::needScratch() {
    if (!scratch.empty()) return Done{};
    auto made = makeMaps("scratch ");
    if (!made) return made.error();
    scratch = std::move(made.value());
    return Done{};
}

Result<GeometryId> ShadowMaps::upload(const world::MeshLevel& level) {
    Impl& impl = *impl_;
    // What was released may still be read by a submission whose wait timed out.
    if (const auto settled = impl.frame.settle(); !settled) return settled.error();
    // The GPU reads where an index points without asking.
    for (const uint32_t index : level.indices) CHECK(index < level.positions.size());

    Slot slot{.live = true};
    ArenaRange range;
    const uint64_t positionUnits = level.positions.size();
    const uint64_t indexUnits = (level.indices.size() + kIndicesPerUnit - 1) / kIndicesPerUnit;
    const uint64_t units = positionUnits + indexUnits;
    if (!level.indices.empty()) {
        const auto offset =
            units <= impl.arena.capacity() ? impl.arena.allocate(static_cast<uint32_t>(units)) : std::nullopt;
        if (!offset)
            return Error{
                ErrorCode::kLimit,
                "geometry arena: a mesh level of " + std::to_string(units * kUnitBytes) +
                    " bytes does not fit; of " + mebibytes(impl.arena.capacity() * kUnitBytes) + ", " +
                    mebibytes(impl.arena.used() * kUnitBytes) + " are used and the largest gap has " +
                    std::to_string(impl.arena.largestFree() * kUnitBytes) + " bytes; raise --gpu-budget"};
        slot.offset = *offset;
        slot.units = static_cast<uint32_t>(units);
        range = {.baseVertex = static_cast<int32_t>(*offset),
                 .firstIndex = static_cast<uint32_t>((*offset + positionUnits) * kIndicesPerUnit),
                 .indexCount = static_cast<uint32_t>(level.indices.size())};
        std::byte* const at = impl.geometry.mapped + *offset * kUnitBytes;
        std::memcpy(at, level.positions.data(), positionUnits * kUnitBytes);
        std::memcpy(at + positionUnits * kUnitBytes, level.indices.data(),
                    level.indices.size() * sizeof(uint32_t));
        impl.uploaded += positionUnits * kUnitBytes + level.indices.size() * sizeof(uint32_t);
    }
    GeometryId id = static_cast<GeometryId>(impl.slots.size());
    if (impl.freeIds.empty()) {
        impl.slots.push_back(slot);
        impl.ranges.push_back(range);
    } else {
        id = impl.freeIds.back();
        impl.freeIds.pop_back();
        impl.slots[id] = slot;
        impl.ranges[id] = range;
    }
    return id;
}

void ShadowMaps::release(GeometryId id) {
    Impl& impl = *impl_;
    CHECK(id < impl.slots.size() && impl.slots[id].live);
    if (impl.slots[id].units > 0) impl.arena.release(impl.slots[id].offset, impl.slots[id].units);
    impl.slots[id] = {};
    impl.ranges[id] = {};
    impl.freeIds.push_back(id);
}

uint64_t ShadowMaps::geometryBytesUsed() const { return impl_->arena.used() * kUnitBytes; }
uint64_t ShadowMaps::uploadedBytes() const { return impl_->uploaded; }

/// CHECKs what recording relies on; ranges within meshes are checked where the draws are made.
void ShadowMaps::Impl::check(const FramePlan& plan) const {
    CHECK(plan.cascades.size() <= static_cast<size_t>(config.cascades));
    const auto inMap = [this](const StoreRect& r) {
        return r.min.x >= 0 && r.min.y >= 0 && r.max.x <= config.side && r.max.y <= config.side;
    };
    for (const CascadePlan& cascade : plan.cascades) {
        CHECK(std::all_of(cascade.unknowns.begin(), cascade.unknowns.end(), inMap));
        CHECK(std::all_of(cascade.clears.begin(), cascade.clears.end(), inMap));
        CHECK(std::all_of(cascade.restores.begin(), cascade.restores.end(), inMap));
        for (const auto* passes : {&cascade.staticPasses, &cascade.activePasses})
            for (const cache::DrawPass& p : *passes) {
                CHECK(inMap(p.scissor));
                CHECK(p.firstItem <= plan.items.size() && p.itemCount <= plan.items.size() - p.firstItem);
            }
    }
    for (const cache::DrawItem& item : plan.items) {
        CHECK(item.transform < plan.transforms.size());
        CHECK(item.geometry < slots.size() && slots[item.geometry].live);
    }
}

/// Writes the frame's buffers and notes each pass's draws in `work`.
Result<Done> ShadowMaps::Impl::fill(const FramePlan& plan) {
    uint64_t items = 0;
    for (const CascadePlan& cascade : plan.cascades)
        for (const auto* passes : {&cascade.staticPasses, &cascade.activePasses})
            for (const cache::DrawPass& p : *passes) items += p.itemCount;
    const uint64_t transformBytes = plan.transforms.size() * sizeof(glm::mat3x4);
    const uint64_t instanceBytes = items * sizeof(uint32_t);
    // A doubled buffer must still be one that the shader can see whole.
    if (std::max(transformBytes, instanceBytes) > device.maxStorageBytes / 2)
        return Error{ErrorCode::kLimit, "frame plan: " + std::to_string(plan.transforms.size()) +
                                            " transforms and " + std::to_string(items) +
                                            " draws are more than '" + device.name +
                                            "' takes at once; use fewer cascades or a lower far distance"};
    const auto moreTransforms = transforms.reserve(device, transformBytes);
    if (!moreTransforms) return moreTransforms.error();
    const auto moreInstances = instances.reserve(device, instanceBytes);
    // The first may have moved already: the shader must not keep a buffer that is gone.
    if (moreTransforms.value() || (moreInstances && moreInstances.value()))
        pass.bind(transforms.buffer(), instances.buffer());
    if (!moreInstances) return moreInstances.error();
    const auto moreCommands = commands.reserve(device, items * sizeof(VkDrawIndexedIndirectCommand));
    if (!moreCommands) return moreCommands.error();

    if (transformBytes > 0) std::memcpy(transforms.buffer().mapped, plan.transforms.data(), transformBytes);
    drawList.begin({reinterpret_cast<VkDrawIndexedIndirectCommand*>(commands.buffer().mapped), items},
                   {reinterpret_cast<uint32_t*>(instances.buffer().mapped), items});
    for (size_t c = 0; c < plan.cascades.size(); ++c) {
        const auto add = [&](const std::vector<cache::DrawPass>& passes,
                             std::vector<DepthPass::Draws>& draws) {
            draws.clear();
            for (const cache::DrawPass& p : passes)
                draws.push_back(
                    {p.scissor,
                     drawList.add(std::span(plan.items).subspan(p.firstItem, p.itemCount), ranges)});
        };
        add(plan.cascades[c].staticPasses, work[c].staticDraws);
        add(plan.cascades[c].activePasses, work[c].activeDraws);
    }
    uploaded += transformBytes + drawList.instanceCount() * sizeof(uint32_t) +
                drawList.commandCount() * sizeof(VkDrawIndexedIndirectCommand);
    return Done{};
}

/// All cascades' static parts, then all restores, then all active parts: three barriers in all, and
/// on a software driver each one waits for everything before it.
void ShadowMaps::Impl::record(VkCommandBuffer commandBuffer, const FramePlan& plan,
                              std::vector<CascadeMaps>& target) {
    const DepthPass::Buffers buffers{.geometry = geometry, .commands = commands.buffer()};
    const size_t count = plan.cascades.size();
    frame.stamp();
    for (size_t c = 0; c < count; ++c)
        if (drawsStatic(plan.cascades[c])) frame.need(target[c].cacheMap, Use::kAttachment);
    frame.barrier();
    for (size_t c = 0; c < count; ++c) {
        if (!drawsStatic(plan.cascades[c])) continue;
        pass.record(commandBuffer, target[c].cacheMap.image,
                    {plan.cascades[c].unknowns, plan.cascades[c].clears, work[c].staticDraws}, buffers);
        work[c].staticEnd = frame.stamp();
    }
    for (size_t c = 0; c < count; ++c) {
        if (plan.cascades[c].restores.empty()) continue;
        frame.need(target[c].cacheMap, Use::kCopySource);
        frame.need(target[c].working, Use::kCopyTarget);
    }
    frame.barrier();
    for (size_t c = 0; c < count; ++c) {
        if (plan.cascades[c].restores.empty()) continue;
        recordRestores(commandBuffer, plan.cascades[c], target[c]);
        work[c].restoreEnd = frame.stamp();
    }
    for (size_t c = 0; c < count; ++c)
        if (!plan.cascades[c].activePasses.empty()) frame.need(target[c].working, Use::kAttachment);
    frame.barrier();
    for (size_t c = 0; c < count; ++c) {
        if (plan.cascades[c].activePasses.empty()) continue;
        pass.record(commandBuffer, target[c].working.image, {{}, {}, work[c].activeDraws}, buffers);
        work[c].activeEnd = frame.stamp();
    }
}

void ShadowMaps::Impl::recordRestores(VkCommandBuffer commandBuffer, const CascadePlan& plan,
                                      const CascadeMaps& target) {
    copies.clear();
    for (const StoreRect& rect : plan.restores) {
        const glm::ivec2 size = rect.max - rect.min;
        if (size.x <= 0 || size.y <= 0) continue;
        VkImageCopy copy{};
        copy.srcSubresource = {VK_IMAGE_ASPECT_DEPTH_BIT, 0, 0, 1};
        copy.srcOffset = {rect.min.x, rect.min.y, 0};
        copy.dstSubresource = copy.srcSubresource;
        copy.dstOffset = copy.srcOffset;
        copy.extent = {static_cast<uint32_t>(size.x), static_cast<uint32_t>(size.y), 1};
        copies.push_back(copy);
    }
    if (copies.empty()) return;
    vkCmdCopyImage(commandBuffer, target.cacheMap.image.handle.raw(), kCopySourceLayout,
                   target.working.image.handle.raw(), kCopyTargetLayout, static_cast<uint32_t>(copies.size()),
                   copies.data());
}

Result<GpuTimes> ShadowMaps::Impl::run(const FramePlan& plan, std::vector<CascadeMaps>& target) {
    const auto start = std::chrono::steady_clock::now();
    GpuTimes times;
    times.cascades.resize(static_cast<size_t>(config.cascades));
    if (plan.idle()) return times;
    check(plan);
    if (const auto settled = frame.settle(); !settled) return settled.error();
    if (const auto filled = fill(plan); !filled) return filled.error();
    const auto commandBuffer = frame.begin();
    if (!commandBuffer) return commandBuffer.error();
    record(commandBuffer.value(), plan, target);
    times.recordMs = msSince(start);

    const auto wall = frame.submitAndWait();
    if (!wall) return wall.error();
    times.wallMs = wall.value();
    times.submitted = true;
    for (size_t c = 0; c < plan.cascades.size(); ++c) {
        const CascadePlan& cascade = plan.cascades[c];
        const CascadeWork& w = work[c];
        CascadeTimes& t = times.cascades[c];
        if (drawsStatic(cascade)) t.staticMs = frame.msUntil(w.staticEnd);
        if (!cascade.restores.empty()) t.activeMs += frame.msUntil(w.restoreEnd);
        if (!cascade.activePasses.empty()) t.activeMs += frame.msUntil(w.activeEnd);
    }
    return times;
}

Result<GpuTimes> ShadowMaps::execute(const FramePlan& plan) { return impl_->run(plan, impl_->maps); }

Result<GpuTimes> ShadowMaps::redraw(const FramePlan& plan) {
    if (const auto made = impl_->needScratch(); !made) return made.error();
    return impl_->run(plan, impl_->scratch);
}

Result<std::vector<float>> ShadowMaps::read(int cascade, MapKind kind) {
    Impl& impl = *impl_;
    CHECK(cascade >= 0 && cascade < impl.config.cascades);
    const bool scratch = kind == MapKind::kScratchCache || kind == MapKind::kScratchWorking;
    if (scratch)
        if (const auto made = impl.needScratch(); !made) return made.error();
    CascadeMaps& maps = (scratch ? impl.scratch : impl.maps)[static_cast<size_t>(cascade)];
    DepthMap& map = kind == MapKind::kCache || kind == MapKind::kScratchCache ? maps.cacheMap : maps.working;

    const uint32_t side = static_cast<uint32_t>(impl.config.side);
    std::vector<float> depths(size_t{side} * side);
    const uint64_t bytes = depths.size() * texelBytes(impl.config.format);
    if (const auto settled = impl.frame.settle(); !settled) return settled.error();
    if (impl.readback.bytes == 0) {
        auto made =
            createBuffer(impl.device, bytes, VK_BUFFER_USAGE_TRANSFER_DST_BIT, Home::kReadback, "readback");
        if (!made) return made.error();
        impl.readback = std::move(made.value());
    }
    const auto commandBuffer = impl.frame.begin();
    if (!commandBuffer) return commandBuffer.error();
    impl.frame.need(map, Use::kCopySource);
    impl.frame.barrier();
    VkBufferImageCopy copy{};
    copy.imageSubresource = {VK_IMAGE_ASPECT_DEPTH_BIT, 0, 0, 1};
    copy.imageExtent = {side, side, 1};
    vkCmdCopyImageToBuffer(commandBuffer.value(), map.image.handle.raw(), kCopySourceLayout,
                           impl.readback.raw(), 1, &copy);
    impl.frame.toHost(impl.readback);
    if (const auto submitted = impl.frame.submitAndWait(); !submitted) return submitted.error();
    if (impl.config.format == DepthFormat::kD32) {
        std::memcpy(depths.data(), impl.readback.mapped, bytes);
    } else {
        const auto* const units = reinterpret_cast<const uint16_t*>(impl.readback.mapped);
        std::transform(units, units + depths.size(), depths.begin(),
                       [](uint16_t unit) { return static_cast<float>(unit) / 65535.0f; });
    }
    return depths;
}

}  // namespace gpu
