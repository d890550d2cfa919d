// gpu/shadow_maps.h — the maps of cascades and spot lights on the GPU, and the executor of frame plans.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "cache/frame_plan.h"
#include "gpu/device.h"
#include "world/mesh.h"
#include "world/result.h"

namespace gpu {

enum class MapKind {
    kCache,         ///< static casters; persists
    kWorking,       ///< cache plus active casters; what a renderer samples
    kScratchCache,  ///< target of `redraw`, for comparison
    kScratchWorking,
};

/// What one executed plan cost. Timestamps are noisy on software drivers. Zero for an idle plan, which
/// submits nothing.
struct CascadeTimes {
    double staticMs = 0;  ///< clears and static passes, by timestamp
    double activeMs = 0;  ///< restores and active passes, by timestamp
};
struct GpuTimes {
    std::vector<CascadeTimes> cascades;
    double spotsMs = 0;   ///< all spot lights' maps, by timestamp
    double recordMs = 0;  ///< CPU time to fill buffers and record commands
    double wallMs = 0;    ///< from vkQueueSubmit to when its fence was seen, behind earlier plans or not
    bool submitted = false;
};

struct ShadowMapsConfig {
    int cascades = 4;
    int side = 1024;                        ///< texels a side
    uint64_t geometryBytes = 512ull << 20;  ///< size of the arena for vertices and indices
    DepthFormat format = DepthFormat::kD32;
    int framesInFlight = 2;  ///< submissions under way at once, > 0
    bool timestamps = true;  ///< each costs a software driver 0.1 ms; without, cascades' times are 0
};

/// Number of a submitted plan; they ascend.
using Ticket = uint64_t;

/// Owns a cache map and a working map (side x side) per cascade, the same for each spot light in a size and
/// D32 of its own, and an arena of geometry.
/// New maps hold depth 1 everywhere. One thread at a time. Every error is kDevice or kLimit.
class ShadowMaps {
public:
    /// `device` must outlive the maps.
    static world::Result<std::unique_ptr<ShadowMaps>> create(Device& device, const ShadowMapsConfig& config);
    ~ShadowMaps();

    /// Other maps from now on, in the place of those there are; waits for all submissions. Geometry stays.
    ///   from    per new pair of maps: the number of the old pair that it takes over as it is, each at most once, or
    ///           -1 for a new one; all -1 where `side` or `format` change
    /// After an error nothing has changed.
    world::Result<world::Done> reshape(std::span<const int> from, int side, DepthFormat format);

    /// Copies positions and indices into the arena; waits for submitted plans that read what was released there. kLimit names
    /// the budget when it is full.
    world::Result<cache::GeometryId> upload(const world::MeshLevel& level);
    /// No later plan may draw it. Its id and its space are free at once.
    void release(cache::GeometryId id);
    uint64_t geometryBytesUsed() const;
    uint64_t uploadedBytes() const;      ///< since creation: geometry, instances and commands

    /// Lights are numbered from 0 in the order in which they were added; removing one moves those after it
    /// up. Both wait for everything.
    world::Result<world::Done> addSpot(int side);
    world::Result<world::Done> removeSpot(size_t light);

    /// Executes the plan on the cache and working maps in one submission, after those before it; with it a
    /// plan for spot lights, which has a place for each of them, or none. Waits
    /// only for a place: while `framesInFlight` submissions are under way, for the oldest of them. The
    /// plan may change as soon as this returns. An idle plan takes no place and is finished at once.
    world::Result<Ticket> submit(const cache::FramePlan& plan, const cache::FramePlan& spots = {});
    /// Waits for a submitted plan; what it cost. May be asked again, as long as it is `remembered`. After an error
    /// what the maps hold is unknown.
    world::Result<GpuTimes> finish(Ticket ticket);
    /// CPU time that filling buffers and recording commands took, without waiting [ms]; of a plan that is `remembered`.
    double recordMs(Ticket ticket) const;
    /// Fewer than kTicketsKept plans, redraws counted, were submitted since.
    bool remembered(Ticket ticket) const;
    static constexpr Ticket kTicketsKept = 64;
    /// `submit` and `finish`.
    world::Result<GpuTimes> execute(const cache::FramePlan& plan, const cache::FramePlan& spots = {});

    /// Executes the plan on the scratch maps (made at first use) in one submission and waits for
    /// everything. Scratch maps keep what they held, like the real ones: a redraw's plan clears what it
    /// draws.
    world::Result<GpuTimes> redraw(const cache::FramePlan& plan, const cache::FramePlan& spots = {});

    /// Waits for everything. Depths of a map, row by row in stored order, side * side values; units / 65535
    /// for D16.
    world::Result<std::vector<float>> read(int cascade, MapKind kind);
    /// Memory that `copyWorking` writes to from now on: begins and ends at multiples of 4 KiB, and outlives the maps. True
    /// where the GPU writes there by itself, false where the driver imports no such memory and each texel is copied once
    /// more. Waits for everything.
    world::Result<bool> share(std::span<std::byte> memory);
    struct MapCopy {
        int cascade = 0;
        uint64_t offset = 0;  ///< of its first texel in that memory [bytes], a multiple of 4
    };
    /// Waits for everything. Copies working maps, row by row in stored order, as texels are stored: floats or units.
    world::Result<world::Done> copyWorking(std::span<const MapCopy> copies);
    /// The same of a spot light. Scratch maps must have been drawn.
    world::Result<std::vector<float>> readSpot(size_t light, MapKind kind);

private:
    struct Impl;
    explicit ShadowMaps(std::unique_ptr<Impl> impl);
    std::unique_ptr<Impl> impl_;
};

}  // namespace gpu
