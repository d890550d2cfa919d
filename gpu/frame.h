// gpu/frame.h — one submission to the GPU: its commands, its timestamps, and every barrier there is.
#pragma once

#include <chrono>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "gpu/memory.h"

namespace gpu {

/// What a depth map is being used for; says which layout it is in and which accesses came last.
enum class Use {
    kNew,         ///< holds nothing yet
    kAttachment,  ///< cleared and drawn to
    kCopySource,
    kCopyTarget,
    kSampled,  ///< read by compute shaders
};

struct DepthMap {
    Image image;
    Use use = Use::kNew;
};

/// Layouts that `Frame::barrier` brings maps into.
constexpr VkImageLayout kAttachmentLayout = VK_IMAGE_LAYOUT_DEPTH_STENCIL_ATTACHMENT_OPTIMAL;
constexpr VkImageLayout kCopySourceLayout = VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL;
constexpr VkImageLayout kCopyTargetLayout = VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL;
constexpr VkImageLayout kSampledLayout = VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL;

/// Records and submits, one submission at a time, used over and over:
/// settle, begin, record (need, barrier, stamp), submit. Several of them may be under way at once on
/// the same maps if they are submitted in the order in which they were recorded.
/// The device must outlive it, and so must every map that was needed. One thread at a time.
class Frame {
public:
    /// `stamps` is the most timestamps of one submission; 0: none are taken.
    static world::Result<Frame> create(Device::Impl& device, uint32_t stamps, const std::string& name);
    Frame(Frame&&) = default;
    Frame& operator=(Frame&&) = delete;
    /// Waits for a submission that did not answer in time, once more and as long.
    ~Frame();

    /// Returns once no submission is under way, after at most kTimeoutSeconds. Memory that the GPU
    /// reads may be written or freed afterwards. After a lost device or a timeout what maps hold is
    /// unknown.
    world::Result<world::Done> settle();
    bool pending() const { return pending_; }  ///< submitted, its end not seen

    /// Opens the command buffer; settle first.
    world::Result<VkCommandBuffer> begin();
    /// Notes that the commands after the next `barrier` use `map` so.
    void need(DepthMap& map, Use use);
    /// Records one barrier for all needs noted; none if nothing has to wait.
    void barrier();
    /// Makes what copies and compute shaders wrote to `buffer` visible to the CPU after the fence.
    void toHost(const Buffer& buffer);
    /// Copies and compute shaders after it use `buffer` when those before it are done, and see what they wrote.
    void order(const Buffer& buffer);
    /// Takes a timestamp when all commands before it are done, the first one at once; its number.
    uint32_t stamp();

    /// Submits and does not wait. After an error maps are as they were before `begin`.
    world::Result<world::Done> submit();
    /// From the last submission to when its end was seen [ms].
    double wallMs() const { return wallMs_; }
    /// From the stamp before to stamp `end` > 0 of the last submission, which has been settled [ms];
    /// 0 where no timestamps are taken.
    double msUntil(uint32_t end) const;

private:
    struct Change {
        DepthMap* map = nullptr;
        Use before = Use::kNew;
    };
    struct BufferUse {
        VkPipelineStageFlags2 stages = 0;
        VkAccessFlags2 access = 0;
    };
    explicit Frame(Device::Impl& device) : device_(&device) {}
    void wait(const Buffer& buffer, const BufferUse& before, const BufferUse& after);

    Device::Impl* device_;
    std::string name_;
    CommandPoolHandle pool_;
    VkCommandBuffer commands_ = VK_NULL_HANDLE;  ///< freed with its pool
    FenceHandle fence_;
    QueryPoolHandle queries_;
    uint32_t stampCount_ = 0, stampLimit_ = 0;
    std::vector<uint64_t> ticks_;
    std::vector<VkImageMemoryBarrier2> barriers_;  ///< noted, not recorded yet
    std::vector<Change> changes_;                  ///< of map uses since begin, to undo
    std::chrono::steady_clock::time_point submitted_;
    double wallMs_ = 0;
    bool pending_ = false;
};

}  // namespace gpu
