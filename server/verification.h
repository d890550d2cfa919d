// server/verification.h — holds cached maps against maps drawn from scratch, texel by texel.
// Source: our own.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "gpu/shadow_maps.h"
#include "server/resident_scene.h"
#include "server/sun.h"
#include "world/result.h"

namespace server {

constexpr size_t kReported = 8;  ///< differences, and casters of each, that a report lists

/// A texel that differs from the map drawn from scratch.
struct Difference {
    int cascade = 0;  ///< its number; -1: of a spot light's map
    gpu::MapKind map = gpu::MapKind::kCache;
    cache::Texel texel{0};  ///< on the lattice; of a spot light, on its map
    float cached = 0, redrawn = 0;
    std::vector<std::string> casters;  ///< those whose bounds cover the texel, at most kReported
    uint32_t spot = 0;  ///< the light's id
};

struct VerifyReport {
    uint64_t texels = 0;     ///< compared with the redraw, or with the mark of an unknown texel
    uint64_t stale = 0;      ///< left out: owed by the cache map, or by the working map of a sleeper
    uint64_t differing = 0;  ///< 0, or the cache is broken
    uint64_t differingSpots = 0;  ///< of these, in spot lights' maps
    std::vector<Difference> first;  ///< at most kReported
    gpu::GpuTimes redraw;    ///< cost of drawing everything from scratch: the static and active part
};

/// Draws all maps of all suns anew, without certificates, into scratch maps and compares every bit.
///   suns  as the scene's sides
///   plan  room for the redraw's plan, with as many maps as `maps` has
/// kDevice and kLimit from the GPU.
world::Result<VerifyReport> verify(gpu::ShadowMaps& maps, const ResidentScene& scene,
                                   std::span<const std::unique_ptr<Sun>> suns, cache::FramePlan& plan);

}  // namespace server
