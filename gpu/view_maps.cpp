#include "gpu/view_maps.h"

#include <chrono>
#include <string>

#include "gpu/cascade_maps.h"
#include "gpu/depth_pass.h"
#include "gpu/device_impl.h"
#include "gpu/draw_list.h"
#include "gpu/frame.h"
#include "gpu/geometry_store.h"
#include "gpu/map_moves.h"
#include "world/check.h"

namespace gpu {
namespace {

using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

constexpr uint64_t kFirstBytes = 64 << 10;

DepthPass::View viewOf(const ViewPass& pass) {
    DepthPass::View view;
    view.clipFromView = pass.clipFromView;
    for (size_t i = 0; i < pass.wedge.size(); ++i)
        view.wedge[i] = glm::vec4(pass.wedge[i], pass.wedge[i] == glm::vec3(0) ? 1.0f : 0.0f);
    view.slopeBias = pass.slopeBias;
    return view;
}

}  // namespace

struct ViewMaps::Impl {
    Device::Impl& device;
    ViewMapsConfig config;
    DepthPass depthPass;
    GeometryStore geometry;
    GrowingBuffer instances, commands;
    Readback readback;
    std::vector<DepthMap> maps;
    std::optional<MapMoves> moves;  ///< made when a plan first has some
    DrawList drawList;
    std::vector<DepthPass::View> views;  ///< of the plan that is drawn
    Frame frame;                         ///< last, so that its destructor waits before the rest goes

    Result<Done> clearNew();
    Result<Done> reserve(size_t items);
    void record(VkCommandBuffer commandBuffer, const ViewPlan& plan, size_t items);
};

Result<std::unique_ptr<ViewMaps>> ViewMaps::create(Device& device, const ViewMapsConfig& config) {
    CHECK(config.maps > 0 && config.side > 0);
    Device::Impl& d = device.impl();
    const auto side = static_cast<uint32_t>(config.side);
    if (side > d.maxSide)
        return Error{ErrorCode::kLimit, "maps of " + std::to_string(side) + " texels a side: '" + d.name +
                                            "' draws at most " + std::to_string(d.maxSide) + "; lower the resolution"};
    auto pass = DepthPass::create(d, config.format, Projection::kView);
    if (!pass) return pass.error();
    auto geometry = GeometryStore::create(d, config.geometryBytes);
    if (!geometry) return geometry.error();
    auto instances = GrowingBuffer::create(d, kFirstBytes, VK_BUFFER_USAGE_VERTEX_BUFFER_BIT, "view instances");
    if (!instances) return instances.error();
    auto commands = GrowingBuffer::create(d, kFirstBytes, VK_BUFFER_USAGE_INDIRECT_BUFFER_BIT, "view draws");
    if (!commands) return commands.error();
    auto readback = Readback::create(d, side, config.format);
    if (!readback) return readback.error();
    std::vector<DepthMap> maps(static_cast<size_t>(config.maps));
    for (size_t m = 0; m < maps.size(); ++m) {
        auto image = createDepthImage(d, side, config.format, "view map " + std::to_string(m));
        if (!image) return image.error();
        maps[m].image = std::move(image.value());
    }
    auto frame = Frame::create(d, 0, "view maps frame");
    if (!frame) return frame.error();
    std::unique_ptr<Impl> impl(new Impl{.device = d,
                                        .config = config,
                                        .depthPass = std::move(pass.value()),
                                        .geometry = std::move(geometry.value()),
                                        .instances = std::move(instances.value()),
                                        .commands = std::move(commands.value()),
                                        .readback = std::move(readback.value()),
                                        .maps = std::move(maps),
                                        .moves = {},
                                        .drawList = {},
                                        .views = {},
                                        .frame = std::move(frame.value())});
    if (const auto cleared = impl->clearNew(); !cleared) return cleared.error();
    return std::unique_ptr<ViewMaps>(new ViewMaps(std::move(impl)));
}

ViewMaps::ViewMaps(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
ViewMaps::~ViewMaps() = default;

Result<cache::GeometryId> ViewMaps::upload(const world::MeshLevel& level) {
    return impl_->geometry.upload(level, {});  // nothing is released here, and nobody awaited
}

Result<Done> ViewMaps::Impl::clearNew() {
    const auto commandBuffer = frame.begin();
    if (!commandBuffer) return commandBuffer.error();
    for (DepthMap& map : maps) frame.need(map, Use::kAttachment);
    frame.barrier();
    for (const DepthMap& map : maps) {
        beginDepth(commandBuffer.value(), map.image, static_cast<uint32_t>(config.side), VK_ATTACHMENT_LOAD_OP_CLEAR);
        vkCmdEndRendering(commandBuffer.value());
    }
    if (const auto submitted = frame.submit(); !submitted) return submitted;
    return frame.settle();
}

Result<Done> ViewMaps::Impl::reserve(size_t items) {
    const uint64_t bytes = items * sizeof(glm::mat3x4);
    if (bytes > device.maxAllocationBytes / 2)  // a doubled buffer must still be one that the device can give
        return Error{ErrorCode::kLimit, "view plan: " + std::to_string(items) + " draws are more than '" + device.name +
                                            "' takes at once; lower the far distance"};
    if (const auto more = instances.reserve(device, bytes); !more) return more;
    return commands.reserve(device, items * sizeof(VkDrawIndexedIndirectCommand));
}

/// `items` have been reserved.
void ViewMaps::Impl::record(VkCommandBuffer commandBuffer, const ViewPlan& plan, size_t items) {
    const cache::StoreRect whole{{0, 0}, {config.side, config.side}};
    drawList.begin({reinterpret_cast<VkDrawIndexedIndirectCommand*>(commands.buffer().mapped), items},
                   {reinterpret_cast<glm::mat3x4*>(instances.buffer().mapped), items});
    views.clear();
    for (const ViewPass& pass : plan.passes) views.push_back(viewOf(pass));
    const DepthPass::Buffers buffers{
        .geometry = geometry.buffer(), .instances = instances.buffer(), .commands = commands.buffer()};
    std::vector<std::vector<DepthPass::Draws>> draws(maps.size());
    std::vector<std::vector<cache::StoreRect>> clears(maps.size());
    for (const int map : plan.clears) clears.at(size_t(map)).push_back(whole);
    for (size_t p = 0; p < plan.passes.size(); ++p) {
        const ViewPass& pass = plan.passes[p];
        CHECK(pass.firstItem <= plan.items.size() && pass.itemCount <= plan.items.size() - pass.firstItem);
        draws.at(size_t(pass.map))
            .push_back({pass.scissor.value_or(whole), drawList.add(std::span(plan.items).subspan(pass.firstItem, pass.itemCount),
                                            geometry.ranges(), plan.transforms), &views[p]});
    }
    for (const MapMove& move : plan.moves) moves->record(frame, commandBuffer, maps, move);
    for (size_t m = 0; m < maps.size(); ++m)
        if (!clears[m].empty() || !draws[m].empty()) frame.need(maps[m], Use::kAttachment);
    frame.barrier();
    for (size_t m = 0; m < maps.size(); ++m)
        if (!clears[m].empty() || !draws[m].empty())
            depthPass.record(commandBuffer, maps[m].image, static_cast<uint32_t>(config.side), {{}, clears[m], draws[m]}, buffers);
}

Result<ViewTimes> ViewMaps::draw(const ViewPlan& plan) {
    Impl& impl = *impl_;
    for (const cache::DrawItem& item : plan.items) CHECK(impl.geometry.live(item.geometry));
    const auto start = std::chrono::steady_clock::now();
    size_t items = 0;  // an item may be drawn by several passes
    for (const ViewPass& pass : plan.passes) items += pass.itemCount;
    if (const auto room = impl.reserve(items); !room) return room.error();
    if (!plan.moves.empty() && !impl.moves) {
        auto moves = MapMoves::create(impl.device, static_cast<uint32_t>(impl.config.side), impl.config.format);
        if (!moves) return moves.error();
        impl.moves = std::move(moves.value());
    }
    const auto commandBuffer = impl.frame.begin();
    if (!commandBuffer) return commandBuffer.error();
    impl.record(commandBuffer.value(), plan, items);
    ViewTimes times;
    times.recordMs = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
    if (const auto submitted = impl.frame.submit(); !submitted) return submitted.error();
    if (const auto settled = impl.frame.settle(); !settled) return settled.error();
    times.wallMs = impl.frame.wallMs();
    return times;
}

Result<std::vector<float>> ViewMaps::read(int map) {
    Impl& impl = *impl_;
    const auto commandBuffer = impl.frame.begin();
    if (!commandBuffer) return commandBuffer.error();
    impl.readback.record(impl.frame, commandBuffer.value(), impl.maps.at(size_t(map)));
    if (const auto submitted = impl.frame.submit(); !submitted) return submitted.error();
    if (const auto settled = impl.frame.settle(); !settled) return settled.error();
    return impl.readback.depths();
}

}  // namespace gpu
