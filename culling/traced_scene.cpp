#include "culling/traced_scene.h"

#include <tbb/task_arena.h>

#include <algorithm>
#include <string>

namespace culling {

namespace {

using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

constexpr double kAnchorStep = 64;  // [m]; within it a coordinate of the eye is off by 4e-6 m at most

Error usage(const std::string& what) { return {ErrorCode::kUsage, what}; }

/// Whether a float matrix has no inverse, or one of few true digits, or one that takes rays out of a float's range.
bool nearlyFlat(const glm::dmat3& m) {
    const double a = glm::length(m[0]), b = glm::length(m[1]), c = glm::length(m[2]);
    return std::min({a, b, c}) <= std::max(1e-6, 1e-4 * std::max({a, b, c})) ||
           std::abs(glm::determinant(m)) <= 1e-4 * a * b * c;
}

/// Builds a tree by one thread: several may put triangles into leaves in another order, and of triangles that a ray
/// meets at the same distance the first wins. Embree's own limit on threads would hold for the whole process.
void commit(RTCScene scene) {
    tbb::task_arena(1).execute([scene] { rtcCommitScene(scene); });
}

/// How far a placed mesh reaches from its own origin [m]; infinite for what is not finite.
double reachOf(const world::Box& mesh, const world::Placement& placement) {
    const glm::dmat3 linear(placement.linear);
    if (!traceable(linear[0]) || !traceable(linear[1]) || !traceable(linear[2]) || !traceable(placement.translation))
        return std::numeric_limits<double>::infinity();
    if (mesh.empty()) return 0;
    const world::Box box = world::transformed(mesh, linear, glm::dvec3(0));
    return glm::length(glm::max(glm::abs(box.min), glm::abs(box.max)));
}

Result<Done> requirePlacement(world::CasterId id, const world::Box& mesh, const world::Placement& placement) {
    if (traceable(reachOf(mesh, placement))) return Done{};
    return usage("caster " + std::to_string(id) + ": its placement is not finite, or beyond 1e9 m");
}

}  // namespace

void ShadowRays::aim(size_t lane, const glm::dvec3& from, const glm::dvec3& direction, float length, uint32_t id) {
    valid_[lane] = -1;
    rays_.org_x[lane] = static_cast<float>(from.x);
    rays_.org_y[lane] = static_cast<float>(from.y);
    rays_.org_z[lane] = static_cast<float>(from.z);
    rays_.dir_x[lane] = static_cast<float>(direction.x);
    rays_.dir_y[lane] = static_cast<float>(direction.y);
    rays_.dir_z[lane] = static_cast<float>(direction.z);
    rays_.tfar[lane] = length;
    rays_.id[lane] = id;
    rays_.mask[lane] = 0xffffffffu;
}

void ShadowRays::shoot(RTCScene scene) {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
    rtcOccluded16(valid_, scene, &context, &rays_);
}

Result<std::unique_ptr<TracedScene>> TracedScene::create() {
    std::unique_ptr<TracedScene> made(new TracedScene);
    made->device_ = rtcNewDevice(nullptr);
    if (!made->device_)
        return Error{ErrorCode::kDevice, "Embree: no device", static_cast<int>(rtcGetDeviceError(nullptr))};
    made->scene_ = made->newScene();
    return made;
}

TracedScene::~TracedScene() {
    for (const Model& model : models_) rtcReleaseScene(model.scene);
    if (scene_) rtcReleaseScene(scene_);
    if (device_) rtcReleaseDevice(device_);
}

Result<Done> TracedScene::noErrors(const char* doing) const {
    const RTCError code = rtcGetDeviceError(device_);
    if (code == RTC_ERROR_NONE) return Done{};
    const std::string what = std::string("Embree cannot ") + doing + ": free some memory, or trace less of the world";
    return Error{ErrorCode::kDevice, what, static_cast<int>(code)};
}

RTCScene TracedScene::newScene() const {
    const RTCScene made = rtcNewScene(device_);
    // Robust: no ray slips through the edge that two triangles share, nor past the box around an instance.
    rtcSetSceneFlags(made, RTC_SCENE_FLAG_ROBUST);
    rtcSetSceneBuildQuality(made, RTC_BUILD_QUALITY_MEDIUM);
    return made;
}

TracedScene::Model TracedScene::build(std::span<const glm::vec3> positions, std::span<const uint32_t> indices) const {
    Model model;
    model.scene = newScene();
    if (!indices.empty()) {
        const RTCGeometry geometry = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_TRIANGLE);
        // Embree's own buffers: it reads 16 bytes at the last vertex, which a vector may not have.
        auto* corners = static_cast<glm::vec3*>(rtcSetNewGeometryBuffer(
            geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, sizeof(glm::vec3), positions.size()));
        auto* triangles = static_cast<uint32_t*>(rtcSetNewGeometryBuffer(
            geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 3 * sizeof(uint32_t), indices.size() / 3));
        if (corners && triangles) {  // else there is no memory, and `noErrors` will say so
            std::copy(positions.begin(), positions.end(), corners);
            std::copy(indices.begin(), indices.end(), triangles);
            model.corners = {corners, positions.size()};
            model.indices = {triangles, indices.size()};
            for (const glm::vec3& p : positions) model.bounds.add(glm::dvec3(p));
            rtcCommitGeometry(geometry);
            rtcAttachGeometry(model.scene, geometry);
        }
        rtcReleaseGeometry(geometry);
    }
    commit(model.scene);
    return model;
}

Result<uint32_t> TracedScene::addMesh(const world::MeshLevel& level) {
    const std::string name = "mesh " + std::to_string(models_.size());
    for (size_t i = 0; i < level.positions.size(); ++i)
        if (!traceable(glm::dvec3(level.positions[i])))
            return usage(name + ": position " + std::to_string(i) + " is not finite, or beyond 1e9 m");
    if (level.indices.size() % 3 != 0) return usage(name + ": its indices make no triangles");
    for (uint32_t index : level.indices)
        if (index >= level.positions.size())
            return usage(name + ": index " + std::to_string(index) + " of " + std::to_string(level.positions.size()) +
                         " positions");
    models_.push_back(build(level.positions, level.indices));
    const auto built = noErrors("take a mesh");
    if (!built) return built.error();
    return static_cast<uint32_t>(models_.size() - 1);
}

Result<Done> TracedScene::add(world::CasterId id, uint32_t mesh, const world::Placement& placement) {
    CHECK(id != RTC_INVALID_GEOMETRY_ID && !has(id) && mesh < models_.size());
    const Model& model = models_[mesh];
    const auto good = requirePlacement(id, model.bounds, placement);
    if (!good) return good;
    const glm::dmat3 linear(placement.linear);
    if (casters_.size() <= id) casters_.resize(size_t(id) + 1);
    Placed& caster = casters_[id];
    caster = {rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_INSTANCE), mesh, nearlyFlat(linear), placement,
              reachOf(model.bounds, placement)};
    // Embree takes rays into a mesh's frame by the inverse of its placement: what has none gets corners of its own.
    if (caster.baked) {
        std::vector<glm::vec3> corners;
        for (const glm::vec3& p : model.corners) corners.emplace_back(linear * glm::dvec3(p));
        const RTCScene own = build(corners, model.indices).scene;
        rtcSetGeometryInstancedScene(caster.instance, own);
        rtcReleaseScene(own);  // the instance holds it
    } else {
        rtcSetGeometryInstancedScene(caster.instance, model.scene);
    }
    setTransform(caster);
    rtcAttachGeometryByID(scene_, caster.instance, id);
    rtcReleaseGeometry(caster.instance);  // the scene holds it
    changed_ = true;
    return noErrors("take a caster");
}

Result<Done> TracedScene::place(world::CasterId id, const world::Placement& placement) {
    CHECK(has(id));
    const uint32_t mesh = casters_[id].mesh;
    const auto good = requirePlacement(id, models_[mesh].bounds, placement);
    if (!good) return good;
    remove(id);
    return add(id, mesh, placement);
}

void TracedScene::remove(world::CasterId id) {
    CHECK(has(id));
    rtcDetachGeometry(scene_, id);
    casters_[id] = {};
    changed_ = true;
}

void TracedScene::setTransform(const Placed& caster) const {
    const glm::mat3 linear = caster.baked ? glm::mat3(1) : caster.placement.linear;
    const glm::mat4x3 columns(linear[0], linear[1], linear[2], glm::vec3(caster.placement.translation - anchor_));
    rtcSetGeometryTransform(caster.instance, 0, RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, &columns);
    rtcCommitGeometry(caster.instance);
}

Result<Done> TracedScene::settle(const glm::dvec3& eye) {
    const glm::dvec3 wanted = glm::round(eye / kAnchorStep) * kAnchorStep;
    if (wanted != anchor_) {
        anchor_ = wanted;
        changed_ = true;
        for (const Placed& caster : casters_)
            if (caster.instance) setTransform(caster);
    }
    if (changed_) commit(scene_);
    changed_ = false;
    return noErrors("build its tree of all casters");
}

std::array<glm::dvec3, 3> TracedScene::triangle(world::CasterId id, uint32_t number, const glm::dvec3& origin) const {
    const Placed& caster = casters_[id];
    const Model& model = models_[caster.mesh];
    const glm::dmat3 linear(caster.placement.linear);
    const glm::dvec3 shift = caster.placement.translation - origin;
    const auto corner = [&](size_t k) {
        return linear * glm::dvec3(model.corners[model.indices[3 * size_t(number) + k]]) + shift;
    };
    return {corner(0), corner(1), corner(2)};
}

}  // namespace culling
