// server/lookup.h — the shadow answer for a point: which map speaks for it, and what it says.
// Source: our own.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "gpu/shadow_maps.h"
#include "server/sun.h"
#include "world/result.h"

namespace server {

enum class Light : uint8_t {
    kLit,
    kShadowed,
    kUnknown,  ///< no cascade's map knows the point
};

struct PointAnswer {
    Light light = Light::kUnknown;
    int8_t cascade = -1;  ///< number of the one whose map answered; -1: none
    bool fell = false;    ///< a nearer cascade's window holds the point and does not know it
    bool stale = false;   ///< the texel's depth may be older than the world, or lack a chunk that is not there yet
};

/// How far a point may lie behind the depth in its texel and still be lit: `texels` of the cascade's texel
/// edge plus `metres`. Receivers are biased, not casters: the same for every depth format. Points come without normals: what
/// their plane falls between the point and the middle of the texel, half a texel's edge times the slope each way, cannot be
/// told, and is in the bias. So it is more than `gnomon` needs in `shade`, which follows the plane; 1.5 texels hold flat
/// ground in the light of a sun down to 18.4 degrees (docs/methods.md).
struct LookupBias {
    double texels = 1.5;
    double metres = 0.02;
};

/// Answers for world points [m] from a camera's working maps as they are, the nearest cascade that holds and
/// knows a point first. `gaps`: per cascade of the sun, texels that chunks which are not there may shade. Reads whole
/// maps back: for batches. kDevice from the GPU.
world::Result<std::vector<PointAnswer>> lookup(gpu::ShadowMaps& maps, const Sun& sun, int camera,
                                               std::span<const cache::RectSet> gaps,
                                               std::span<const glm::dvec3> points, const LookupBias& bias);

}  // namespace server
