#include "culling/caster_rays.h"

#include <embree3/rtcore.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "culling/traced_scene.h"
#include "world/check.h"

namespace culling {

namespace {

using world::CasterId;
using world::Error;
using world::ErrorCode;
using world::Result;

/// Of how far corners lie from the anchor: 16 units of single precision, for what rays and triangles round.
constexpr double kRoom = 0x1p-20;

/// Of more texels than these only so many are looked at, spread over all rows and along them.
constexpr size_t kCandidates = 4096;

/// Up to `most` of the texels, as far from each other as can be.
std::vector<CasterTexel> spread(std::span<const CasterTexel> texels, size_t most) {
    std::vector<CasterTexel> chosen;
    glm::dvec2 middle(0);
    for (const CasterTexel& t : texels) middle += glm::dvec2(t.texel) / double(texels.size());
    size_t next = 0;
    double least = std::numeric_limits<double>::infinity();
    for (size_t i = 0; i < texels.size(); ++i) {
        const glm::dvec2 off = glm::dvec2(texels[i].texel) - middle;
        if (const double away = glm::dot(off, off); away < least) {
            least = away;
            next = i;
        }
    }
    struct Candidate {
        size_t index = 0;
        int away = std::numeric_limits<int>::max();  ///< squared, from the nearest one chosen
    };
    std::vector<Candidate> candidates;
    for (size_t i = 0; i < std::min(texels.size(), kCandidates); ++i) {
        const double place = double(i) * 0.6180339887498949;  // of the golden section: no row is favoured
        const auto spot = size_t((place - std::floor(place)) * double(texels.size()));
        candidates.push_back({texels.size() <= kCandidates ? i : spot});
    }
    while (chosen.size() < std::min(most, texels.size())) {
        chosen.push_back(texels[next]);
        const glm::ivec2 last = texels[next].texel;
        int farthest = -1;
        for (Candidate& c : candidates) {
            const glm::ivec2 off = texels[c.index].texel - last;
            c.away = std::min(c.away, off.x * off.x + off.y * off.y);
            if (c.away > farthest) {
                farthest = c.away;
                next = c.index;
            }
        }
    }
    return chosen;
}

/// A caster's own triangles hide nothing of it. Rays are named by their caster, triangles by a table.
void passOwn(const RTCFilterFunctionNArguments* met) {
    const auto& owners = *static_cast<const std::vector<uint32_t>*>(met->geometryUserPtr);
    for (unsigned i = 0; i < met->N; ++i)
        if (met->valid[i] == -1 && owners[RTCHitN_primID(met->hit, met->N, i)] == RTCRayN_id(met->ray, met->N, i))
            met->valid[i] = 0;
}

}  // namespace

struct CasterRays::Impl {
    ~Impl() {
        if (scene) rtcReleaseScene(scene);
        if (device) rtcReleaseDevice(device);
    }
    RTCDevice device = nullptr;
    RTCScene scene = nullptr;
    std::vector<uint32_t> owners;  ///< caster of each triangle
    std::vector<CasterId> asked;
    std::vector<glm::vec3> points;    ///< of all that are asked, one caster after the other; relative to the anchor [m]
    std::vector<size_t> firstPoint;   ///< of each, and the end

    Result<world::Done> build(const std::vector<glm::vec3>& corners, const std::vector<uint32_t>& indices);
};

Result<world::Done> CasterRays::Impl::build(const std::vector<glm::vec3>& corners, const std::vector<uint32_t>& indices) {
    device = rtcNewDevice(nullptr);
    if (!device) return Error{ErrorCode::kDevice, "Embree: no device", static_cast<int>(rtcGetDeviceError(nullptr))};
    scene = rtcNewScene(device);
    // Robust: no ray slips through the edge that two triangles share.
    rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
    if (!indices.empty()) {
        const RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
        // Embree's own buffers: it reads 16 bytes at the last vertex, which a vector may not have.
        void* vertices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, sizeof(glm::vec3),
                                                 corners.size());
        void* triangles = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 3 * sizeof(uint32_t),
                                                  indices.size() / 3);
        if (vertices && triangles) {  // else there is no memory, and the device's error says so
            std::copy(corners.begin(), corners.end(), static_cast<glm::vec3*>(vertices));
            std::copy(indices.begin(), indices.end(), static_cast<uint32_t*>(triangles));
            rtcSetGeometryUserData(geometry, &owners);
            rtcSetGeometryOccludedFilterFunction(geometry, passOwn);
            rtcCommitGeometry(geometry);
            rtcAttachGeometry(scene, geometry);
        }
        rtcReleaseGeometry(geometry);
    }
    rtcCommitScene(scene);
    if (const RTCError code = rtcGetDeviceError(device); code != RTC_ERROR_NONE)
        return Error{ErrorCode::kDevice, "Embree cannot take the casters of a map: free some memory, or take a smaller map",
                     static_cast<int>(code)};
    return world::Done{};
}

CasterRays::CasterRays(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
CasterRays::~CasterRays() = default;

Result<std::unique_ptr<CasterRays>> CasterRays::create(const world::CasterTable& table, const LightCasters& light,
                                                       const MapTexels& map, std::span<const CasterId> casters) {
    const double texel = light.cascades()[static_cast<size_t>(map.cascade)].texel;
    world::Box bounds;
    for (const CasterId caster : casters) bounds.add(light[caster].bounds);
    const glm::dvec3 anchor = bounds.empty() ? glm::dvec3(0) : bounds.centre();

    auto impl = std::make_unique<Impl>();
    std::vector<glm::vec3> corners;
    std::vector<uint32_t> indices;
    double reach = 0;  // of corners from the anchor
    const auto unfit = [](CasterId caster) {
        return Error{ErrorCode::kUsage, "caster " + std::to_string(caster) + ": a corner is not finite, or beyond 1e9 m"};
    };
    for (const CasterId caster : casters) {
        if (!traceable(light[caster].origin)) return unfit(caster);  // bounds of NaN are empty, and such a caster dropped
        if (!light.drawn(caster, map.cascade)) continue;
        const world::MeshLevel& level = table.meshOf(caster).levels[static_cast<size_t>(light.level(caster, map.cascade))];
        const auto first = static_cast<uint32_t>(corners.size());
        for (const glm::vec3& p : level.positions) {
            const glm::dvec3 turned = light[caster].lightFromMesh * glm::dvec3(p);
            if (!traceable(turned + light[caster].origin)) return unfit(caster);
            corners.push_back(turned + (light[caster].origin - anchor));
            reach = std::max(reach, double(glm::length(corners.back())));
        }
        for (const uint32_t index : level.indices) indices.push_back(first + index);
        impl->owners.resize(indices.size() / 3, caster);
    }
    if (const auto built = impl->build(corners, indices); !built) return built.error();

    std::vector<std::vector<CasterTexel>> chosen(casters.size());
    tbb::parallel_for(size_t(0), casters.size(), [&](size_t k) {
        chosen[k] = spread(texelsOf(table, light, map, casters[k]), size_t(kMost));
    });
    impl->firstPoint.push_back(0);
    for (size_t k = 0; k < casters.size(); ++k) {
        if (chosen[k].empty()) continue;
        impl->asked.push_back(casters[k]);
        for (const CasterTexel& t : chosen[k]) {
            const glm::dvec2 centre = (glm::dvec2(map.low) + glm::dvec2(t.texel) + 0.5) * texel;
            impl->points.push_back(glm::dvec3(centre, t.depth - reach * kRoom) - anchor);
        }
        impl->firstPoint.push_back(impl->points.size());
    }
    return std::unique_ptr<CasterRays>(new CasterRays(std::move(impl)));
}

std::span<const CasterId> CasterRays::asked() const { return impl_->asked; }

HiddenCasters CasterRays::hidden(int raysPerCaster) const {
    CHECK(raysPerCaster >= 1 && raysPerCaster <= kMost);
    struct Ray {
        size_t of = 0;  ///< index of its caster
        size_t point = 0;
        uint8_t open = 0;  ///< met nothing
    };
    const auto most = static_cast<size_t>(raysPerCaster);
    std::vector<uint8_t> open(impl_->asked.size(), 0);
    HiddenCasters found;
    for (size_t done = 0, end = 1; done < most; done = end, end = std::min(most, 4 * end)) {
        std::vector<Ray> rays;
        for (size_t k = 0; k < open.size(); ++k) {
            if (open[k]) continue;
            const size_t first = impl_->firstPoint[k], last = std::min(first + end, impl_->firstPoint[k + 1]);
            for (size_t p = first + done; p < last; ++p) rays.push_back({k, p});
        }
        tbb::parallel_for(size_t(0), (rays.size() + kPacket - 1) / kPacket, [&](size_t packet) {
            const size_t from = packet * kPacket;
            const std::span<Ray> some = std::span(rays).subspan(from, std::min(kPacket, rays.size() - from));
            ShadowRays shot;
            for (size_t i = 0; i < some.size(); ++i)
                shot.aim(i, impl_->points[some[i].point], {0, 0, -1}, std::numeric_limits<float>::infinity(),
                         impl_->asked[some[i].of]);
            shot.shoot(impl_->scene);
            for (size_t i = 0; i < some.size(); ++i) some[i].open = !shot.blocked(i);
        });
        for (const Ray& ray : rays) open[ray.of] |= ray.open;
        found.rays += rays.size();
    }
    for (size_t k = 0; k < open.size(); ++k)
        if (!open[k]) found.casters.push_back(impl_->asked[k]);
    return found;
}

}  // namespace culling
