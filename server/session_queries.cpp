// server/session_queries.cpp — the part of Session that answers questions about the last frame.

#include <cmath>
#include <cstring>
#include <utility>

#include "server/messages.h"
#include "server/session.h"
#include "server/shadow_mask.h"

namespace server {

namespace v1 = gnomon::v1;
using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

namespace {

constexpr size_t kPointBytes = 24, kNormalBytes = 12;
constexpr uint32_t kMostPixels = 1u << 22;  ///< of a mask

Error usage(const std::string& what) { return {ErrorCode::kUsage, what}; }

Result<std::vector<glm::dvec3>> pointsOf(const v1::QueryShadowRequest& request, size_t most) {
    if (request.points().size() % kPointBytes != 0) return usage("points: give 24 bytes each, x, y and z as doubles");
    const size_t count = request.points().size() / kPointBytes;
    if (count > most)
        return Error{ErrorCode::kLimit, "points: " + std::to_string(count) + "; ask for at most " + std::to_string(most) + " at once"};
    if (!request.normals().empty() && request.normals().size() != count * kNormalBytes)
        return usage("normals: give 12 bytes a point, x, y and z as floats, or none");
    std::vector<glm::dvec3> points(count);
    std::memcpy(points.data(), request.points().data(), request.points().size());
    for (size_t i = 0; !request.normals().empty() && i < count; ++i) {
        glm::vec3 normal;
        std::memcpy(&normal, request.normals().data() + i * kNormalBytes, kNormalBytes);
        points[i] += glm::dvec3(normal) * request.normal_offset();
    }
    for (const glm::dvec3& p : points)
        if (!std::isfinite(p.x + p.y + p.z)) return usage("points: one is not finite; give metres");
    return points;
}

v1::Light lightOf(Light light) { return light == Light::kLit ? v1::LIT : light == Light::kShadowed ? v1::SHADOWED : v1::UNKNOWN; }

v1::Light lightOf(SpotAnswer light) {
    switch (light) {
        case SpotAnswer::kLit: return v1::LIT;
        case SpotAnswer::kShadowed: return v1::SHADOWED;
        case SpotAnswer::kOutside: return v1::OUTSIDE;
        case SpotAnswer::kUnknown: break;
    }
    return v1::UNKNOWN;
}

v1::Surface surfaceOf(culling::Sunlight state, bool known) {
    if (state == culling::Sunlight::kSky) return v1::SKY;
    if (state == culling::Sunlight::kAway) return v1::AWAY;
    return known ? v1::FACING : v1::UNMAPPED;
}

}  // namespace

Result<Done> Session::requireFrame() const {
    if (frames_ > 0) return Done{};
    return usage("session: it has not drawn a frame yet; send one first");
}

Result<culling::Truth*> Session::rays() {
    if (!rays_) {
        auto made = traceable(system_->casters());
        if (!made) return made.error();
        rays_ = std::move(made.value());
    }
    return rays_.get();
}

Result<v1::QueryShadowReply> Session::query(const v1::QueryShadowRequest& request) {
    if (auto ready = requireFrame(); !ready) return ready.error();
    const auto points = pointsOf(request, limits_.queryPoints);
    if (!points) return points.error();
    const LookupBias bias = biasOf(request);
    if (!std::isfinite(bias.texels) || !std::isfinite(bias.metres)) return usage("bias: not finite");
    if (request.camera() >= cameras_.size()) return usage("camera: the session has " + std::to_string(cameras_.size()));
    if (request.by_rays() && request.has_spot()) return usage("spot: rays are traced to the sun alone; leave out one of the two");

    const size_t count = points.value().size();
    v1::QueryShadowReply reply;
    reply.set_frame(frames_ - 1);
    std::string &light = *reply.mutable_light(), &cascade = *reply.mutable_cascade(), &flags = *reply.mutable_flags();
    light.resize(count);
    cascade.assign(count, char(-1));
    flags.resize(count);
    if (request.by_rays()) {
        const auto traced = rays();
        if (!traced) return traced.error();
        const auto states = traced.value()->lightAt(points.value(), report_.sun.shown, bias.metres, cameras_[request.camera()].position);
        if (!states) return states.error();
        for (size_t i = 0; i < count; ++i) light[i] = char(states.value()[i] == culling::Sunlight::kLit ? v1::LIT : v1::SHADOWED);
    } else if (request.has_spot()) {
        const auto id = spotOf(request.spot());
        if (!id) return id.error();
        const auto answers = system_->lookupSpot(id.value(), points.value(), bias);
        if (!answers) return answers.error();
        for (size_t i = 0; i < count; ++i) light[i] = char(lightOf(answers.value()[i]));
    } else {
        const auto answers = system_->lookup(points.value(), bias, int(request.camera()));
        if (!answers) return answers.error();
        for (size_t i = 0; i < count; ++i) {
            const PointAnswer& answer = answers.value()[i];
            light[i] = char(lightOf(answer.light));
            cascade[i] = char(answer.cascade);
            flags[i] = char((answer.fell ? 1 : 0) | (answer.stale ? 2 : 0));
        }
    }
    return reply;
}

Result<v1::ShadowMask> Session::mask(const v1::GetShadowMaskRequest& request) {
    if (auto ready = requireFrame(); !ready) return ready.error();
    if (request.camera() >= cameras_.size()) return usage("camera: the session has " + std::to_string(cameras_.size()));
    const uint64_t pixels = uint64_t(request.width()) * request.height();
    if (pixels == 0) return usage("mask: give its width and height in pixels");
    if (pixels > kMostPixels)
        return Error{ErrorCode::kLimit, "mask: " + std::to_string(pixels) + " pixels; ask for at most " + std::to_string(kMostPixels)};
    const Camera& camera = cameras_[request.camera()];
    if (camera.verticalFov == 0) return usage("mask: the camera's last frame told no field of view; give vertical_fov");
    const auto traced = rays();
    if (!traced) return traced.error();
    const auto seen = traced.value()->trace({camera.position, camera.orientation, camera.verticalFov, camera.aspect}, int(request.width()),
                                            int(request.height()), system_->config().farDistance, report_.sun.shown, false);
    if (!seen) return seen.error();

    v1::ShadowMask mask;
    mask.set_frame(frames_ - 1);
    mask.mutable_light()->resize(pixels);
    mask.mutable_surface()->resize(pixels);
    std::vector<bool> known(pixels, true);
    std::vector<float> light;
    if (request.by_rays()) {
        for (const culling::Sunlight state : seen.value().states)
            light.push_back(state == culling::Sunlight::kSky || state == culling::Sunlight::kLit ? 1.0f : 0.0f);
    } else {
        auto byMaps = lightByMaps(*system_, int(request.camera()), seen.value(), known);
        if (!byMaps) return byMaps.error();
        light = std::move(byMaps.value());
    }
    for (size_t i = 0; i < pixels; ++i) {
        (*mask.mutable_light())[i] = char(uint8_t(std::lround(light[i] * 255)));
        (*mask.mutable_surface())[i] = char(surfaceOf(seen.value().states[i], known[i]));
    }
    return mask;
}

Result<Session::DepthMap> Session::depthMap(const v1::GetDepthMapRequest& request) {
    if (auto ready = requireFrame(); !ready) return ready.error();
    const gpu::MapKind kind = request.working() ? gpu::MapKind::kWorking : gpu::MapKind::kCache;
    DepthMap map;
    if (request.has_spot()) {
        const auto id = spotOf(request.spot());
        if (!id) return id.error();
        auto depths = system_->readSpotMap(id.value(), kind);
        if (!depths) return depths.error();
        map.side = system_->viewSpot(id.value()).value().space.light.side;
        map.depths = std::move(depths.value());
        return map;
    }
    if (request.cascade() >= uint32_t(system_->cascades()))
        return usage("cascade: the session has " + std::to_string(system_->cascades()));
    map.cascade = int(request.cascade());
    auto depths = system_->readMap(map.cascade, kind);
    if (!depths) return depths.error();
    map.side = system_->config().side;
    map.depths = std::move(depths.value());
    return map;
}

}  // namespace server
