#include "server/session.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "server/messages.h"
#include "server/stopwatch.h"
#include "world/hash.h"
#include "world/movers.h"

namespace server {

namespace v1 = gnomon::v1;
using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

namespace {

constexpr uint32_t kMostDearest = 64;

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
    std::unique_ptr<Session> session(new Session(std::move(system.value()), limits));
    session->mapBytes_ = mapBytes(config.value());
    if (request.share_maps())
        if (const auto shares = session->startSharing(); !shares) return shares.error();
    return session;
}

Result<Done> Session::move(uint64_t number, Object& object, const world::Placement& placement) {
    const ObjectUpdate update{object.id, placement};
    if (auto can = system_->requireMove(update); !can) {
        Error error = can.error();
        const std::string theirs = "object " + std::to_string(object.id);
        if (error.what.starts_with(theirs)) error.what.replace(0, theirs.size(), "object " + std::to_string(number));
        return error;
    }
    object.moved = true;
    moves_.push_back(update);
    return Done{};
}

Result<Done> Session::update(const v1::ObjectUpdate& update) {
    const uint64_t number = update.object();
    const auto known = objects_.find(number);
    const std::string who = "object " + std::to_string(number);
    const auto makes = update.has_adopt() || update.has_spawn();
    if (makes && known != objects_.end())
        return Error{ErrorCode::kUsage, who + ": the number is in use; remove it first, or give another"};
    if (makes && objects_.size() >= limits_.objects) return limitError("objects", objects_.size() + 1, limits_.objects);
    if (!makes && known == objects_.end())
        return Error{ErrorCode::kNotFound, who + ": there is none of that number; adopt or spawn it first"};
    switch (update.change_case()) {
        case v1::ObjectUpdate::kAdopt: {
            const auto id = system_->adopt(update.adopt().name());
            if (!id) return id.error();
            objects_[number] = {id.value()};
            return Done{};
        }
        case v1::ObjectUpdate::kSpawn: {
            const v1::Spawn& spawn = update.spawn();
            const auto placement = placementOf(spawn.placement());
            if (!placement) return placement.error();
            const auto id = system_->spawn(spawn.mesh(), placement.value(),
                                           {spawn.deforms(), float(spawn.margin()), spawn.at_rest()});
            if (!id) return id.error();
            objects_[number] = {id.value()};
            return Done{};
        }
        case v1::ObjectUpdate::kMove: {
            const auto placement = placementOf(update.move());
            if (!placement) return placement.error();
            return move(number, known->second, placement.value());
        }
        case v1::ObjectUpdate::kPose: {
            const auto pose = poseOf(update.pose());
            if (!pose) return pose.error();
            const world::Placement& rest = system_->restPlacement(known->second.id);
            const world::Placement placement = world::moved(rest, pose.value());
            if (!known->second.moved && world::standsAt(placement, rest)) return Done{};
            return move(number, known->second, placement);
        }
        case v1::ObjectUpdate::kMark: {
            const v1::Mark& mark = update.mark();
            return system_->mark(known->second.id, {mark.deforms(), float(mark.margin()), mark.at_rest()});
        }
        case v1::ObjectUpdate::kRemove: {
            const auto removed = system_->remove(known->second.id);
            if (!removed) return removed;
            std::erase_if(moves_, [&](const ObjectUpdate& m) { return m.object == known->second.id; });
            objects_.erase(known);
            return Done{};
        }
        case v1::ObjectUpdate::CHANGE_NOT_SET:
            break;
    }
    return Error{ErrorCode::kUsage, who + ": nothing is to happen to it; give adopt, spawn, move, pose, mark or remove"};
}

Result<SpotId> Session::spotOf(uint64_t number) const {
    const auto known = std::find_if(spots_.begin(), spots_.end(), [&](const Spot& s) { return s.number == number; });
    if (known != spots_.end()) return known->id;
    return Error{ErrorCode::kNotFound, "spot light " + std::to_string(number) + ": there is none of that number; let it shine first"};
}

Result<Done> Session::update(const v1::SpotUpdate& update) {
    const auto known = spotOf(update.spot());
    const std::string who = "spot light " + std::to_string(update.spot());
    if (update.has_remove()) {
        if (!known) return known.error();
        if (auto removed = system_->removeSpot(known.value()); !removed) return removed;
        const auto at = std::find_if(spots_.begin(), spots_.end(), [&](const Spot& s) { return s.id == known.value(); });
        mapBytes_ -= at->bytes;
        spots_.erase(at);
        return Done{};
    }
    if (!update.has_shine()) return Error{ErrorCode::kUsage, who + ": nothing is to happen to it; give shine or remove"};
    const culling::SpotLight light = server::spotOf(update.shine());
    if (known) return system_->moveSpot(known.value(), light);
    const uint64_t bytes = spotBytes(light);
    if (mapBytes_ + bytes > limits_.mapBytes) return limitError("bytes of shadow maps", mapBytes_ + bytes, limits_.mapBytes);
    const auto id = system_->addSpot(light);
    if (!id) return id.error();
    spots_.push_back({update.spot(), id.value(), bytes});
    mapBytes_ += bytes;
    return Done{};
}

Result<v1::FrameReply> Session::frame(const v1::Frame& request) {
    if (size_t(request.objects_size()) > limits_.updates)
        return limitError("updates of objects in a frame", uint64_t(request.objects_size()), limits_.updates);
    if (size_t(request.edits_size()) > limits_.edits)
        return limitError("edits in a frame", uint64_t(request.edits_size()), limits_.edits);
    if (size_t(request.spots_size()) > limits_.spots)
        return limitError("updates of spot lights in a frame", uint64_t(request.spots_size()), limits_.spots);
    FrameInput input;
    input.time = request.time();
    std::vector<Camera> cameras;
    for (const v1::Camera& c : request.cameras()) cameras.push_back(cameraOf(c));
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
    for (int i = 0; i < request.spots_size(); ++i)
        if (const auto done = update(request.spots(i)); !done) put(reply, v1::ItemError::SPOT, uint32_t(i), done.error());
    input.objects = moves_;
    rays_.reset();

    // A budget in time learns from the GPU's time; who watches is shown it. Nobody else needs it at once.
    const bool waits = request.wants().gpu_time() || system_->config().budget.ms > 0 || (live_ && live_->watched());
    const Stopwatch watch;
    auto report = system_->advance(input);
    if (!report && report.error().code == ErrorCode::kUsage) {
        put(reply, v1::ItemError::FRAME, 0, report.error());
        return reply;
    }
    if (!report) return report.error();
    if (waits)
        if (const auto finished = system_->finish(report.value()); !finished) return finished.error();
    moves_.clear();
    report_ = std::move(report.value());
    ++frames_;
    const double ms = watch.ms();
    if (live_) live_->publish(*system_, input, report_, ms);
    reply.mutable_times()->set_advance(ms);
    put(reply, report_);
    cameras_ = std::move(cameras);
    for (int c = 0; c < system_->cascades(); ++c) {
        v1::Cascade* to = reply.add_cascades();
        put(to, system_->view(c));
        put(to, report_.cascades[size_t(c)]);
    }
    for (size_t i = 0; i < spots_.size(); ++i) {
        const auto view = system_->viewSpot(spots_[i].id);
        v1::Spot* to = reply.add_spots();
        to->set_spot(spots_[i].number);
        to->set_drawn(view && view.value().drawn);
        const cache::SpotStatistics& cost = report_.spots[i].cost;
        put(to->mutable_statics(), cost.statics);
        if (cost.statics != cache::Cost{}) to->set_cause(cache::toString(cost.cause));
        put(to->mutable_active(), cost.active);
    }
    if (shared_)
        if (const auto shares = shareMaps(); !shares) return shares.error();
    if (const auto told = tellWanted(request, reply); !told) return told.error();
    return reply;
}

Result<Done> Session::startSharing() {
    const ShadowConfig& config = system_->config();
    const SharedShape shape{uint32_t(system_->cascades()), uint32_t(config.side), config.format == gpu::DepthFormat::kD16 ? 2u : 4u};
    mapBytes_ += shape.bytes();
    if (mapBytes_ > limits_.mapBytes) return limitError("bytes of shadow maps", mapBytes_, limits_.mapBytes);
    auto made = SharedMaps::create(shape);
    if (!made) return made.error();
    shared_ = std::move(made.value());
    if (const auto sealed = shared_->seal(); !sealed) return sealed;
    if (const auto imported = system_->share(shared_->memory()); !imported) return imported.error();
    return Done{};
}

/// Those that are not what they were, while readers are told to wait.
Result<Done> Session::shareMaps() {
    std::vector<gpu::ShadowMaps::MapCopy> copies;
    const bool first = sharedViews_.empty();
    sharedViews_.resize(size_t(system_->cascades()));
    for (int c = 0; c < system_->cascades(); ++c) {
        const cache::CascadeStatistics& cost = report_.cascades[size_t(c)];
        const CascadeView now = system_->view(c);
        CascadeView& before = sharedViews_[size_t(c)];
        const bool moved = now.depthNear != before.depthNear || now.depthRange != before.depthRange || now.lightFromWorld != before.lightFromWorld;
        if (first || moved || cost.total.texels > 0 || cost.active.texels > 0) copies.push_back({c, shared_->offset(c)});
        before = now;
    }
    shared_->begin();
    const auto copied = system_->copyWorking(std::move(copies));
    shared_->end(frames_ - 1);
    return copied;
}

Result<Done> Session::tellWanted(const v1::Frame& request, v1::FrameReply& reply) {
    const v1::Wants& wants = request.wants();
    const auto hashInto = [](const Result<std::vector<float>>& depths, auto set) -> Result<Done> {
        if (!depths) return depths.error();
        set(world::hashValues(std::span<const float>(depths.value())));
        return Done{};
    };
    const RedrawCosts whole = wants.whole_redraws() ? system_->redrawCosts() : RedrawCosts{};
    for (int c = 0; c < system_->cascades(); ++c) {
        v1::Cascade* to = reply.mutable_cascades(c);
        if (wants.whole_redraws()) put(to->mutable_whole(), whole[size_t(c)]);
        if (!wants.hashes()) continue;
        auto done = hashInto(system_->readMap(c, gpu::MapKind::kCache), [to](uint64_t hash) { to->set_cache_hash(hash); });
        if (done) done = hashInto(system_->readMap(c, gpu::MapKind::kWorking), [to](uint64_t hash) { to->set_working_hash(hash); });
        if (!done) return done;
    }
    for (size_t i = 0; wants.hashes() && i < spots_.size(); ++i) {
        v1::Spot* to = reply.mutable_spots(int(i));
        auto done = hashInto(system_->readSpotMap(spots_[i].id, gpu::MapKind::kCache), [to](uint64_t hash) { to->set_cache_hash(hash); });
        if (done) done = hashInto(system_->readSpotMap(spots_[i].id, gpu::MapKind::kWorking), [to](uint64_t hash) { to->set_working_hash(hash); });
        if (!done) return done;
    }
    if (wants.dearest_casters() == 0) return Done{};
    for (const CasterCost& cost : system_->dearestCasters(std::min(wants.dearest_casters(), kMostDearest))) {
        v1::CasterCost* to = reply.add_dearest();
        to->set_name(cost.name);
        put(to->mutable_middle(), cost.pWorld);
        to->set_triangles(cost.triangles);
        to->set_draws(cost.draws);
    }
    return Done{};
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
    auto spots = std::move(*into.mutable_spots());
    v1::Wants wants = into.wants();
    wants.set_hashes(wants.hashes() || later.wants().hashes());
    wants.set_whole_redraws(wants.whole_redraws() || later.wants().whole_redraws());
    wants.set_gpu_time(wants.gpu_time() || later.wants().gpu_time());
    wants.set_dearest_casters(std::max(wants.dearest_casters(), later.wants().dearest_casters()));
    const bool sun = !later.has_sun() && into.has_sun(), budget = !later.has_budget() && into.has_budget();
    if (sun) *later.mutable_sun() = into.sun();
    if (budget) *later.mutable_budget() = into.budget();
    objects.MergeFrom(later.objects());
    edits.MergeFrom(later.edits());
    spots.MergeFrom(later.spots());
    into = std::move(later);
    *into.mutable_objects() = std::move(objects);
    *into.mutable_edits() = std::move(edits);
    *into.mutable_spots() = std::move(spots);
    *into.mutable_wants() = wants;
}

}  // namespace server
