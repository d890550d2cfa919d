#include "gpu/frame.h"

#include "world/check.h"

namespace gpu {
namespace {

using world::Done;
using world::Result;

/// Longer than any frame on the slowest driver; a GPU that hangs is reset by its driver before.
constexpr uint64_t kTimeoutSeconds = 60;

struct Access {
    VkImageLayout layout;
    VkPipelineStageFlags2 stages;
    VkAccessFlags2 access;
};

Access accessOf(Use use) {
    switch (use) {
        case Use::kNew:
            return {VK_IMAGE_LAYOUT_UNDEFINED, VK_PIPELINE_STAGE_2_NONE, VK_ACCESS_2_NONE};
        case Use::kAttachment:
            return {
                kAttachmentLayout,
                VK_PIPELINE_STAGE_2_EARLY_FRAGMENT_TESTS_BIT | VK_PIPELINE_STAGE_2_LATE_FRAGMENT_TESTS_BIT,
                VK_ACCESS_2_DEPTH_STENCIL_ATTACHMENT_READ_BIT |
                    VK_ACCESS_2_DEPTH_STENCIL_ATTACHMENT_WRITE_BIT};
        case Use::kCopySource:
            return {kCopySourceLayout, VK_PIPELINE_STAGE_2_COPY_BIT, VK_ACCESS_2_TRANSFER_READ_BIT};
        case Use::kCopyTarget:
            return {kCopyTargetLayout, VK_PIPELINE_STAGE_2_COPY_BIT, VK_ACCESS_2_TRANSFER_WRITE_BIT};
        case Use::kSampled:
            return {kSampledLayout, VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT, VK_ACCESS_2_SHADER_SAMPLED_READ_BIT};
    }
    CHECK(false);
}

}  // namespace

Result<Frame> Frame::create(Device::Impl& device, uint32_t stamps, const std::string& name) {
    Frame frame(device);
    frame.name_ = name;
    VkCommandPoolCreateInfo pool{};
    pool.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO;
    pool.flags = VK_COMMAND_POOL_CREATE_TRANSIENT_BIT;
    pool.queueFamilyIndex = device.queueFamily;
    auto poolHandle = CommandPoolHandle::create(device.owner, pool, name + " command pool");
    if (!poolHandle) return poolHandle.error();
    frame.pool_ = std::move(poolHandle.value());

    VkCommandBufferAllocateInfo commands{};
    commands.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO;
    commands.commandPool = frame.pool_.raw();
    commands.level = VK_COMMAND_BUFFER_LEVEL_PRIMARY;
    commands.commandBufferCount = 1;
    const VkResult allocated = vkAllocateCommandBuffers(device.owner.device, &commands, &frame.commands_);
    if (allocated != VK_SUCCESS) return refused(allocated, "vkAllocateCommandBuffers", name);
    device.owner.name(VK_OBJECT_TYPE_COMMAND_BUFFER, reinterpret_cast<uint64_t>(frame.commands_),
                      name + " commands");

    VkFenceCreateInfo fence{};
    fence.sType = VK_STRUCTURE_TYPE_FENCE_CREATE_INFO;
    auto fenceHandle = FenceHandle::create(device.owner, fence, name + " fence");
    if (!fenceHandle) return fenceHandle.error();
    frame.fence_ = std::move(fenceHandle.value());

    if (device.timestampMs == 0 || stamps == 0) return frame;
    VkQueryPoolCreateInfo queries{};
    queries.sType = VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO;
    queries.queryType = VK_QUERY_TYPE_TIMESTAMP;
    queries.queryCount = stamps;
    auto queryHandle = QueryPoolHandle::create(device.owner, queries, name + " timestamps");
    if (!queryHandle) return queryHandle.error();
    frame.queries_ = std::move(queryHandle.value());
    frame.stampLimit_ = stamps;
    return frame;
}

Frame::~Frame() {
    // Nothing better is left to do than to free what a GPU that never answers may still use.
    static_cast<void>(settle());
}

Result<Done> Frame::settle() {
    if (!pending_) return Done{};
    const VkFence fence = fence_.raw();
    const VkResult waited =
        vkWaitForFences(device_->owner.device, 1, &fence, VK_TRUE, kTimeoutSeconds * 1'000'000'000);
    // A lost device has no work under way any more.
    if (waited == VK_SUCCESS || waited == VK_ERROR_DEVICE_LOST) pending_ = false;
    if (waited != VK_SUCCESS) return refused(waited, "vkWaitForFences", name_);
    const std::chrono::duration<double, std::milli> elapsed = std::chrono::steady_clock::now() - submitted_;
    wallMs_ = elapsed.count();
    if (stampCount_ == 0) return Done{};
    ticks_.resize(stampCount_);
    const VkResult read = vkGetQueryPoolResults(
        device_->owner.device, queries_.raw(), 0, stampCount_, ticks_.size() * sizeof(uint64_t),
        ticks_.data(), sizeof(uint64_t), VK_QUERY_RESULT_64_BIT | VK_QUERY_RESULT_WAIT_BIT);
    if (read != VK_SUCCESS) return refused(read, "vkGetQueryPoolResults", name_);
    return Done{};
}

Result<VkCommandBuffer> Frame::begin() {
    CHECK(!pending_);
    changes_.clear();
    barriers_.clear();
    stampCount_ = 0;
    const VkResult reset = vkResetCommandPool(device_->owner.device, pool_.raw(), 0);
    if (reset != VK_SUCCESS) return refused(reset, "vkResetCommandPool", name_);
    VkCommandBufferBeginInfo info{};
    info.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO;
    info.flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT;
    const VkResult begun = vkBeginCommandBuffer(commands_, &info);
    if (begun != VK_SUCCESS) return refused(begun, "vkBeginCommandBuffer", name_);
    if (stampLimit_ > 0) vkCmdResetQueryPool(commands_, queries_.raw(), 0, stampLimit_);
    return commands_;
}

void Frame::need(DepthMap& map, Use use) {
    // Reads need not wait for reads. Writes wait for writes, those of earlier submissions too: their
    // fence made them available, not visible.
    if (map.use == use && (use == Use::kCopySource || use == Use::kSampled)) return;
    const Access from = accessOf(map.use), to = accessOf(use);
    VkImageMemoryBarrier2 barrier{};
    barrier.sType = VK_STRUCTURE_TYPE_IMAGE_MEMORY_BARRIER_2;
    barrier.srcStageMask = from.stages;
    barrier.srcAccessMask = from.access;
    barrier.dstStageMask = to.stages;
    barrier.dstAccessMask = to.access;
    barrier.oldLayout = from.layout;
    barrier.newLayout = to.layout;
    barrier.srcQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED;
    barrier.dstQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED;
    barrier.image = map.image.handle.raw();
    barrier.subresourceRange = {VK_IMAGE_ASPECT_DEPTH_BIT, 0, 1, 0, VK_REMAINING_ARRAY_LAYERS};
    barriers_.push_back(barrier);
    changes_.push_back({&map, map.use});
    map.use = use;
}

void Frame::barrier() {
    if (barriers_.empty()) return;
    VkDependencyInfo dependency{};
    dependency.sType = VK_STRUCTURE_TYPE_DEPENDENCY_INFO;
    dependency.imageMemoryBarrierCount = static_cast<uint32_t>(barriers_.size());
    dependency.pImageMemoryBarriers = barriers_.data();
    vkCmdPipelineBarrier2(commands_, &dependency);
    barriers_.clear();
}

void Frame::toHost(const Buffer& buffer) {
    wait(buffer,
         {VK_PIPELINE_STAGE_2_COPY_BIT | VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT,
          VK_ACCESS_2_TRANSFER_WRITE_BIT | VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT},
         {VK_PIPELINE_STAGE_2_HOST_BIT, VK_ACCESS_2_HOST_READ_BIT});
}

void Frame::order(const Buffer& buffer) {
    const BufferUse use{VK_PIPELINE_STAGE_2_COPY_BIT | VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT,
                        VK_ACCESS_2_TRANSFER_READ_BIT | VK_ACCESS_2_TRANSFER_WRITE_BIT |
                            VK_ACCESS_2_SHADER_STORAGE_READ_BIT | VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT};
    wait(buffer, use, use);
}

void Frame::wait(const Buffer& buffer, const BufferUse& before, const BufferUse& after) {
    VkBufferMemoryBarrier2 barrier{};
    barrier.sType = VK_STRUCTURE_TYPE_BUFFER_MEMORY_BARRIER_2;
    barrier.srcStageMask = before.stages;
    barrier.srcAccessMask = before.access;
    barrier.dstStageMask = after.stages;
    barrier.dstAccessMask = after.access;
    barrier.srcQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED;
    barrier.dstQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED;
    barrier.buffer = buffer.raw();
    barrier.size = VK_WHOLE_SIZE;
    VkDependencyInfo dependency{};
    dependency.sType = VK_STRUCTURE_TYPE_DEPENDENCY_INFO;
    dependency.bufferMemoryBarrierCount = 1;
    dependency.pBufferMemoryBarriers = &barrier;
    vkCmdPipelineBarrier2(commands_, &dependency);
}

uint32_t Frame::stamp() {
    if (stampLimit_ == 0) return 0;
    CHECK(stampCount_ < stampLimit_);
    const VkPipelineStageFlags2 stage =
        stampCount_ == 0 ? VK_PIPELINE_STAGE_2_TOP_OF_PIPE_BIT : VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT;
    vkCmdWriteTimestamp2(commands_, stage, queries_.raw(), stampCount_);
    return stampCount_++;
}

Result<Done> Frame::submit() {
    CHECK(barriers_.empty());
    const auto undo = [this] {
        for (auto change = changes_.rbegin(); change != changes_.rend(); ++change)
            change->map->use = change->before;
    };
    const VkResult ended = vkEndCommandBuffer(commands_);
    const VkFence fence = fence_.raw();
    const VkResult reset = ended != VK_SUCCESS ? ended : vkResetFences(device_->owner.device, 1, &fence);
    if (reset != VK_SUCCESS) {
        undo();
        return refused(reset, ended != VK_SUCCESS ? "vkEndCommandBuffer" : "vkResetFences", name_);
    }
    VkCommandBufferSubmitInfo commands{};
    commands.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_SUBMIT_INFO;
    commands.commandBuffer = commands_;
    VkSubmitInfo2 submit{};
    submit.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO_2;
    submit.commandBufferInfoCount = 1;
    submit.pCommandBufferInfos = &commands;
    submitted_ = std::chrono::steady_clock::now();
    const std::lock_guard lock(device_->queueMutex);
    const bool lost = device_->loseAfter > 0 && ++device_->submissions > device_->loseAfter;
    const VkResult submitted = lost ? VK_ERROR_DEVICE_LOST : vkQueueSubmit2(device_->queue, 1, &submit, fence);
    if (submitted != VK_SUCCESS) {
        undo();
        return refused(submitted, "vkQueueSubmit2", name_);
    }
    pending_ = true;
    return Done{};
}

double Frame::msUntil(uint32_t end) const {
    if (stampCount_ == 0) return 0;
    CHECK(end > 0 && end < stampCount_);
    return static_cast<double>((ticks_[end] - ticks_[end - 1]) & device_->timestampMask) *
           device_->timestampMs;
}

}  // namespace gpu
