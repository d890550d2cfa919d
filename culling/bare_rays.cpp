#include "culling/bare_rays.h"

#include <embree3/rtcore.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <functional>
#include <limits>
#include <vector>

namespace culling {

namespace {

constexpr size_t kPacket = 16;

}  // namespace

struct BareRays::Impl {
    ~Impl() {
        if (scene) rtcReleaseScene(scene);
        if (device) rtcReleaseDevice(device);
    }
    RTCDevice device = nullptr;
    RTCScene scene = nullptr;
    std::vector<glm::vec3> origins;  ///< relative to the anchor [m]
};

BareRays::BareRays(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
BareRays::~BareRays() = default;

world::Result<std::unique_ptr<BareRays>> BareRays::create(const world::CasterTable& table, const LightCasters& light,
                                                         int cascade, std::span<const world::CasterId> casters,
                                                         std::span<const Footprint> footprints) {
    auto impl = std::make_unique<Impl>();
    impl->device = rtcNewDevice(nullptr);
    if (!impl->device)
        return world::Error{world::ErrorCode::kDevice, "Embree: no device", static_cast<int>(rtcGetDeviceError(nullptr))};

    const double texel = light.cascades()[static_cast<size_t>(cascade)].texel;
    glm::dvec3 anchor(0);
    if (!footprints.empty()) anchor = {glm::dvec2(footprints.front().low) * texel, footprints.front().front};
    for (const Footprint& f : footprints)
        for (int64_t y = f.low.y; y < f.high.y; ++y)
            for (int64_t x = f.low.x; x < f.high.x; ++x)
                impl->origins.push_back(glm::dvec3((double(x) + 0.5) * texel, (double(y) + 0.5) * texel, f.front) - anchor);

    std::vector<glm::vec3> corners;
    std::vector<uint32_t> indices;
    for (world::CasterId caster : casters) {
        if (!light.drawn(caster, cascade)) continue;
        const world::MeshLevel& level = table.meshOf(caster).levels[static_cast<size_t>(light.level(caster, cascade))];
        const auto first = static_cast<uint32_t>(corners.size());
        for (const glm::vec3& p : level.positions)
            corners.push_back(light[caster].lightFromMesh * glm::dvec3(p) + (light[caster].origin - anchor));
        for (uint32_t index : level.indices) indices.push_back(first + index);
    }
    RTCGeometry geometry = rtcNewGeometry(impl->device, RTC_GEOMETRY_TYPE_TRIANGLE);
    // Embree's own buffers: it reads 16 bytes at the last vertex, which a vector may not have.
    void* vertices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, sizeof(glm::vec3),
                                             corners.size());
    void* triangles = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 3 * sizeof(uint32_t),
                                              indices.size() / 3);
    std::copy(corners.begin(), corners.end(), static_cast<glm::vec3*>(vertices));
    std::copy(indices.begin(), indices.end(), static_cast<uint32_t*>(triangles));
    rtcCommitGeometry(geometry);
    impl->scene = rtcNewScene(impl->device);
    rtcAttachGeometry(impl->scene, geometry);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(impl->scene);
    return std::unique_ptr<BareRays>(new BareRays(std::move(impl)));
}

uint64_t BareRays::rays() const { return impl_->origins.size(); }

uint64_t BareRays::shoot() const {
    const std::vector<glm::vec3>& origins = impl_->origins;
    const auto some = [&](const tbb::blocked_range<size_t>& range, uint64_t met) {
        RTCIntersectContext context;
        rtcInitIntersectContext(&context);
        context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
        for (size_t done = range.begin(); done < range.end(); done += kPacket) {
            const size_t count = std::min(kPacket, range.end() - done);
            alignas(64) RTCRay16 rays{};
            alignas(64) int valid[kPacket] = {};
            for (size_t i = 0; i < count; ++i) {
                const glm::vec3& origin = origins[done + i];
                valid[i] = -1;
                rays.org_x[i] = origin.x;
                rays.org_y[i] = origin.y;
                rays.org_z[i] = origin.z;
                rays.dir_z[i] = -1;
                rays.tfar[i] = std::numeric_limits<float>::infinity();
                rays.mask[i] = 0xffffffffu;
            }
            rtcOccluded16(valid, impl_->scene, &context, &rays);
            for (size_t i = 0; i < count; ++i) met += rays.tfar[i] < 0;
        }
        return met;
    };
    return tbb::parallel_reduce(tbb::blocked_range<size_t>(0, origins.size(), 256 * kPacket), uint64_t(0), some,
                                std::plus<uint64_t>());
}

}  // namespace culling
