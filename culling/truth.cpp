#include "culling/truth.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <numbers>
#include <string>
#include <utility>

#include "culling/light_space.h"
#include "culling/traced_scene.h"

namespace culling {

namespace {

using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

constexpr int kTile = 4;  // a packet is a tile of 4 x 4 pixels
static_assert(kTile * kTile == kPacket);
constexpr int kMostPixels = 1 << 14;  // a side: their number fits an int
constexpr size_t kEdgeDirections = 8;
static_assert(kEdgeSteps * kEdgeDirections % kPacket == 0);

Error usage(const std::string& what) { return {ErrorCode::kUsage, what}; }

Result<Done> requireView(const View& view, double farDistance) {
    const glm::dquat& q = view.orientation;
    if (!traceable(view.eye)) return usage("view: the eye is not finite, or beyond 1e9 m");
    if (!traceable(glm::dvec3(q.x, q.y, q.z)) || !traceable(q.w) || !(glm::length(q) > 0))
        return usage("view: the orientation is no rotation");
    if (!(view.verticalFov > 0 && view.verticalFov < std::numbers::pi))
        return usage("view: the vertical field of view is not within (0, pi)");
    if (!(view.aspect > 0) || !traceable(view.aspect)) return usage("view: the aspect is not finite and above 0");
    if (!(farDistance > 0) || !traceable(farDistance)) return usage("far distance: not above 0 and up to 1e9 m");
    return Done{};
}

/// A view as rays; all relative to the eye.
struct Pinhole {
    explicit Pinhole(const View& view)
        : worldFromView(glm::mat3_cast(glm::normalize(view.orientation))),
          up(std::tan(view.verticalFov / 2)),
          right(up * view.aspect) {}
    /// Unit direction through a point of the image: (0, 0) is its top left corner, (1, 1) the opposite one.
    glm::dvec3 through(const glm::dvec2& p) const {
        return glm::normalize(worldFromView * glm::dvec3((2 * p.x - 1) * right, (1 - 2 * p.y) * up, -1));
    }
    bool holds(const glm::dvec3& p) const {
        const glm::dvec3 local = glm::transpose(worldFromView) * p;
        return local.z < 0 && std::abs(local.x) <= -local.z * right && std::abs(local.y) <= -local.z * up;
    }
    glm::dmat3 worldFromView;
    double up, right;  ///< of the image's edges at distance 1
};

/// One of `count` equal areas of a disk of radius 1: a point within it, as a sunflower sets its seeds.
glm::dvec2 onDisk(int i, int count) {
    const double radius = std::sqrt((i + 0.5) / count), angle = i * std::numbers::pi * (3 - std::sqrt(5.0));
    return radius * glm::dvec2(std::cos(angle), std::sin(angle));
}

RayStart startAt(const SurfacePoint& point, const TracedScene& scene) {
    return {point.position - scene.anchor(), glm::dvec3(point.normal), scene.reach(point.caster)};
}

/// Fills in a pixel in double precision, so that the point lies on the triangle however far away that is.
void placeHit(const RTCHit16& hit, size_t lane, size_t pixel, const TracedScene& scene, TruthFrame& frame) {
    const world::CasterId id = hit.instID[0][lane];
    const std::array<glm::dvec3, 3> corner = scene.triangle(id, hit.primID[lane], frame.eye);
    const glm::dvec3 a = corner[1] - corner[0], b = corner[2] - corner[0];
    const glm::dvec3 point = corner[0] + double(hit.u[lane]) * a + double(hit.v[lane]) * b;
    glm::dvec3 normal = glm::cross(a, b);
    if (glm::dot(normal, point) > 0) normal = -normal;
    // Rounding lets a ray meet a triangle without an area, which has no normal: any that faces the eye will do.
    if (glm::length(normal) == 0) normal = -point;
    frame.points[pixel] = glm::vec3(point);
    frame.normals[pixel] = glm::vec3(glm::normalize(normal));
    frame.casters[pixel] = id;
}

uint8_t edgeAround(const RayStart& start, const LightSpace& light, bool shadowed, RTCScene scene) {
    const glm::dmat3 worldFromLight = glm::transpose(light.lightFromWorld);
    // Where light grazes by less than 1e-6 rad the points stay nearer than the plane would have them, and finite.
    const double facing = std::min(glm::dot(start.normal, light.sun), -1e-6);
    constexpr size_t kStepsAtOnce = kPacket / kEdgeDirections;
    for (size_t first = 0; first < kEdgeSteps; first += kStepsAtOnce) {
        ShadowRays rays;
        for (size_t lane = 0; lane < kPacket; ++lane) {
            const double radius = edgeRadius(uint8_t(first + lane / kEdgeDirections));
            const double angle = double(lane % kEdgeDirections) * (2 * std::numbers::pi / kEdgeDirections);
            const glm::dvec3 aside =
                radius * (std::cos(angle) * worldFromLight[0] + std::sin(angle) * worldFromLight[1]);
            const glm::dvec3 onPlane = aside - light.sun * (glm::dot(start.normal, aside) / facing);
            rays.aim(lane, start.above(start.position + onPlane), -light.sun);
        }
        rays.shoot(scene);
        for (size_t lane = 0; lane < kPacket; ++lane)
            if (rays.blocked(lane) != shadowed) return uint8_t(first + lane / kEdgeDirections);
    }
    return kEdgeSteps;
}

void traceTile(const TracedScene& scene, const Pinhole& pinhole, double farDistance, const LightSpace& light,
               glm::ivec2 low, bool edges, TruthFrame& frame) {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
    RTCRayHit16 view{};
    alignas(64) int valid[kPacket] = {};
    std::array<size_t, kPacket> pixels{};
    const glm::vec3 eye(frame.eye - scene.anchor());
    for (size_t lane = 0; lane < kPacket; ++lane) {
        const glm::ivec2 at = low + glm::ivec2(int(lane) % kTile, int(lane) / kTile);
        if (at.x >= frame.width || at.y >= frame.height) continue;
        pixels[lane] = size_t(at.y) * size_t(frame.width) + size_t(at.x);
        const glm::vec3 direction(pinhole.through((glm::dvec2(at) + 0.5) / glm::dvec2(frame.width, frame.height)));
        valid[lane] = -1;
        view.ray.org_x[lane] = eye.x;
        view.ray.org_y[lane] = eye.y;
        view.ray.org_z[lane] = eye.z;
        view.ray.dir_x[lane] = direction.x;
        view.ray.dir_y[lane] = direction.y;
        view.ray.dir_z[lane] = direction.z;
        view.ray.tfar[lane] = static_cast<float>(farDistance);
        view.ray.mask[lane] = 0xffffffffu;
        view.hit.geomID[lane] = RTC_INVALID_GEOMETRY_ID;
        view.hit.instID[0][lane] = RTC_INVALID_GEOMETRY_ID;
    }
    rtcIntersect16(valid, scene.scene(), &context, &view);

    ShadowRays toSun;
    std::array<RayStart, kPacket> starts;
    for (size_t lane = 0; lane < kPacket; ++lane) {
        if (!valid[lane] || view.hit.geomID[lane] == RTC_INVALID_GEOMETRY_ID) continue;
        placeHit(view.hit, lane, pixels[lane], scene, frame);
        starts[lane] = startAt(surfaceAt(frame, pixels[lane]), scene);
        frame.states[pixels[lane]] = Sunlight::kAway;
        if (glm::dot(starts[lane].normal, light.sun) < 0)
            toSun.aim(lane, starts[lane].above(starts[lane].position), -light.sun);
    }
    toSun.shoot(scene.scene());
    for (size_t lane = 0; lane < kPacket; ++lane) {
        if (!toSun.aimed(lane)) continue;
        const bool shadowed = toSun.blocked(lane);
        frame.states[pixels[lane]] = shadowed ? Sunlight::kShadowed : Sunlight::kLit;
        if (edges) frame.edges[pixels[lane]] = edgeAround(starts[lane], light, shadowed, scene.scene());
    }
}

}  // namespace

Truth::Truth(std::unique_ptr<TracedScene> scene) : scene_(std::move(scene)) {}
Truth::~Truth() = default;

Result<std::unique_ptr<Truth>> Truth::create() {
    auto scene = TracedScene::create();
    if (!scene) return scene.error();
    return std::unique_ptr<Truth>(new Truth(std::move(scene.value())));
}

Result<uint32_t> Truth::addMesh(const world::MeshLevel& level) { return scene_->addMesh(level); }
Result<Done> Truth::add(world::CasterId id, uint32_t mesh, const world::Placement& placement) {
    return scene_->add(id, mesh, placement);
}
Result<Done> Truth::place(world::CasterId id, const world::Placement& placement) {
    return scene_->place(id, placement);
}
void Truth::remove(world::CasterId id) { scene_->remove(id); }

Result<TruthFrame> Truth::trace(const View& view, int width, int height, double farDistance, glm::dvec3 sun, bool edges) {
    const auto good = requireView(view, farDistance);
    if (!good) return good.error();
    if (std::min(width, height) < 1 || std::max(width, height) > kMostPixels)
        return usage("image: not 1 to " + std::to_string(kMostPixels) + " pixels a side");
    const auto light = makeLightSpace(sun);
    if (!light) return light.error();
    const auto settled = scene_->settle(view.eye);
    if (!settled) return settled.error();

    TruthFrame frame{width, height, view.eye, light.value().sun, {}, {}, {}, {}, {}};
    const size_t pixels = size_t(width) * size_t(height);
    frame.states.assign(pixels, Sunlight::kSky);
    frame.points.assign(pixels, glm::vec3(0));
    frame.normals.assign(pixels, glm::vec3(0));
    frame.casters.assign(pixels, kNoCaster);
    frame.edges.assign(pixels, kEdgeSteps);
    const Pinhole pinhole(view);
    const int across = (width + kTile - 1) / kTile, down = (height + kTile - 1) / kTile;
    tbb::parallel_for(0, across * down, [&](int tile) {
        const glm::ivec2 low = glm::ivec2(tile % across, tile / across) * kTile;
        traceTile(*scene_, pinhole, farDistance, light.value(), low, edges, frame);
    });
    return frame;
}

Result<std::vector<Sunlight>> Truth::revisit(std::span<const SurfacePoint> points, const View& view,
                                             double farDistance, glm::dvec3 sun,
                                             std::span<const world::CasterId> moved) {
    const auto good = requireView(view, farDistance);
    if (!good) return good.error();
    for (size_t i = 0; i < points.size(); ++i)
        if (!traceable(points[i].position) || !traceable(glm::dvec3(points[i].normal)))
            return usage("point " + std::to_string(i) + ": not finite, or beyond 1e9 m");
    const auto light = makeLightSpace(sun);
    if (!light) return light.error();
    const auto settled = scene_->settle(view.eye);
    if (!settled) return settled.error();

    std::vector<Sunlight> states(points.size(), Sunlight::kSky);
    const Pinhole pinhole(view);
    const glm::dvec3 toLight = -light.value().sun;
    const auto packet = [&](size_t number) {
        const size_t first = number * kPacket, count = std::min(kPacket, points.size() - first);
        ShadowRays toEye, toSun;
        std::array<RayStart, kPacket> starts;
        for (size_t lane = 0; lane < count; ++lane) {
            const SurfacePoint& point = points[first + lane];
            const glm::dvec3 fromEye = point.position - view.eye;
            if (!scene_->has(point.caster) || std::binary_search(moved.begin(), moved.end(), point.caster)) continue;
            if (!pinhole.holds(fromEye) || glm::length(fromEye) > farDistance) continue;
            if (glm::dot(glm::dvec3(point.normal), fromEye) >= 0) continue;
            starts[lane] = startAt(point, *scene_);
            const glm::dvec3 start = starts[lane].above(starts[lane].position);
            toEye.aim(lane, start, view.eye - scene_->anchor() - start, 1);
        }
        toEye.shoot(scene_->scene());
        for (size_t lane = 0; lane < count; ++lane) {
            if (!toEye.aimed(lane) || toEye.blocked(lane)) continue;
            states[first + lane] = Sunlight::kAway;
            if (glm::dot(starts[lane].normal, toLight) > 0)
                toSun.aim(lane, starts[lane].above(starts[lane].position), toLight);
        }
        toSun.shoot(scene_->scene());
        for (size_t lane = 0; lane < count; ++lane)
            if (toSun.aimed(lane)) states[first + lane] = toSun.blocked(lane) ? Sunlight::kShadowed : Sunlight::kLit;
    };
    tbb::parallel_for(size_t(0), (points.size() + kPacket - 1) / kPacket, packet);
    return states;
}

Result<std::vector<float>> Truth::sunShares(const TruthFrame& frame, double angularRadius, int directions) {
    if (!(angularRadius > 0 && angularRadius <= std::numbers::pi / 4))
        return usage("sun's disk: its angular radius is not within (0, pi/4]");
    if (directions < 1) return usage("sun's disk: no directions");
    const auto light = makeLightSpace(frame.sun);
    if (!light) return light.error();
    const auto settled = scene_->settle(frame.eye);
    if (!settled) return settled.error();

    std::vector<glm::dvec3> toSun;
    for (int i = 0; i < directions; ++i)
        toSun.push_back(glm::normalize(
            light.value().toWorld(glm::dvec3(std::tan(angularRadius) * onDisk(i, directions), -1))));
    std::vector<float> shares(frame.states.size(), 0);
    tbb::parallel_for(size_t(0), shares.size(), [&](size_t pixel) {
        if (!sunward(frame.states[pixel])) return;
        const RayStart start = startAt(surfaceAt(frame, pixel), *scene_);
        const glm::dvec3 from = start.above(start.position);  // a part of the disk that has set is behind the surface
        int seen = 0;
        for (size_t first = 0; first < toSun.size(); first += kPacket) {
            const size_t count = std::min(kPacket, toSun.size() - first);
            ShadowRays rays;
            for (size_t lane = 0; lane < count; ++lane)
                rays.aim(lane, from, toSun[first + lane]);
            rays.shoot(scene_->scene());
            for (size_t lane = 0; lane < count; ++lane) seen += !rays.blocked(lane);
        }
        shares[pixel] = static_cast<float>(seen) / static_cast<float>(directions);
    });
    return shares;
}

Result<std::vector<Sunlight>> Truth::lightAt(std::span<const glm::dvec3> points, glm::dvec3 sun, double start,
                                             const glm::dvec3& near) {
    if (!(start >= 0) || !traceable(start)) return usage("rays' start: not 0 to 1e9 m");
    if (!traceable(near)) return usage("rays: the place to be exact at is not finite, or beyond 1e9 m");
    for (size_t i = 0; i < points.size(); ++i)
        if (!traceable(points[i])) return usage("point " + std::to_string(i) + ": not finite, or beyond 1e9 m");
    const auto light = makeLightSpace(sun);
    if (!light) return light.error();
    const auto settled = scene_->settle(near);
    if (!settled) return settled.error();

    std::vector<Sunlight> states(points.size());
    const glm::dvec3 toLight = -light.value().sun;
    tbb::parallel_for(size_t(0), (points.size() + kPacket - 1) / kPacket, [&](size_t packet) {
        const size_t first = packet * kPacket, count = std::min(kPacket, points.size() - first);
        ShadowRays rays;
        for (size_t lane = 0; lane < count; ++lane)
            rays.aim(lane, points[first + lane] + start * toLight - scene_->anchor(), toLight);
        rays.shoot(scene_->scene());
        for (size_t lane = 0; lane < count; ++lane)
            states[first + lane] = rays.blocked(lane) ? Sunlight::kShadowed : Sunlight::kLit;
    });
    return states;
}

}  // namespace culling
