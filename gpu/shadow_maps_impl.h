// gpu/shadow_maps_impl.h — what ShadowMaps consists of: its maps, and the frames that are in flight. Of gpu/shadow_maps.cpp and
// gpu/shadow_maps_frames.cpp alone.
#pragma once

#include <array>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "gpu/cascade_maps.h"
#include "gpu/depth_pass.h"
#include "gpu/device_impl.h"
#include "gpu/draw_list.h"
#include "gpu/frame.h"
#include "gpu/geometry_store.h"
#include "gpu/shadow_maps.h"
#include "gpu/spot_maps.h"

namespace gpu {

/// After a cascade's static passes, its restores and its active passes.
/// Each costs a software driver 0.05 to 0.1 ms, so none is taken twice.
constexpr uint32_t kStampsPerCascade = 3;

/// Where one cascade's draws are, and the timestamps that end its parts; the one before starts them.
struct CascadeWork {
    std::vector<DepthPass::Draws> staticDraws, activeDraws;
    uint32_t staticEnd = 0, restoreEnd = 0, activeEnd = 0;  ///< 0: not taken
};

/// What one submission uses until it has finished; then the next one takes the place.
struct Place {
    GrowingBuffer instances, commands;
    std::vector<CascadeWork> work;
    uint32_t spotsEnd = 0;  ///< timestamp that ends the spot lights' part; 0: not taken
    Ticket ticket = 0;  ///< of its last submission; 0: that had none
    Frame frame;        ///< last, so that its destructor waits before the buffers go
};

/// What `finish` tells of a ticket.
struct Outcome {
    GpuTimes times;
    std::optional<world::Error> error;
};

struct ShadowMaps::Impl {
    Device::Impl& device;
    ShadowMapsConfig config;
    std::map<DepthFormat, DepthPass> passOf;  ///< each made once: drivers keep something of a pipeline that is gone
    GeometryStore geometry;
    std::optional<Readback> readback;        ///< made at the first read
    std::optional<Buffer> shared;            ///< over, or beside, the memory that is shared
    std::span<std::byte> sharedMemory;
    std::vector<CascadeMaps> maps, scratch;  ///< scratch: made at first use
    SpotMaps spots;
    DrawList drawList;
    std::vector<VkImageCopy> copies;
    uint64_t uploaded = 0;                       ///< without geometry
    Ticket last = 0;                             ///< given out
    std::array<Outcome, kTicketsKept> outcomes;  ///< by ticket modulo their number
    size_t next = 0;                             ///< place of the next submission; the oldest one is in it
    std::vector<Place> places;                   ///< last: they wait before anything that they use goes

    world::Result<std::vector<CascadeMaps>> makeMaps(const ShadowMapsConfig& of, const std::string& prefix);
    world::Result<world::Done> needPass(DepthFormat format);
    world::Result<world::Done> needScratch();
    void check(const cache::FramePlan& plan) const;
    world::Result<world::Done> fill(const cache::FramePlan& plan, const cache::FramePlan& spotPlan, Place& place);
    void record(VkCommandBuffer commandBuffer, const cache::FramePlan& plan, const DepthPass::Buffers& buffers, Place& place,
                std::vector<CascadeMaps>& target);

    Outcome& outcome(Ticket ticket) { return outcomes[ticket % kTicketsKept]; }
    world::Result<Place*> claim();
    Ticket giveTicket(bool submitted);
    world::Result<world::Done> runAlone(Place& place);
    world::Result<world::Done> settle(Place& place);
    world::Result<world::Done> settleUpTo(Ticket ticket);
    Ticket settledUpTo() const;
    world::Result<Ticket> submit(const cache::FramePlan& plan, const cache::FramePlan& spotPlan, bool toScratch);
    world::Result<GpuTimes> finish(Ticket ticket);
};

}  // namespace gpu
