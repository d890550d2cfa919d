#include "server/messages.h"

#include <algorithm>

#include "world/record_text.h"

namespace server {

namespace v1 = gnomon::v1;
using world::Error;
using world::ErrorCode;
using world::Result;

v1::Code codeOf(ErrorCode code) {
    switch (code) {
        case ErrorCode::kUsage: return v1::USAGE;
        case ErrorCode::kNotFound: return v1::NOT_FOUND;
        case ErrorCode::kBadData: return v1::BAD_DATA;
        case ErrorCode::kIo: return v1::IO;
        case ErrorCode::kDevice: return v1::DEVICE;
        case ErrorCode::kLimit: return v1::LIMIT;
    }
    return v1::USAGE;
}

ErrorCode codeOf(v1::Code code) {
    switch (code) {
        case v1::NOT_FOUND: return ErrorCode::kNotFound;
        case v1::BAD_DATA: return ErrorCode::kBadData;
        case v1::IO: return ErrorCode::kIo;
        case v1::DEVICE: return ErrorCode::kDevice;
        case v1::LIMIT: return ErrorCode::kLimit;
        default: return ErrorCode::kUsage;
    }
}

glm::dvec3 vectorOf(const v1::Vector& v) { return {v.x(), v.y(), v.z()}; }

void put(v1::Vector* to, glm::dvec3 v) {
    to->set_x(v.x);
    to->set_y(v.y);
    to->set_z(v.z);
}

Error limitError(const std::string& what, uint64_t asked, uint64_t most) {
    return {ErrorCode::kLimit, what + ": " + std::to_string(asked) + ", and a session may have " + std::to_string(most)};
}

Result<world::Placement> placementOf(const v1::Placement& p) {
    world::Placement placement;
    placement.translation = vectorOf(p.translation());
    if (p.linear_size() == 0) return placement;
    if (p.linear_size() != 9)
        return Error{ErrorCode::kUsage, "placement.linear: " + std::to_string(p.linear_size()) + " numbers; give 9, three columns, or none"};
    for (int i = 0; i < 9; ++i) placement.linear[i / 3][i % 3] = p.linear(i);
    return placement;
}

Result<world::MoverSample> poseOf(const v1::Pose& p) {
    world::MoverSample pose{0, vectorOf(p.position())};
    if (p.has_orientation()) {
        const v1::Quaternion& q = p.orientation();
        const auto unit = world::unitQuaternion(q.x(), q.y(), q.z(), q.w());
        if (!unit) return Error{ErrorCode::kUsage, "pose.orientation: no rotation; give a unit quaternion"};
        pose.orientation = *unit;
    }
    if (p.scale() != 0) pose.scale = p.scale();
    if (!(pose.scale > 0)) return Error{ErrorCode::kUsage, "pose.scale: give one above 0"};
    return pose;
}

Result<world::TerrainEdit> editOf(const v1::TerrainEdit& e) {
    world::TerrainEdit edit{e.fill() ? world::EditKind::kFill : world::EditKind::kDig, {}};
    switch (e.shape_case()) {
        case v1::TerrainEdit::kSphere:
            edit.shape = world::Sphere{vectorOf(e.sphere().centre()), e.sphere().radius()};
            return edit;
        case v1::TerrainEdit::kBox:
            edit.shape = world::Box{vectorOf(e.box().low()), vectorOf(e.box().high())};
            return edit;
        case v1::TerrainEdit::kCapsule:
            edit.shape = world::Capsule{vectorOf(e.capsule().from()), vectorOf(e.capsule().to()), e.capsule().radius()};
            return edit;
        case v1::TerrainEdit::SHAPE_NOT_SET:
            break;
    }
    return Error{ErrorCode::kUsage, "edit: it has no shape; give a sphere, a box or a capsule"};
}

Budget budgetOf(const v1::Budget& b) {
    Budget budget;
    if (b.texels() > 0) budget.texels = b.texels();
    if (b.triangles() > 0) budget.triangles = b.triangles();
    budget.ms = b.ms();
    return budget;
}

Camera cameraOf(const v1::Camera& c) {
    Camera camera;
    camera.position = vectorOf(c.position());
    if (c.has_orientation()) {
        const v1::Quaternion& q = c.orientation();
        camera.orientation = world::unitQuaternion(q.x(), q.y(), q.z(), q.w()).value_or(glm::dquat(q.w(), q.x(), q.y(), q.z()));
    }
    camera.verticalFov = c.vertical_fov();
    if (c.aspect() != 0) camera.aspect = c.aspect();
    return camera;
}

culling::SpotLight spotOf(const v1::SpotLight& s) {
    culling::SpotLight spot;
    spot.position = vectorOf(s.position());
    spot.direction = vectorOf(s.direction());
    if (s.half_angle() != 0) spot.halfAngle = s.half_angle();
    if (s.near() != 0) spot.near = s.near();
    if (s.range() != 0) spot.range = s.range();
    if (s.side() != 0) spot.side = int(std::min(s.side(), 1u << 20));
    return spot;
}

LookupBias biasOf(const v1::QueryShadowRequest& r) {
    LookupBias bias;
    if (r.bias_texels() != 0) bias.texels = r.bias_texels();
    if (r.bias_metres() != 0) bias.metres = r.bias_metres();
    return bias;
}

uint64_t mapBytes(const ShadowConfig& config) {
    const auto texels = uint64_t(config.side) * uint64_t(config.side) * uint64_t(config.cascades) * uint64_t(config.cameras);
    return texels * (config.format == gpu::DepthFormat::kD16 ? 2 : 4) * 2 * (config.movingSun ? 2 : 1);
}

uint64_t spotBytes(const culling::SpotLight& light) { return uint64_t(light.side) * uint64_t(light.side) * 4 * 2; }

Result<ShadowConfig> configOf(const v1::OpenSession& r, const SessionLimits& limits) {
    ShadowConfig config;
    if (r.cameras() > 0) config.cameras = int(std::min(r.cameras(), 1000u));
    if (r.cascades() > 0) config.cascades = int(std::min(r.cascades(), 1000u));
    if (r.side() > 0) config.side = int(std::min(r.side(), 1u << 20));
    if (r.far() != 0) config.farDistance = r.far();
    if (r.split_ratio() != 0) config.splitRatio = r.split_ratio();
    if (r.guard_band() > 0) config.guardBand = int(std::min(r.guard_band(), 1u << 20));
    if (r.level_error() != 0) config.levelError = r.level_error();
    config.smallestCaster = r.smallest_caster();
    config.format = r.depth16() ? gpu::DepthFormat::kD16 : gpu::DepthFormat::kD32;
    config.movingSun = r.moving_sun();
    if (r.has_sun()) config.sun = vectorOf(r.sun());
    config.streaming.clock = r.clock() == v1::LIVE      ? world::Clock::kLive
                             : r.clock() == v1::VIRTUAL ? world::Clock::kVirtual
                                                        : world::Clock::kLockStep;
    config.budget = budgetOf(r.budget());
    if (r.rest_seconds() != 0) config.restSeconds = r.rest_seconds();
    config.occlusion = !r.no_occlusion();
    if (r.rays() > 0) config.raysPerCluster = r.rays();
    config.timestamps = false;
    config.residentBytes = limits.residentBytes;
    config.geometryBytes = limits.geometryBytes;
    const uint64_t bytes = mapBytes(config);
    if (bytes > limits.mapBytes) return limitError("bytes of shadow maps", bytes, limits.mapBytes);
    return config;
}

void put(v1::Cost* to, const cache::Cost& cost) {
    to->set_texels(cost.texels);
    to->set_casters(cost.casters);
    to->set_triangles(cost.triangles);
    to->set_draws(cost.draws);
}

void put(v1::Cascade* to, const CascadeView& view) {
    to->set_texel(view.texel);
    to->set_split(view.split);
    to->set_window_x(view.window.x);
    to->set_window_y(view.window.y);
    to->set_depth_near(view.depthNear);
    to->set_depth_range(view.depthRange);
    for (int i = 0; i < 9; ++i) to->add_light_from_world(view.lightFromWorld[i / 3][i % 3]);
    to->set_drawn(view.drawn);
}

void put(v1::Cascade* to, const cache::CascadeStatistics& s) {
    to->set_asleep(s.asleep);
    put(to->mutable_total(), s.total);
    for (size_t cause = 0; cause < s.byCause.size(); ++cause) {
        if (s.byCause[cause] == cache::Cost{}) continue;
        v1::CauseCost* c = to->add_causes();
        c->set_cause(cache::toString(cache::Cause(cause)));
        put(c->mutable_cost(), s.byCause[cause]);
    }
    put(to->mutable_active(), s.active);
    to->set_clusters_found(s.clustersFound);
    to->set_clusters_hidden(s.clustersHidden);
    to->set_unknown_texels(s.unknownTexels);
    to->set_stale_texels(s.staleTexels);
    to->set_oldest_debt(s.oldestDebt);
    to->set_missing_texels(s.missingTexels);
    to->set_coarse_texels(s.coarseTexels);
    to->set_sun_error(s.sunError);
}

void put(v1::FrameReply& reply, v1::ItemError::Kind kind, uint32_t index, const Error& error) {
    v1::ItemError* e = reply.add_errors();
    e->set_kind(kind);
    e->set_index(index);
    e->set_code(codeOf(error.code));
    e->set_what(error.what);
}

void put(v1::FrameReply& reply, const FrameReport& r) {
    reply.set_plan_hash(r.planHash);
    reply.set_submitted(r.submitted);
    reply.set_chunk_arrivals(r.chunkArrivals);
    reply.set_chunk_departures(r.chunkDepartures);
    reply.set_chunk_refinements(r.refinements);
    reply.set_missing_chunks(r.missingChunks);
    reply.set_coarse_chunks(r.coarseChunks);
    reply.set_edits(r.edits);
    reply.set_bytes_read(r.bytesRead);
    reply.set_resident_bytes(r.residentBytes);
    reply.set_geometry_bytes(r.geometryBytes);
    reply.set_bytes_uploaded(r.bytesUploaded);
    reply.set_rays(r.rays);
    reply.set_certificates(r.certificates);
    reply.set_revocations(r.revocations);
    put(reply.mutable_sun_shown(), r.sun.shown);
    if (r.sun.next != glm::dvec3(0)) put(reply.mutable_sun_next(), r.sun.next);
    reply.set_sun_weight(r.sun.weight);
    v1::Times* times = reply.mutable_times();
    times->set_gpu(r.gpu.wallMs);
    times->set_stream(r.cpu.streamMs);
    times->set_occlusion(r.cpu.occlusionMs);
    times->set_sets(r.cpu.setsMs);
    times->set_plan(r.cpu.planMs);
    times->set_record(r.cpu.recordMs);
    for (const Error& error : r.errors) put(reply, v1::ItemError::FRAME, 0, error);
}

}  // namespace server
