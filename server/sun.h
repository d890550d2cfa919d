// server/sun.h — one direction of the sun: its light space, its caches, and what their maps mean.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "cache/shadow_cache.h"
#include "culling/light_space.h"
#include "gpu/shadow_maps.h"
#include "world/check.h"

namespace server {

/// A cascade of one camera.
struct CascadeOf {
    const cache::ShadowCache& cache;
    int cascade = 0;  ///< of that cache
};

/// One direction of the sun and what its maps hold. Its cascades are numbered camera by camera.
struct Sun {
    culling::LightSpace space;
    std::vector<cache::ShadowCache> caches;  ///< per camera, all of the same cascades
    cache::Cause begin = cache::Cause::kStart;  ///< of its first drawing

    CascadeOf of(int number) const {
        CHECK(number >= 0 && number < cascades());
        const int each = caches.front().cascades();
        return {caches[size_t(number / each)], number % each};
    }
    int cascades() const { return int(caches.size()) * caches.front().cascades(); }
    /// All are, and owe nothing.
    bool complete() const;
    void forget();
};

/// One cascade's committed state, to be used with its maps and nothing else. Where ranges of depths follow the eye, a
/// receiver nearer the sun or farther than the range is another cascade's.
struct CascadeView {
    double texel = 0;    ///< edge of a texel [m]
    double split = 0;    ///< distance from the eye that this cascade serves [m]
    cache::Texel window{0};  ///< low corner of the window; texel (i, j) is stored at (i mod side, j mod side)
    double depthNear = 0, depthRange = 0;  ///< z of a caster [m] = depthNear + stored depth * depthRange
    bool drawn = false;  ///< false: the maps hold nothing yet, the cascade has slept from the start
    glm::dmat3 lightFromWorld{1};
};

CascadeView viewOf(const Sun& sun, int number);

/// What a texel of a stored map is worth.
enum class TexelState : uint8_t {
    kValid,
    kStale,    ///< it may be older than the world, or lack a chunk that is not there
    kUnknown,  ///< nothing was drawn there yet
};

/// Per texel of a cascade's cache or working map, in stored order.
///   gaps  rectangles of its window that are stale whatever the cache says
std::vector<TexelState> texelStates(const Sun& sun, int number, gpu::MapKind map,
                                    std::span<const cache::TexelRect> gaps = {});

}  // namespace server
