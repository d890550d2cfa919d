// server/cascade_images.h — a camera's maps as what shades by them takes maps: images from the low corner of the window
// on, and the views that they were drawn for.
#pragma once

#include <span>
#include <vector>

#include "culling/shadow_views.h"
#include "server/shadow_system.h"
#include "world/result.h"

namespace server {

/// Per cascade of a camera, finest first.
struct CascadeImages {
    std::vector<culling::ShadowView> views;
    std::vector<std::vector<float>> images;  ///< side * side depths, row by row; kUnknownDepth where nothing was drawn
};

/// Reads a camera's working maps of the shown sun. kDevice.
world::Result<CascadeImages> readImages(ShadowSystem& system, int camera);

/// A map in the order of its window: pixel (x, y) is lattice texel window + (x, y), which is stored
/// at that sum modulo `side` on each axis. `stored` has side * side values.
std::vector<float> unwrap(std::span<const float> stored, int side, cache::Texel window);

}  // namespace server
