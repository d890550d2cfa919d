// gpu/floor.h — what a frame plan costs when nothing is left to think about: the floor of benchmarks.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "cache/frame_plan.h"
#include "gpu/device.h"
#include "gpu/shadow_maps.h"
#include "world/mesh.h"
#include "world/result.h"

namespace gpu {

/// A bare Vulkan loop over plans that were prepared beforehand. It does the same fills, restores and
/// triangles as ShadowMaps, in the same pipeline state and order, on maps of its own, and leaves the
/// same bits. All else is out of the timing: each pass is one indexed draw of triangles that the CPU
/// has transformed and packed, commands are recorded before the clock starts, no timestamps are taken,
/// and one plan is under way at a time. One thread at a time. Every error is kDevice or kLimit.
class Floor {
public:
    using MeshOf = std::function<const world::MeshLevel&(cache::GeometryId)>;

    /// `device` must outlive it. Of `config`, `geometryBytes`, `framesInFlight` and `timestamps` do not
    /// matter. New maps hold kEmptyDepth everywhere.
    static world::Result<std::unique_ptr<Floor>> create(Device& device, const ShadowMapsConfig& config);
    ~Floor();

    /// Packs the plan's triangles into a buffer of its own; the number to run it by, counted from 0.
    world::Result<size_t> prepare(const cache::FramePlan& plan, const MeshOf& meshOf);
    /// Forgets all prepared plans; numbers begin again.
    void discard();

    /// Executes a prepared plan and waits. From vkQueueSubmit2 to its fence [ms]; 0 for an idle plan,
    /// which submits nothing. Plans may be run in any order and more than once.
    world::Result<double> run(size_t prepared);

    /// As ShadowMaps::read: kCache or kWorking.
    world::Result<std::vector<float>> read(int cascade, MapKind kind);

private:
    struct Impl;
    explicit Floor(std::unique_ptr<Impl> impl);
    std::unique_ptr<Impl> impl_;
};

}  // namespace gpu
