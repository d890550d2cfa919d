#include "server/session.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "server/gnomon.pb.h"
#include "server/stopwatch.h"

namespace server {

namespace v1 = gnomon::v1;
using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

namespace {

glm::dvec3 vectorOf(const v1::Vector& v) { return {v.x(), v.y(), v.z()}; }

void put(v1::Vector* to, glm::dvec3 v) {
    to->set_x(v.x);
    to->set_y(v.y);
    to->set_z(v.z);
}

Error limit(const std::string& what, uint64_t asked, uint64_t most) {
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

/// None given: it looks along -z.
glm::dquat orientationOf(const v1::Camera& camera) {
    if (!camera.has_orientation()) return glm::dquat(1, 0, 0, 0);
    const v1::Quaternion& q = camera.orientation();
    return glm::dquat(q.w(), q.x(), q.y(), q.z());
}

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
    const auto texels = uint64_t(config.side) * uint64_t(config.side) * uint64_t(config.cascades) * uint64_t(config.cameras);
    const uint64_t bytes = texels * (r.depth16() ? 2 : 4) * 2 * (config.movingSun ? 2 : 1);
    if (bytes > limits.mapBytes) return limit("bytes of shadow maps", bytes, limits.mapBytes);
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
    for (const Error& error : r.errors) put(reply, v1::ItemError::FRAME, 0, error);
}

}  // namespace

Session::Session(std::unique_ptr<ShadowSystem> system, const SessionLimits& limits)
    : system_(std::move(system)), limits_(limits) {}
Session::~Session() = default;

Result<std::unique_ptr<Session>> Session::open(gpu::Device& device, const world::WorldStore& store,
                                               const v1::OpenSession& request, const SessionLimits& limits) {
    const auto config = configOf(request, limits);
    if (!config) return config.error();
    auto system = ShadowSystem::create(device, store, config.value());
    if (!system) return system.error();
    return std::unique_ptr<Session>(new Session(std::move(system.value()), limits));
}

Result<Done> Session::update(const v1::ObjectUpdate& update) {
    const uint64_t number = update.object();
    const auto known = objects_.find(number);
    const std::string who = "object " + std::to_string(number);
    const auto makes = update.has_adopt() || update.has_spawn();
    if (makes && known != objects_.end())
        return Error{ErrorCode::kUsage, who + ": the number is in use; remove it first, or give another"};
    if (makes && objects_.size() >= limits_.objects) return limit("objects", objects_.size() + 1, limits_.objects);
    if (!makes && known == objects_.end())
        return Error{ErrorCode::kNotFound, who + ": there is none of that number; adopt or spawn it first"};
    switch (update.change_case()) {
        case v1::ObjectUpdate::kAdopt: {
            const auto id = system_->adopt(update.adopt().name());
            if (!id) return id.error();
            objects_[number] = id.value();
            return Done{};
        }
        case v1::ObjectUpdate::kSpawn: {
            const v1::Spawn& spawn = update.spawn();
            const auto placement = placementOf(spawn.placement());
            if (!placement) return placement.error();
            const auto id = system_->spawn(spawn.mesh(), placement.value(),
                                           {spawn.deforms(), float(spawn.margin()), spawn.at_rest()});
            if (!id) return id.error();
            objects_[number] = id.value();
            return Done{};
        }
        case v1::ObjectUpdate::kMove: {
            const auto placement = placementOf(update.move());
            if (!placement) return placement.error();
            const ObjectUpdate move{known->second, placement.value()};
            if (auto can = system_->requireMove(move); !can) {
                Error error = can.error();
                const std::string theirs = "object " + std::to_string(known->second);
                if (error.what.starts_with(theirs)) error.what.replace(0, theirs.size(), who);
                return error;
            }
            moves_.push_back(move);
            return Done{};
        }
        case v1::ObjectUpdate::kRemove: {
            const auto removed = system_->remove(known->second);
            if (!removed) return removed;
            std::erase_if(moves_, [&](const ObjectUpdate& m) { return m.object == known->second; });
            objects_.erase(known);
            return Done{};
        }
        case v1::ObjectUpdate::CHANGE_NOT_SET:
            break;
    }
    return Error{ErrorCode::kUsage, who + ": nothing is to happen to it; give adopt, spawn, move or remove"};
}

Result<v1::FrameReply> Session::frame(const v1::Frame& request) {
    if (size_t(request.objects_size()) > limits_.updates)
        return limit("updates of objects in a frame", uint64_t(request.objects_size()), limits_.updates);
    if (size_t(request.edits_size()) > limits_.edits)
        return limit("edits in a frame", uint64_t(request.edits_size()), limits_.edits);
    FrameInput input;
    input.time = request.time();
    std::vector<Camera> cameras;
    for (const v1::Camera& c : request.cameras())
        cameras.push_back({vectorOf(c.position()), orientationOf(c), c.vertical_fov(), c.aspect() == 0 ? 1 : c.aspect(), {}});
    if (cameras.empty()) cameras.resize(1, {glm::dvec3(std::nan(""))});  // which is refused below, like any that is nowhere
    input.camera = cameras.front();
    input.others = std::span(cameras).subspan(1);
    if (request.has_sun()) input.sun = vectorOf(request.sun());

    v1::FrameReply reply;
    reply.set_sequence(request.sequence());
    reply.set_answers(1);
    reply.set_frame(frames_);
    if (request.has_budget())
        if (const auto set = system_->setBudget(budgetOf(request.budget())); !set) put(reply, v1::ItemError::FRAME, 0, set.error());
    for (int i = 0; i < request.objects_size(); ++i)
        if (const auto done = update(request.objects(i)); !done) put(reply, v1::ItemError::OBJECT, uint32_t(i), done.error());
    for (int i = 0; i < request.edits_size(); ++i) {
        const auto edit = editOf(request.edits(i));
        const auto given = edit ? system_->edit(edit.value()) : Result<Done>(edit.error());
        if (!given) put(reply, v1::ItemError::EDIT, uint32_t(i), given.error());
    }
    input.objects = moves_;

    const Stopwatch watch;
    auto report = system_->advance(input);
    if (!report && report.error().code == ErrorCode::kUsage) {
        put(reply, v1::ItemError::FRAME, 0, report.error());
        return reply;
    }
    if (!report) return report.error();
    if (const auto finished = system_->finish(report.value()); !finished) return finished.error();
    moves_.clear();
    report_ = std::move(report.value());
    ++frames_;
    const double ms = watch.ms();
    if (live_) live_->publish(*system_, input, report_, ms);
    reply.mutable_times()->set_advance(ms);
    reply.mutable_times()->set_gpu(report_.gpu.wallMs);
    put(reply, report_);
    for (int c = 0; c < system_->cascades(); ++c) {
        v1::Cascade* to = reply.add_cascades();
        put(to, system_->view(c));
        put(to, report_.cascades[size_t(c)]);
        if (!request.hashes()) continue;
        const auto cacheHash = system_->mapHash(c, gpu::MapKind::kCache), workingHash = system_->mapHash(c, gpu::MapKind::kWorking);
        if (!cacheHash) return cacheHash.error();
        if (!workingHash) return workingHash.error();
        to->set_cache_hash(cacheHash.value());
        to->set_working_hash(workingHash.value());
    }
    return reply;
}

v1::Cascade Session::cascade(int number) const {
    v1::Cascade cascade;
    put(&cascade, system_->view(number));
    return cascade;
}

v1::WorldInfo describe(const OpenedWorld& opened) {
    const world::WorldStore& store = opened.store;
    v1::WorldInfo info;
    info.set_name(opened.name);
    info.set_source(store.header().source);
    put(info.mutable_low(), store.header().bounds.min);
    put(info.mutable_high(), store.header().bounds.max);
    info.set_chunks(store.chunks().size());
    info.set_meshes(uint32_t(store.meshes().size()));
    put(info.mutable_sun(), store.header().sun);
    info.set_content(opened.content);
    return info;
}

void fillDefaults(v1::OpenSession& r, const ShadowConfig& defaults) {
    if (r.cameras() == 0) r.set_cameras(uint32_t(defaults.cameras));
    if (r.cascades() == 0) r.set_cascades(uint32_t(defaults.cascades));
    if (r.side() == 0) r.set_side(uint32_t(defaults.side));
    if (r.far() == 0) r.set_far(defaults.farDistance);
    if (r.split_ratio() == 0) r.set_split_ratio(defaults.splitRatio);
    if (r.guard_band() == 0) r.set_guard_band(uint32_t(defaults.guardBand));
    if (r.level_error() == 0) r.set_level_error(defaults.levelError);
    if (r.smallest_caster() == 0) r.set_smallest_caster(defaults.smallestCaster);
    if (defaults.format == gpu::DepthFormat::kD16) r.set_depth16(true);
    if (!defaults.occlusion) r.set_no_occlusion(true);
    if (r.rays() == 0) r.set_rays(defaults.raysPerCluster);
}

void mergeFrames(v1::Frame& into, v1::Frame&& later) {
    auto objects = std::move(*into.mutable_objects());
    auto edits = std::move(*into.mutable_edits());
    const bool hashes = into.hashes() || later.hashes();
    const bool sun = !later.has_sun() && into.has_sun(), budget = !later.has_budget() && into.has_budget();
    if (sun) *later.mutable_sun() = into.sun();
    if (budget) *later.mutable_budget() = into.budget();
    objects.MergeFrom(later.objects());
    edits.MergeFrom(later.edits());
    into = std::move(later);
    *into.mutable_objects() = std::move(objects);
    *into.mutable_edits() = std::move(edits);
    into.set_hashes(hashes);
}

}  // namespace server
