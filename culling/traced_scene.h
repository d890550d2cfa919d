// culling/traced_scene.h — placed meshes as Embree holds them: one scene a mesh, an instance of it a caster, all
// around an anchor near the eye.
// Source: Wald et al., "Embree: A Kernel Framework for Efficient CPU Ray Tracing", 2014.
#pragma once

#include <embree3/rtcore.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <glm/glm.hpp>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include "world/box.h"
#include "world/casters.h"
#include "world/mesh.h"
#include "world/result.h"

namespace culling {

constexpr size_t kPacket = 16;  ///< rays that are traced together

/// Up to 16 rays, each toward something that may be hidden.
class ShadowRays {
public:
    /// Each lane at most once; all in the scene's frame. `length` counts in lengths of `direction`; filters of the
    /// scene know the ray by `id`.
    void aim(size_t lane, const glm::dvec3& from, const glm::dvec3& direction,
             float length = std::numeric_limits<float>::infinity(), uint32_t id = 0);
    void shoot(RTCScene scene);
    bool aimed(size_t lane) const { return valid_[lane] != 0; }
    bool blocked(size_t lane) const { return rays_.tfar[lane] < 0; }

private:
    alignas(64) RTCRay16 rays_{};
    alignas(64) int valid_[kPacket] = {};
};

/// Where rays from a surface start, in the scene's frame.
struct RayStart {
    glm::dvec3 position{0}, normal{0};
    double reach = 0;  ///< of its caster

    /// Off the surface at `p`, a point of the tangent plane: by 2^-20 of how far p is from the anchor and the caster's
    /// corners from its origin. That is 16 units of single precision, for a dozen roundings: of the start, of the
    /// instance's place, on the way into the mesh's frame, and against the edges there. The tests' scenes do with 1/8
    /// of it, and not with 1/32.
    glm::dvec3 above(const glm::dvec3& p) const { return p + normal * (0x1p-20 * (glm::length(p) + reach)); }
};

/// False for NaN and for what lies beyond 1e9 m. Embree takes rays as they are: one that is not finite, or above 1.8e18
/// in a mesh's frame, is an undefined answer or, where it was built with assertions, the process's end.
inline bool traceable(double v) { return std::abs(v) <= 1e9; }
inline bool traceable(const glm::dvec3& v) { return traceable(v.x) && traceable(v.y) && traceable(v.z); }

/// One thread at a time, but for `scene`, which any number may trace between two changes.
class TracedScene {
public:
    static world::Result<std::unique_ptr<TracedScene>> create();  ///< kDevice
    TracedScene(const TracedScene&) = delete;
    TracedScene& operator=(const TracedScene&) = delete;
    ~TracedScene();

    /// As of `Truth`.
    world::Result<uint32_t> addMesh(const world::MeshLevel& level);
    world::Result<world::Done> add(world::CasterId id, uint32_t mesh, const world::Placement& placement);
    world::Result<world::Done> place(world::CasterId id, const world::Placement& placement);
    void remove(world::CasterId id);
    bool has(world::CasterId id) const { return id < casters_.size() && casters_[id].instance; }

    /// Puts the anchor near the eye and takes up what changed. Before rays are traced. kDevice.
    world::Result<world::Done> settle(const glm::dvec3& eye);

    RTCScene scene() const { return scene_; }  ///< its origin is the anchor
    const glm::dvec3& anchor() const { return anchor_; }  ///< world [m]
    /// Of a caster's corners from its origin [m].
    double reach(world::CasterId id) const {
        CHECK(has(id));
        return casters_[id].reach;
    }
    /// A triangle of a caster, placed in double precision, relative to `origin`.
    std::array<glm::dvec3, 3> triangle(world::CasterId id, uint32_t number, const glm::dvec3& origin) const;

private:
    struct Model {
        RTCScene scene = nullptr;
        std::span<const glm::vec3> corners;  ///< Embree's copies
        std::span<const uint32_t> indices;
        world::Box bounds;
    };
    struct Placed {
        RTCGeometry instance = nullptr;  ///< null: no caster of this number
        uint32_t mesh = 0;
        bool baked = false;  ///< the instance's corners have the linear part in them
        world::Placement placement;
        double reach = 0;
    };

    TracedScene() = default;
    world::Result<world::Done> noErrors(const char* doing) const;
    RTCScene newScene() const;
    Model build(std::span<const glm::vec3> positions, std::span<const uint32_t> indices) const;
    void setTransform(const Placed& caster) const;

    RTCDevice device_ = nullptr;
    RTCScene scene_ = nullptr;
    bool changed_ = true;  ///< the scene, since it was committed
    glm::dvec3 anchor_{0};
    std::vector<Model> models_;
    std::vector<Placed> casters_;
};

}  // namespace culling
