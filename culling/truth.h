// culling/truth.h — what the sun really lights: a ray through each pixel and on toward the sun, against geometry in
// full detail. It judges shadow maps and shares nothing with them.
// Source: rays by Embree (Wald et al., "Embree: A Kernel Framework for Efficient CPU Ray Tracing", 2014); directions
// over the sun's disk as in Vogel, "A Better Way to Construct the Sunflower Head", 1979.
#pragma once

#include <cmath>
#include <cstdint>
#include <glm/glm.hpp>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include "culling/receivers.h"
#include "world/casters.h"
#include "world/mesh.h"
#include "world/result.h"

namespace culling {

class TracedScene;

enum class Sunlight : uint8_t {
    kSky,       ///< nothing to be seen within the far distance
    kAway,      ///< a surface turned away from the sun
    kLit,
    kShadowed,
};
inline bool sunward(Sunlight state) { return state == Sunlight::kLit || state == Sunlight::kShadowed; }

constexpr world::CasterId kNoCaster = 0xffffffffu;

/// Radii around a point on which shadow edges are looked for: 2^-7 to 2^4 m, each twice the one before.
constexpr uint8_t kEdgeSteps = 12;
/// Of a step [m]; infinite for kEdgeSteps, which stands for no edge found.
inline double edgeRadius(uint8_t step) {
    return step < kEdgeSteps ? std::ldexp(1.0, step - 7) : std::numeric_limits<double>::infinity();
}

/// What a camera truly sees; all lists by pixel, row by row from the top left.
struct TruthFrame {
    int width = 0, height = 0;
    glm::dvec3 eye{0};  ///< world [m]
    glm::dvec3 sun{0};  ///< direction of light travel, unit
    std::vector<Sunlight> states;
    std::vector<glm::vec3> points;   ///< the surface, world axes, relative to `eye` [m]; 0 for sky
    std::vector<glm::vec3> normals;  ///< of its triangle, unit, turned toward the eye; 0 for sky
    std::vector<world::CasterId> casters;  ///< kNoCaster for sky
    /// The first step at which one of 8 points around a sunward one answers otherwise. Seen along the sun they lie
    /// on the circle of `edgeRadius`, and they lie in the point's tangent plane: where the ground is curved that is
    /// above or below it. An edge is no farther than said, and at most 2.17 times nearer, 2 / cos(22.5 degrees), or any
    /// nearer at step 0; shadows and gaps narrower than the circle's chord of 45 degrees may be missed.
    std::vector<uint8_t> edges;
    friend bool operator==(const TruthFrame&, const TruthFrame&) = default;
};

/// A point on a caster that was seen once.
struct SurfacePoint {
    glm::dvec3 position{0};  ///< world [m]
    glm::vec3 normal{0};     ///< of the triangle, unit, turned toward the eye that saw it
    world::CasterId caster = kNoCaster;
};
/// A pixel of a frame as such a point.
inline SurfacePoint surfaceAt(const TruthFrame& frame, size_t pixel) {
    return {frame.eye + glm::dvec3(frame.points[pixel]), frame.normals[pixel], frame.casters[pixel]};
}

/// Placed meshes that rays are traced against. Answers depend on what is placed and on the call, not on earlier ones
/// and not on the number of threads. One thread at a time calls; each call uses all of TBB's.
///
/// Embree computes in single precision, around an anchor on a lattice of 64 m: near the eye its coordinates are off by
/// 4e-6 m, at a distance d by d / 2^24, 0.12 mm at 2 km, wherever in the world that is. What it hits is then placed in
/// double precision. Rays leave a surface from off it (`RayStart`: by 2 mm at 2 km, by 0.1 mm near by on a caster of
/// 100 m), which moves a shadow's edge, seen along the sun, by no more than that.
///
/// Whatever comes, moves or leaves has the tree over all casters built anew by the next call, and so has an eye that
/// enters another cell of the lattice: 2 ms for each thousand casters.
class Truth {
public:
    /// kDevice if Embree refuses.
    static world::Result<std::unique_ptr<Truth>> create();
    ~Truth();

    /// Takes a copy; returns what `add` calls it: 0, 1, ... in the order of calls. May be empty. kUsage for a position
    /// that is not finite or beyond 1e9 m, or an index out of range.
    world::Result<uint32_t> addMesh(const world::MeshLevel& level);
    /// `id` is free and not kNoCaster. kUsage for a placement that is not finite, or takes the mesh beyond 1e9 m.
    world::Result<world::Done> add(world::CasterId id, uint32_t mesh, const world::Placement& placement);
    /// Moves a caster. Errors as of `add`; it then stays where it was.
    world::Result<world::Done> place(world::CasterId id, const world::Placement& placement);
    void remove(world::CasterId id);

    /// What a pinhole camera sees, one ray through each pixel's centre; the view's field of view is given.
    ///   farDistance  from the eye [m]: what lies beyond is sky
    ///   edges        false: none are looked for, and most of the time is saved
    /// kUsage, naming it, for what is not finite or out of range, and as of `makeLightSpace`; kDevice.
    world::Result<TruthFrame> trace(const View& view, int width, int height, double farDistance, glm::dvec3 sun,
                                    bool edges = true);

    /// What became of points that were seen before: their state under `sun` as it is now, kSky for a point that the
    /// view does not see: outside of it or beyond the far distance, turned away, behind something, or on a caster that
    /// is gone or among `moved`: a caster that moves takes its points along.
    ///   moved  ascending
    /// Errors as of `trace`, and kUsage for a point that is not finite.
    world::Result<std::vector<Sunlight>> revisit(std::span<const SurfacePoint> points, const View& view,
                                                 double farDistance, glm::dvec3 sun,
                                                 std::span<const world::CasterId> moved);

    /// Which share of the sun's disk each sunward pixel sees, 0 for the others. The casters are those of the frame.
    ///   angularRadius  of the disk [rad], in (0, pi/4]
    ///   directions     the disk is cut into so many equal areas, one ray each; > 0
    /// The same directions for every pixel. kUsage for what is out of range; kDevice.
    world::Result<std::vector<float>> sunShares(const TruthFrame& frame, double angularRadius, int directions);

    /// Whether the sun's light reaches points anywhere: kLit or kShadowed, in their order. Casters as of now.
    ///   start  rays begin so far from their points, toward the sun [m], 0 or more: farther than the points may be off
    ///          their surface
    ///   near   where to be most exact, world [m]: single precision counts from there
    /// kUsage for what is not finite or out of range, and as of `makeLightSpace`; kDevice.
    world::Result<std::vector<Sunlight>> lightAt(std::span<const glm::dvec3> points, glm::dvec3 sun, double start,
                                                 const glm::dvec3& near);

private:
    explicit Truth(std::unique_ptr<TracedScene> scene);
    std::unique_ptr<TracedScene> scene_;
};

}  // namespace culling
