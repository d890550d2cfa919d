#include "culling/trace_scenes.h"

#include <embree3/rtcore.h>
#include <tbb/parallel_for.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <map>

namespace culling {

namespace {

constexpr size_t kStream = 256;  ///< rays handed to Embree at once: a few kilobytes, stays in cache

/// A mesh level that casters instance.
struct Shape {
    RTCScene scene = nullptr;
    uint32_t users = 0;
};

enum class Membership : uint8_t { kOut, kIn, kUnseen };  ///< kUnseen: added, but never hit

}  // namespace

struct TraceScenes::Impl {
    Impl(const world::CasterTable& t, const LightCasters& l) : table(t), light(l) {}
    ~Impl() {
        for (auto& [key, shape] : shapes) rtcReleaseScene(shape.scene);
        for (RTCScene scene : scenes) rtcReleaseScene(scene);
        if (device) rtcReleaseDevice(device);
    }
    void build(Shape& shape, const world::MeshLevel& mesh) const;

    const world::CasterTable& table;
    const LightCasters& light;
    glm::dvec3 anchor{0};
    RTCDevice device = nullptr;
    std::vector<RTCScene> scenes;  ///< per cascade
    std::vector<std::vector<Membership>> members;  ///< [cascade][caster]
    std::map<std::pair<world::MeshSlot, int>, Shape> shapes;
    std::vector<uint8_t> changed;  ///< per cascade
};

void TraceScenes::Impl::build(Shape& shape, const world::MeshLevel& mesh) const {
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    // Embree's own buffers: it reads 16 bytes at the last vertex, which a shared vector may not have.
    void* vertices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                             sizeof(glm::vec3), mesh.positions.size());
    void* indices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                            3 * sizeof(uint32_t), mesh.indices.size() / 3);
    std::memcpy(vertices, mesh.positions.data(), mesh.positions.size() * sizeof(glm::vec3));
    std::memcpy(indices, mesh.indices.data(), mesh.indices.size() * sizeof(uint32_t));
    rtcCommitGeometry(geometry);
    shape.scene = rtcNewScene(device);
    rtcSetSceneFlags(shape.scene, RTC_SCENE_FLAG_ROBUST);
    rtcAttachGeometry(shape.scene, geometry);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(shape.scene);
}

TraceScenes::TraceScenes(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
TraceScenes::~TraceScenes() = default;

world::Result<std::unique_ptr<TraceScenes>> TraceScenes::create(const world::CasterTable& table,
                                                               const LightCasters& light, glm::dvec3 anchor) {
    auto impl = std::make_unique<Impl>(table, light);
    impl->anchor = anchor;
    impl->device = rtcNewDevice(nullptr);
    if (!impl->device)
        return world::Error{world::ErrorCode::kDevice, "Embree: no device; use --occlusion off",
                            static_cast<int>(rtcGetDeviceError(nullptr))};
    for (size_t c = 0; c < light.cascades().size(); ++c) {
        RTCScene scene = rtcNewScene(impl->device);
        rtcSetSceneFlags(scene, static_cast<RTCSceneFlags>(RTC_SCENE_FLAG_ROBUST | RTC_SCENE_FLAG_DYNAMIC));
        rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_MEDIUM);  // deterministic, unlike the faster ones
        impl->scenes.push_back(scene);
    }
    impl->members.resize(impl->scenes.size());
    impl->changed.resize(impl->scenes.size(), 0);
    return std::unique_ptr<TraceScenes>(new TraceScenes(std::move(impl)));
}

std::vector<world::CasterId> TraceScenes::add(int cascade, std::span<const world::CasterId> casters) {
    Impl& s = *impl_;
    const auto c = static_cast<size_t>(cascade);
    std::vector<Membership>& members = s.members[c];
    std::vector<world::CasterId> fresh;
    std::vector<std::pair<Shape*, const world::MeshLevel*>> unbuilt;
    for (world::CasterId caster : casters) {
        if (!s.light.drawn(caster, cascade)) continue;
        if (members.size() <= caster) members.resize(caster + 1, Membership::kOut);
        if (members[caster] != Membership::kOut) continue;
        members[caster] = Membership::kUnseen;
        fresh.push_back(caster);
        const int level = s.light.level(caster, cascade);
        const auto [shape, isNew] = s.shapes.try_emplace({s.table[caster].mesh, level});
        if (isNew) unbuilt.emplace_back(&shape->second, &s.table.meshOf(caster).levels[static_cast<size_t>(level)]);
    }
    // Building the shapes takes most of the time of an arrival.
    tbb::parallel_for(size_t(0), unbuilt.size(), [&](size_t i) { s.build(*unbuilt[i].first, *unbuilt[i].second); });
    for (world::CasterId caster : fresh) {
        const LightCaster& placed = s.light[caster];
        const glm::dmat3& m = placed.lightFromMesh;
        const double volume = std::abs(glm::determinant(m));
        if (!(volume > 1e-9 * glm::length(m[0]) * glm::length(m[1]) * glm::length(m[2]))) continue;
        const glm::vec3 shift(placed.origin - s.anchor);
        float xfm[12];
        for (int column = 0; column < 3; ++column)
            for (int row = 0; row < 3; ++row) xfm[3 * column + row] = static_cast<float>(m[column][row]);
        for (int row = 0; row < 3; ++row) xfm[9 + row] = shift[row];
        Shape& shape = s.shapes.at({s.table[caster].mesh, s.light.level(caster, cascade)});
        RTCGeometry instance = rtcNewGeometry(s.device, RTC_GEOMETRY_TYPE_INSTANCE);
        rtcSetGeometryInstancedScene(instance, shape.scene);
        rtcSetGeometryTransform(instance, 0, RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, xfm);
        rtcCommitGeometry(instance);
        rtcAttachGeometryByID(s.scenes[c], instance, caster);
        rtcReleaseGeometry(instance);
        ++shape.users;
        members[caster] = Membership::kIn;
        s.changed[c] = 1;
    }
    return fresh;
}

void TraceScenes::remove(world::CasterId caster) {
    Impl& s = *impl_;
    for (size_t c = 0; c < s.scenes.size(); ++c) {
        if (caster >= s.members[c].size()) continue;
        if (s.members[c][caster] == Membership::kIn) {
            rtcDetachGeometry(s.scenes[c], caster);
            --s.shapes.at({s.table[caster].mesh, s.light.level(caster, int(c))}).users;
            s.changed[c] = 1;
        }
        s.members[c][caster] = Membership::kOut;
    }
}

void TraceScenes::forgetMesh(world::MeshSlot slot) {
    Impl& s = *impl_;
    for (auto it = s.shapes.lower_bound({slot, 0}); it != s.shapes.end() && it->first.first == slot;) {
        CHECK(it->second.users == 0);
        rtcReleaseScene(it->second.scene);
        it = s.shapes.erase(it);
    }
}

void TraceScenes::commit(int cascade) {
    const auto c = static_cast<size_t>(cascade);
    if (!impl_->changed[c]) return;
    rtcCommitScene(impl_->scenes[c]);
    impl_->changed[c] = 0;
}

void TraceScenes::trace(int cascade, std::span<SunRay> rays) const {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
    RTCRayHit stream[kStream];
    for (size_t done = 0; done < rays.size(); done += kStream) {
        const size_t count = std::min(kStream, rays.size() - done);
        for (size_t i = 0; i < count; ++i) {
            const SunRay& ray = rays[done + i];
            const glm::vec3 origin(ray.origin - impl_->anchor);
            RTCRayHit& r = stream[i];
            r.ray = {};
            r.ray.org_x = origin.x;
            r.ray.org_y = origin.y;
            r.ray.org_z = origin.z;
            r.ray.dir_z = -1;
            r.ray.tnear = static_cast<float>(ray.skip);
            r.ray.tfar = std::numeric_limits<float>::infinity();
            r.ray.mask = 0xffffffffu;
            r.hit.geomID = RTC_INVALID_GEOMETRY_ID;
            r.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
        }
        rtcIntersect1M(impl_->scenes[static_cast<size_t>(cascade)], &context, stream,
                       static_cast<unsigned>(count), sizeof(RTCRayHit));
        for (size_t i = 0; i < count; ++i) {
            SunRay& ray = rays[done + i];
            ray.hit = stream[i].hit.geomID != RTC_INVALID_GEOMETRY_ID;
            ray.caster = stream[i].hit.instID[0];
            ray.triangle = stream[i].hit.primID;
            ray.distance = stream[i].ray.tfar;
        }
    }
}

}  // namespace culling
