#include "tools/lab/view_target.h"

#include <utility>

namespace tools::lab {

using world::Done;
using world::Result;

gpu::DepthFormat formatOf(const culling::ShadowMethod& method) {
    return method.depthBits == 16 ? gpu::DepthFormat::kD16 : gpu::DepthFormat::kD32;
}

Result<ViewTarget> ViewTarget::create(gpu::Device& device, const culling::ShadowMethod& method, int maps) {
    auto made = gpu::ViewMaps::create(
        device, {.maps = maps, .side = method.side, .format = formatOf(method), .geometryBytes = kGeometryBytes});
    if (!made) return made.error();
    ViewTarget target;
    target.maps_ = std::move(made.value());
    return target;
}

cache::GeometryId ViewTarget::geometry(const world::MeshLevel& level) {
    if (const auto known = uploaded_.find(&level); known != uploaded_.end()) return known->second;
    const auto id = maps_->upload(level);
    if (!id) {
        failed_ = id.error();
        return 0;
    }
    return uploaded_[&level] = id.value();
}

Result<Done> ViewTarget::draw(const gpu::ViewPlan& plan) {
    if (failed_) return *failed_;
    if (const auto drawn = maps_->draw(plan); !drawn) return drawn.error();
    return Done{};
}

Result<std::vector<std::vector<float>>> ViewTarget::images(int count) {
    std::vector<std::vector<float>> images;
    for (int map = 0; map < count; ++map) {
        auto read = maps_->read(map);
        if (!read) return read.error();
        images.push_back(std::move(read.value()));
    }
    return images;
}

}  // namespace tools::lab
