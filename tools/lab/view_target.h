// tools/lab/view_target.h — maps on the GPU that views are drawn to, and the geometry that came there with them.
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "culling/shadow_method.h"
#include "gpu/device.h"
#include "gpu/view_maps.h"
#include "world/mesh.h"
#include "world/result.h"

namespace tools::lab {

/// Geometry on the GPU, all of a scene's that is ever drawn: no method of the lab is judged by it.
constexpr uint64_t kGeometryBytes = 2ull << 30;

gpu::DepthFormat formatOf(const culling::ShadowMethod& method);

/// Errors of the GPU pass through.
class ViewTarget {
public:
    /// `maps` of the method's side and depth. `device` must outlive it.
    static world::Result<ViewTarget> create(gpu::Device& device, const culling::ShadowMethod& method, int maps);

    /// Uploaded when it is first asked for. `draw` tells what failed.
    cache::GeometryId geometry(const world::MeshLevel& level);
    world::Result<world::Done> draw(const gpu::ViewPlan& plan);
    /// Of the first `count` maps, row by row.
    world::Result<std::vector<std::vector<float>>> images(int count);

private:
    std::unique_ptr<gpu::ViewMaps> maps_;
    std::map<const world::MeshLevel*, cache::GeometryId> uploaded_;
    std::optional<world::Error> failed_;
};

}  // namespace tools::lab
