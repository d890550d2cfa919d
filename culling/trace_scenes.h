// culling/trace_scenes.h — Embree scenes of placed casters in light space, one per cascade.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "culling/light_casters.h"
#include "world/casters.h"
#include "world/result.h"

namespace culling {

/// A ray toward the sun (light-space -z) and what it met first.
struct SunRay {
    glm::dvec3 origin{0};  ///< light space [m]
    double skip = 0;       ///< hits nearer than this are passed over [m]
    bool hit = false;
    world::CasterId caster = 0;
    uint32_t triangle = 0;  ///< of the level that the cascade draws
    double distance = 0;    ///< [m], single precision
};

/// Casters at the level of detail that each cascade draws. Hits are candidates, exact to single
/// precision around `anchor`. Tracing may run from any number of threads between changes.
class TraceScenes {
public:
    static world::Result<std::unique_ptr<TraceScenes>> create(const world::CasterTable& table,
                                                             const LightCasters& light, glm::dvec3 anchor);
    ~TraceScenes();

    /// Adds casters to a cascade's scene and returns those that were not there yet, in order.
    /// Flat or otherwise uninvertible placements are never hit: they prove nothing.
    std::vector<world::CasterId> add(int cascade, std::span<const world::CasterId> casters);
    /// Takes it out of every scene that has it.
    void remove(world::CasterId caster);
    void forgetMesh(world::MeshSlot slot);
    /// Builds what changed in a cascade's scene. Call before tracing there.
    void commit(int cascade);

    void trace(int cascade, std::span<SunRay> rays) const;

private:
    struct Impl;
    explicit TraceScenes(std::unique_ptr<Impl> impl);
    std::unique_ptr<Impl> impl_;
};

}  // namespace culling
