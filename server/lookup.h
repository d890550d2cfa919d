// server/lookup.h — the shadow answer for a point: which map speaks for it, and what it says.
// Source: our own.
#pragma once

#include <cstdint>

namespace server {

enum class Light : uint8_t {
    kLit,
    kShadowed,
    kUnknown,  ///< no cascade's map knows the point
};

struct PointAnswer {
    Light light = Light::kUnknown;
    int8_t cascade = -1;  ///< whose map answered; -1: none
    bool fell = false;    ///< a nearer cascade's window holds the point and does not know it
    bool stale = false;   ///< the texel's depth may be older than the world
};

/// How far a point may lie behind the depth in its texel and still be lit: `texels` of the cascade's texel
/// edge plus `metres`. Receivers are biased, not casters: the same for every depth format.
struct LookupBias {
    double texels = 1.5;
    double metres = 0.02;
};

}  // namespace server
