// gpu/spot_maps.h — the two depth maps of each spot light: made, drawn, read. Part of ShadowMaps.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "gpu/cascade_maps.h"
#include "gpu/depth_pass.h"
#include "gpu/geometry_store.h"

namespace gpu {

/// Lights are numbered from 0 in the order in which they were added; plans have one place of
/// `FramePlan::cascades` for each. Maps are D32, new ones hold kEmptyDepth. Every error is kDevice or kLimit.
class SpotMaps {
public:
    /// `device` must outlive it.
    explicit SpotMaps(Device::Impl& device) : device_(&device) {}

    /// One more light, its maps `side` texels a side. Waits. After an error there are as many as before.
    world::Result<world::Done> add(int side);
    /// Those after it move up. No submission that uses its maps may be under way.
    void remove(size_t light);
    /// Makes scratch maps for lights that have none. Waits.
    world::Result<world::Done> needScratch();

    /// CHECKs that there is a place for each light, or none at all, and what recording relies on.
    void check(const cache::FramePlan& plan, const GeometryStore& geometry) const;
    /// Adds the plan's draws to the frame's, and notes where they are for `record`.
    void fill(const cache::FramePlan& plan, const GeometryStore& geometry, DrawList& draws);
    /// All lights' static parts, then all restores, then all active parts: three barriers in all.
    void record(Frame& frame, VkCommandBuffer commands, const cache::FramePlan& plan,
                const DepthPass::Buffers& buffers, bool scratch);

    /// Waits for everything submitted so far. Depths of a map, row by row, side * side values.
    world::Result<std::vector<float>> read(size_t light, MapKind kind);

private:
    struct Light {
        int side = 0;
        std::string name;
        CascadeMaps maps;
        std::optional<CascadeMaps> scratch;
        std::vector<DepthPass::Draws> staticDraws, activeDraws;  ///< of the plan that was filled last
    };
    world::Result<world::Done> needFrame();
    world::Result<CascadeMaps> makeMaps(int side, const std::string& name);
    world::Result<world::Done> submitAndWait();

    Device::Impl* device_;
    std::optional<DepthPass> pass_;      ///< made with the first light
    std::map<int, Readback> readbacks_;  ///< by side, while a light has it; made at the first read
    std::vector<Light> lights_;
    std::vector<VkImageCopy> copies_;  ///< kept for its memory
    uint64_t named_ = 0;
    std::optional<Frame> frame_;  ///< for what is not part of a plan; made with the first light
};

}  // namespace gpu
