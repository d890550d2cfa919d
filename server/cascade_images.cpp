#include "server/cascade_images.h"

#include <algorithm>

#include "cache/lattice.h"

namespace server {
namespace {

culling::ShadowView shadowViewOf(const CascadeView& cascade, int side, double begin, int map) {
    culling::ShadowView view;
    const double edge = cascade.texel * side;
    // A cascade's depths are told as they are stored, a view's as they are before that.
    const double range = cascade.depthRange * (1 - double(cache::kNearestDepth));
    view.clipFromLight = {{2 / edge, 0, 0, 0}, {0, 2 / edge, 0, 0}, {0, 0, 1 / range, 0}, {-1, -1, 0, 1}};
    view.low = glm::dvec2(cascade.window) * cascade.texel;
    view.high = view.low + edge;
    view.origin = {view.low, cascade.depthNear + cascade.depthRange - range};
    view.begin = begin;
    view.end = cascade.split;
    view.texel = cascade.texel;
    view.depthRange = range;
    view.map = map;
    return view;
}

}  // namespace

world::Result<CascadeImages> readImages(ShadowSystem& system, int camera) {
    CascadeImages read;
    const int side = system.config().side;
    double begin = 0;
    for (int c = 0; c < system.config().cascades; ++c) {
        const int number = camera * system.config().cascades + c;
        const CascadeView cascade = system.view(number);
        auto stored = system.readMap(number, gpu::MapKind::kWorking);
        if (!stored) return stored.error();
        read.images.push_back(unwrap(stored.value(), side, cascade.window));
        if (!cascade.drawn) std::fill(read.images.back().begin(), read.images.back().end(), cache::kUnknownDepth);
        read.views.push_back(shadowViewOf(cascade, side, begin, c));
        begin = cascade.split;
    }
    return read;
}

std::vector<float> unwrap(std::span<const float> stored, int side, cache::Texel window) {
    CHECK(stored.size() == size_t(side) * size_t(side));
    std::vector<float> image(stored.size());
    // Each row is stored as two runs: from the window's first column to the map's edge, then the rest.
    const cache::Lattice lattice{.texel = 1, .side = side};
    for (int y = 0; y < side; ++y) {
        const cache::Texel first = lattice.slot(window + cache::Texel(0, y));
        const auto row = stored.begin() + first.y * side;
        std::rotate_copy(row, row + first.x, row + side, image.begin() + ptrdiff_t(y) * side);
    }
    return image;
}

}  // namespace server
