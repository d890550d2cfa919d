#include "gpu/floor.h"

#include <algorithm>
#include <cstring>
#include <string>

#include "gpu/cascade_maps.h"
#include "gpu/depth_pipeline.h"
#include "gpu/shaders/floor.vert.h"
#include "world/check.h"

namespace gpu {
namespace {

using cache::DrawPass;
using cache::FramePlan;
using cache::StoreRect;
using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

/// One indexed draw: a whole pass.
struct Draw {
    StoreRect scissor;
    uint32_t firstIndex = 0, indexCount = 0;
};

struct CascadeDraws {
    std::vector<StoreRect> unknowns, clears, restores;
    std::vector<Draw> statics, actives;

    bool drawsStatic() const { return !unknowns.empty() || !clears.empty() || !statics.empty(); }
};

struct Prepared {
    std::vector<CascadeDraws> cascades;
    Buffer buffer;  ///< positions, then indices; none if nothing is drawn
    uint64_t indexOffset = 0;
    bool idle = true;
};

/// The triangles of a plan in one piece.
struct Packed {
    std::vector<glm::vec3> positions;  ///< in clip space
    std::vector<uint32_t> indices;
    std::vector<uint32_t>
        placeOf;  ///< of one item: position in the mesh to position here; kept for its memory

    void add(const cache::DrawItem& item, const glm::mat3x4& m, const world::MeshLevel& level) {
        CHECK(item.firstIndex <= level.indices.size() &&
              item.indexCount <= level.indices.size() - item.firstIndex);
        constexpr uint32_t kNone = UINT32_MAX;
        placeOf.assign(level.positions.size(), kNone);
        for (uint32_t i = item.firstIndex; i < item.firstIndex + item.indexCount; ++i) {
            const uint32_t index = level.indices[i];
            if (placeOf[index] == kNone) {
                placeOf[index] = static_cast<uint32_t>(positions.size());
                positions.push_back(toClip(m, level.positions[index]));
            }
            indices.push_back(placeOf[index]);
        }
    }
    /// The shader's arithmetic, step by step.
    static glm::vec3 toClip(const glm::mat3x4& m, const glm::vec3& v) {
        glm::vec3 p(m[0].x * v.x, m[1].x * v.x, m[2].x * v.x);
        p += glm::vec3(m[0].y * v.y, m[1].y * v.y, m[2].y * v.y);
        p += glm::vec3(m[0].z * v.z, m[1].z * v.z, m[2].z * v.z);
        return p + glm::vec3(m[0].w, m[1].w, m[2].w);
    }
};

}  // namespace

struct Floor::Impl {
    Device::Impl& device;
    ShadowMapsConfig config;
    DepthPipeline pipeline;
    std::vector<CascadeMaps> maps;
    Readback readback;
    std::vector<Prepared> prepared;
    std::vector<VkClearRect> fillRects;  ///< kept for their memory
    std::vector<VkImageCopy> copies;
    Frame frame;  ///< last, so that its destructor waits before anything that it uses goes

    void draw(VkCommandBuffer commands, const Prepared& plan, std::span<const Draw> draws) const;
    void record(VkCommandBuffer commands, const Prepared& plan);
    Result<Done> submitAndWait();
};

Result<std::unique_ptr<Floor>> Floor::create(Device& device, const ShadowMapsConfig& config) {
    CHECK(config.cascades > 0 && config.side > 0);
    Device::Impl& d = device.impl();
    const uint32_t side = static_cast<uint32_t>(config.side);
    if (side > d.maxSide)
        return Error{ErrorCode::kLimit, "floor: '" + d.name + "' draws at most " + std::to_string(d.maxSide) +
                                            " texels a side; lower --resolution"};
    VkPipelineVertexInputStateCreateInfo vertices{};
    vertices.sType = VK_STRUCTURE_TYPE_PIPELINE_VERTEX_INPUT_STATE_CREATE_INFO;
    vertices.vertexBindingDescriptionCount = 1;
    vertices.pVertexBindingDescriptions = &kPositionBinding;
    vertices.vertexAttributeDescriptionCount = 1;
    vertices.pVertexAttributeDescriptions = &kPosition;
    auto pipeline = createDepthPipeline(
        d, {.vertexShader = kFloorVert, .vertices = vertices, .format = config.format, .name = "floor"});
    if (!pipeline) return pipeline.error();
    auto maps = createCascadeMaps(d, config, "floor ");
    if (!maps) return maps.error();
    auto readback = Readback::create(d, side, config.format);
    if (!readback) return readback.error();
    auto frame = Frame::create(d, 0, "floor frame");
    if (!frame) return frame.error();
    std::unique_ptr<Impl> impl(new Impl{.device = d,
                                        .config = config,
                                        .pipeline = std::move(pipeline.value()),
                                        .maps = std::move(maps.value()),
                                        .readback = std::move(readback.value()),
                                        .prepared = {},
                                        .fillRects = {},
                                        .copies = {},
                                        .frame = std::move(frame.value())});
    const auto commands = impl->frame.begin();
    if (!commands) return commands.error();
    recordNew(impl->frame, commands.value(), impl->maps, side);
    if (const auto done = impl->submitAndWait(); !done) return done.error();
    return std::unique_ptr<Floor>(new Floor(std::move(impl)));
}

Floor::Floor(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Floor::~Floor() = default;

Result<size_t> Floor::prepare(const FramePlan& plan, const MeshOf& meshOf) {
    CHECK(plan.cascades.size() <= static_cast<size_t>(impl_->config.cascades));
    Prepared made;
    made.idle = plan.idle();
    Packed packed;
    const auto pack = [&](const std::vector<DrawPass>& passes) {
        std::vector<Draw> draws;
        for (const DrawPass& pass : passes) {
            const auto first = static_cast<uint32_t>(packed.indices.size());
            for (uint32_t i = pass.firstItem; i < pass.firstItem + pass.itemCount; ++i) {
                const cache::DrawItem& item = plan.items[i];
                packed.add(item, plan.transforms[item.transform], meshOf(item.geometry));
            }
            draws.push_back({pass.scissor, first, static_cast<uint32_t>(packed.indices.size()) - first});
        }
        return draws;
    };
    for (const cache::CascadePlan& c : plan.cascades)
        made.cascades.push_back(
            {c.unknowns, c.clears, c.restores, pack(c.staticPasses), pack(c.activePasses)});
    if (packed.indices.size() > UINT32_MAX)
        return Error{ErrorCode::kLimit,
                     "floor: " + std::to_string(packed.indices.size() / 3) + " triangles in one plan"};
    if (!packed.indices.empty()) {
        const uint64_t positionBytes = packed.positions.size() * sizeof(glm::vec3);
        const uint64_t indexBytes = packed.indices.size() * sizeof(uint32_t);
        auto buffer = createBuffer(impl_->device, positionBytes + indexBytes,
                                   VK_BUFFER_USAGE_VERTEX_BUFFER_BIT | VK_BUFFER_USAGE_INDEX_BUFFER_BIT,
                                   Home::kUpload, "floor plan " + std::to_string(impl_->prepared.size()));
        if (!buffer) return buffer.error();
        made.buffer = std::move(buffer.value());
        made.indexOffset = positionBytes;
        std::memcpy(made.buffer.mapped, packed.positions.data(), positionBytes);
        std::memcpy(made.buffer.mapped + positionBytes, packed.indices.data(), indexBytes);
    }
    impl_->prepared.push_back(std::move(made));
    return impl_->prepared.size() - 1;
}

void Floor::discard() { impl_->prepared.clear(); }

void Floor::Impl::draw(VkCommandBuffer commands, const Prepared& plan, std::span<const Draw> draws) const {
    if (plan.buffer.bytes == 0) return;
    bindDepth(commands, pipeline, static_cast<uint32_t>(config.side));
    const VkBuffer buffer = plan.buffer.raw();
    const VkDeviceSize start = 0;
    vkCmdBindVertexBuffers(commands, 0, 1, &buffer, &start);
    vkCmdBindIndexBuffer(commands, buffer, plan.indexOffset, VK_INDEX_TYPE_UINT32);
    for (const Draw& d : draws) {
        if (empty(d.scissor) || d.indexCount == 0) continue;
        const VkRect2D scissor = toVulkan(d.scissor);
        vkCmdSetScissor(commands, 0, 1, &scissor);
        vkCmdDrawIndexed(commands, d.indexCount, 1, d.firstIndex, 0, 0);
    }
}

void Floor::Impl::record(VkCommandBuffer commands, const Prepared& plan) {
    const uint32_t side = static_cast<uint32_t>(config.side);
    const size_t count = plan.cascades.size();
    for (size_t c = 0; c < count; ++c)
        if (plan.cascades[c].drawsStatic()) frame.need(maps[c].cacheMap, Use::kAttachment);
    frame.barrier();
    for (size_t c = 0; c < count; ++c) {
        const CascadeDraws& cascade = plan.cascades[c];
        if (!cascade.drawsStatic()) continue;
        beginDepth(commands, maps[c].cacheMap.image, side, VK_ATTACHMENT_LOAD_OP_LOAD);
        fillDepth(commands, cascade.unknowns, cache::kUnknownDepth, fillRects);
        fillDepth(commands, cascade.clears, cache::kEmptyDepth, fillRects);
        draw(commands, plan, cascade.statics);
        vkCmdEndRendering(commands);
    }
    for (size_t c = 0; c < count; ++c) {
        if (plan.cascades[c].restores.empty()) continue;
        frame.need(maps[c].cacheMap, Use::kCopySource);
        frame.need(maps[c].working, Use::kCopyTarget);
    }
    frame.barrier();
    for (size_t c = 0; c < count; ++c) recordRestores(commands, maps[c], plan.cascades[c].restores, copies);
    for (size_t c = 0; c < count; ++c)
        if (!plan.cascades[c].actives.empty()) frame.need(maps[c].working, Use::kAttachment);
    frame.barrier();
    for (size_t c = 0; c < count; ++c) {
        if (plan.cascades[c].actives.empty()) continue;
        beginDepth(commands, maps[c].working.image, side, VK_ATTACHMENT_LOAD_OP_LOAD);
        draw(commands, plan, plan.cascades[c].actives);
        vkCmdEndRendering(commands);
    }
}

Result<Done> Floor::Impl::submitAndWait() {
    if (const auto submitted = frame.submit(); !submitted) return submitted;
    return frame.settle();
}

Result<double> Floor::run(size_t prepared) {
    Impl& impl = *impl_;
    CHECK(prepared < impl.prepared.size());
    if (impl.prepared[prepared].idle) return 0.0;
    const auto commands = impl.frame.begin();
    if (!commands) return commands.error();
    impl.record(commands.value(), impl.prepared[prepared]);
    if (const auto done = impl.submitAndWait(); !done) return done.error();
    return impl.frame.wallMs();
}

Result<std::vector<float>> Floor::read(int cascade, MapKind kind) {
    Impl& impl = *impl_;
    CHECK(cascade >= 0 && cascade < impl.config.cascades);
    CHECK(kind == MapKind::kCache || kind == MapKind::kWorking);
    CascadeMaps& pair = impl.maps[static_cast<size_t>(cascade)];
    const auto commands = impl.frame.begin();
    if (!commands) return commands.error();
    impl.readback.record(impl.frame, commands.value(),
                         kind == MapKind::kCache ? pair.cacheMap : pair.working);
    if (const auto done = impl.submitAndWait(); !done) return done.error();
    return impl.readback.depths();
}

}  // namespace gpu
