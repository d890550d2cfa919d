#include "server/resident_scene.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "culling/caster_query.h"
#include "server/stopwatch.h"

namespace server {

namespace {

/// Certificates are sought this share of a cascade's split around its window, and again when the eye has used
/// up half of that.
constexpr double kSlack = 0.25;

/// The octree splits no further than cells of this edge [m]: smaller ones hold single props.
constexpr double kSmallestCell = 8;

/// Casters reach no farther from the world's origin [m]: texels are counted in 64 bits, but a placement
/// this far off is a mistake.
constexpr double kFarthest = 1e8;

bool finite(const world::Placement& p) {
    for (int c = 0; c < 3; ++c)
        for (int r = 0; r < 3; ++r)
            if (!std::isfinite(p.linear[c][r])) return false;
    return std::isfinite(p.translation.x) && std::isfinite(p.translation.y) && std::isfinite(p.translation.z);
}

}  // namespace

ResidentScene::ResidentScene(const world::WorldStore& store, gpu::ShadowMaps& maps, const culling::LightSpace& space,
                             const std::vector<culling::Cascade>& cascades, const SceneConfig& config)
    : store_(store),
      maps_(maps),
      config_(config),
      streamer_(store, config.streamer),
      outlook_(config.streamer.clock == world::Clock::kLockStep, config.prefetch),
      statics_(store.header().bounds, kSmallestCell),
      sets_(config.restSeconds, config.promotionsPerFrame) {
    sides_.push_back(std::make_unique<SunSide>(space, cascades, config.detail));
    sides_.front()->whole = true;
}

void ResidentScene::fit(SunSide& side, size_t slots) {
    if (side.whole) return;
    const size_t end = std::min(table_.slots(), side.fitted + slots);
    side.light.reserve(table_.slots());
    tbb::parallel_for(world::CasterId(side.fitted), world::CasterId(end), [&](world::CasterId id) {
        if (table_[id].state == world::CasterState::kStatic) side.light.addStatic(id, table_);
        if (table_[id].state == world::CasterState::kActive) side.light.addActive(id, table_);
    });
    side.fitted = end;
    side.whole = end == table_.slots();
}

void ResidentScene::openNext(const culling::LightSpace& space) {
    CHECK(sides_.size() == 1);
    sides_.push_back(std::make_unique<SunSide>(space, shown().light.cascades(), config_.detail));
    sides_.back()->light.reserve(table_.slots());  // what leaves before it is fitted leaves an empty box
    outlook_.forget();  // the new light comes through other chunks
}

bool ResidentScene::fitNext(double share) {
    CHECK(sides_.size() == 2);
    SunSide& next = *sides_.back();
    fit(next, static_cast<size_t>(std::ceil(share * double(table_.slots()))));
    return next.whole;
}

world::Result<ResidentScene::Refit> ResidentScene::refit(const std::vector<culling::Cascade>& cascades,
                                                         const SceneConfig& config, std::span<const int> from) {
    CHECK(sides_.size() == 1 && from.size() == cascades.size());
    SunSide& old = *sides_.front();
    auto side = std::make_unique<SunSide>(old.light.space(), cascades, config.detail);
    fit(*side, table_.slots());
    side->departures = old.departures;
    side->activeDirt = old.activeDirt;
    std::vector<cache::Arrival> arrivals = arrivals_;
    for (world::CasterId id = 0; id < table_.slots(); ++id) {
        if (table_[id].state == world::CasterState::kFree) continue;
        if (auto done = uploadLevels(side->light, id); !done) return done.error();
        bool differs = false;
        for (size_t c = 0; c < from.size(); ++c)
            differs |= from[c] >= 0 && (old.light.level(id, from[c]) != side->light.level(id, int(c)) ||
                                        old.light.drawn(id, from[c]) != side->light.drawn(id, int(c)));
        if (!differs) continue;
        if (table_[id].state == world::CasterState::kActive) {
            side->activeDirt.push_back(old.light[id].bounds);
            side->activeDirt.push_back(side->light[id].bounds);
            continue;
        }
        side->departures.push_back({old.light[id].bounds, cache::Cause::kLevel});
        const bool arrives = std::any_of(arrivals_.begin(), arrivals_.end(),
                                         [id](const cache::Arrival& a) { return a.caster == id; });
        if (!arrives) arrivals.push_back({id, cache::Cause::kLevel});
    }
    return Refit{std::move(side), std::move(arrivals), config};
}

void ResidentScene::apply(Refit refit) {
    sides_.front() = std::move(refit.side);
    arrivals_ = std::move(refit.arrivals);
    config_ = refit.config;
    occlusionStarted_ = false;
    outlook_.forget();
}

void ResidentScene::showNext() {
    CHECK(sides_.size() == 2 && sides_.back()->whole);
    sides_.erase(sides_.begin());
}

void ResidentScene::dropNext() {
    CHECK(sides_.size() == 2);
    sides_.pop_back();
}

cache::Scene ResidentScene::view(size_t side, bool hide) const {
    return {table_, sides_[side]->light, statics_, sets_.active(), hide ? sides_[side]->occlusion.get() : nullptr};
}

void ResidentScene::settle() {
    arrivals_.clear();
    worldDepartures_.clear();
    worldDirt_.clear();
    for (auto& side : sides_) {
        side->departures.clear();
        side->activeDirt.clear();
    }
}

void ResidentScene::placeStatic(world::CasterId caster) {
    for (auto& side : sides_) side->light.addStatic(caster, table_);
}

void ResidentScene::placeActive(world::CasterId caster) {
    for (auto& side : sides_) side->light.addActive(caster, table_);
}

void ResidentScene::dirtyActive(world::CasterId caster) {
    for (auto& side : sides_) side->activeDirt.push_back(side->light[caster].bounds);
    worldDirt_.push_back(table_[caster].bounds);
}

void ResidentScene::depart(world::CasterId caster, cache::Cause cause) {
    for (auto& side : sides_) side->departures.push_back({side->light[caster].bounds, cause});
    worldDepartures_.push_back({table_[caster].bounds, cause});
}

/// All that is known of it goes, last of all.
void ResidentScene::removeCaster(world::CasterId caster) {
    for (auto& side : sides_) side->light.remove(caster);
    table_.remove(caster);
}

size_t ResidentScene::revoke(std::span<const world::CasterId> casters) {
    size_t revoked = 0;
    for (auto& side : sides_)
        if (side->occlusion) revoked += side->occlusion->remove(casters);
    return revoked;
}

world::Result<cache::GeometryId> ResidentScene::uploadLevel(world::CasterId caster, size_t level) {
    world::MeshEntry& entry = table_.mesh(table_[caster].mesh);
    if (entry.geometry[level] != world::kNoGeometry) return entry.geometry[level];
    auto id = maps_.upload(entry.mesh->levels[level]);
    if (!id) return id.error();
    entry.geometry[level] = id.value();
    if (uploaded_.size() <= id.value()) uploaded_.resize(id.value() + size_t{1});
    uploaded_[id.value()] = &entry.mesh->levels[level];
    return id;
}

/// Levels follow from texels and scale: the same for every sun.
world::Result<world::Done> ResidentScene::uploadLevels(const culling::LightCasters& light, world::CasterId caster) {
    for (size_t c = 0; c < light.cascades().size(); ++c)
        if (auto id = uploadLevel(caster, static_cast<size_t>(light.level(caster, int(c)))); !id) return id.error();
    return world::Done{};
}

world::Result<world::CasterId> ResidentScene::addStatic(world::MeshSlot mesh, const world::Placement& placement,
                                                        world::CasterOrigin origin) {
    const world::CasterId id = table_.add(mesh, placement, world::CasterState::kStatic, origin);
    placeStatic(id);
    if (auto done = uploadLevels(shown().light, id); !done) {
        removeCaster(id);
        return done.error();
    }
    statics_.insert(id, table_[id].bounds);
    arrivals_.push_back({id, cache::Cause::kArrival});
    return id;
}

world::Result<ObjectId> ResidentScene::adopt(const std::string& name) {
    if (!names_) {
        auto names = store_.names();
        if (!names) return names.error();
        names_ = std::move(names.value());
    }
    const auto named = std::lower_bound(names_->begin(), names_->end(), name,
                                        [](const world::NamedInstance& n, const std::string& s) { return n.name < s; });
    if (named == names_->end() || named->name != name)
        return world::Error{world::ErrorCode::kNotFound,
                            store_.path() + ": no caster is named \"" + name + "\"; names come from the source's nodes"};
    const std::pair<world::ChunkKey, uint32_t> place{named->chunk, named->slot};
    if (const auto known = adopted_.find(place); known != adopted_.end()) {
        if (auto object = living(known->second); !object) return object.error();
        return known->second;
    }
    const world::CasterOrigin origin{named->chunk, static_cast<int32_t>(named->slot), int64_t(nextObject_)};

    auto chunk = store_.readChunk(named->chunk);
    if (!chunk) return chunk.error();
    if (named->slot >= chunk.value().instances.size())
        return world::Error{world::ErrorCode::kBadData, store_.path() + ": name \"" + name + "\" is beyond chunk " +
                                                            world::toString(named->chunk) + "; bake the world again"};
    const world::Instance& instance = chunk.value().instances[named->slot];
    const auto slot = pinnedMesh(instance.mesh);
    if (!slot) return slot.error();
    Object object{.rest = instance.placement};
    bool taken = false;
    if (const auto resident = chunks_.find(named->chunk); resident != chunks_.end()) {
        auto& casters = resident->second.casters;
        const auto at = std::find_if(casters.begin(), casters.end(), [&](world::CasterId c) {
            return table_[c].origin.slot == static_cast<int32_t>(named->slot);
        });
        if (at != casters.end()) {  // it stands there already: it only changes owner
            object.caster = *at;
            casters.erase(at);
            taken = true;
        }
    }
    if (!taken) {
        auto caster = addStatic(slot.value(), instance.placement, origin);
        if (!caster) return caster.error();
        object.caster = caster.value();
    }
    objects_.emplace(nextObject_, object);
    adopted_.emplace(place, nextObject_);
    return nextObject_++;
}

world::Result<world::MeshSlot> ResidentScene::pinnedMesh(uint32_t mesh) {
    if (auto pinned = streamer_.pin(mesh); !pinned) return pinned.error();
    auto slot = meshSlots_.find(mesh);
    if (slot == meshSlots_.end()) slot = meshSlots_.emplace(mesh, table_.addMesh(streamer_.mesh(mesh))).first;
    return slot->second;
}

world::Result<const ResidentScene::Object*> ResidentScene::living(ObjectId object) const {
    if (const auto at = objects_.find(object); at != objects_.end()) return &at->second;
    return world::Error{world::ErrorCode::kNotFound,
                        "object " + std::to_string(object) +
                            (object < nextObject_ ? ": it was removed; spawn another"
                                                  : ": there is none of that number; adopt or spawn it first")};
}

world::Result<world::Done> ResidentScene::requirePlaceable(const std::string& who, const world::Mesh& mesh,
                                                           const world::Placement& placement, float margin) const {
    if (!finite(placement))
        return world::Error{world::ErrorCode::kUsage, who + ": its placement is not finite; give numbers"};
    const world::Box bounds = world::grown(world::placedBounds(mesh, placement), double(margin));
    if (glm::any(glm::greaterThan(glm::max(glm::abs(bounds.min), glm::abs(bounds.max)), glm::dvec3(kFarthest))))
        return world::Error{world::ErrorCode::kLimit,
                            who + ": it would reach farther than 1e8 m from the origin; scale or move it"};
    return world::Done{};
}

world::Result<world::Done> ResidentScene::requireTraits(const std::string& who, const ObjectTraits& traits) {
    if (!std::isfinite(traits.margin) || traits.margin < 0)
        return world::Error{world::ErrorCode::kUsage, who + ": its margin is not a length; give 0 m or more"};
    if (traits.deforms && traits.atRest)
        return world::Error{world::ErrorCode::kUsage, who + ": what deforms is never at rest; give one of the two"};
    return world::Done{};
}

world::Result<ObjectId> ResidentScene::spawn(uint32_t mesh, const world::Placement& placement,
                                             const ObjectTraits& traits) {
    const std::string who = "spawn of mesh " + std::to_string(mesh);
    if (mesh >= store_.meshes().size())
        return world::Error{world::ErrorCode::kNotFound, who + ": the world has " +
                                                             std::to_string(store_.meshes().size()) + " meshes"};
    if (auto good = requireTraits(who, traits); !good) return good.error();
    const auto slot = pinnedMesh(mesh);
    if (!slot) return slot.error();
    if (auto fits = requirePlaceable(who, *table_.mesh(slot.value()).mesh, placement, traits.margin); !fits)
        return fits.error();
    Object object{.rest = placement, .deforms = traits.deforms};
    const world::CasterOrigin origin{{}, -1, int64_t(nextObject_)};
    if (traits.atRest) {
        auto caster = addStatic(slot.value(), placement, origin);
        if (!caster) return caster.error();
        object.caster = caster.value();
    } else {
        object.caster = table_.add(slot.value(), placement, world::CasterState::kActive, origin, traits.margin);
        placeActive(object.caster);
        if (auto done = uploadLevels(shown().light, object.caster); !done) {
            removeCaster(object.caster);
            return done.error();
        }
        dirtyActive(object.caster);
        if (traits.deforms) sets_.keepActive(object.caster);
        else spawned_.push_back(object.caster);
    }
    objects_.emplace(nextObject_, object);
    return nextObject_++;
}

world::Result<world::Done> ResidentScene::mark(ObjectId number, const ObjectTraits& traits) {
    if (auto object = living(number); !object) return object.error();
    Object& object = objects_.at(number);
    const world::CasterId id = object.caster;
    const std::string who = "object " + std::to_string(number);
    const float margin = traits.atRest ? 0 : traits.margin;
    if (auto good = requireTraits(who, traits); !good) return good.error();
    if (auto fits = requirePlaceable(who, table_.meshOf(id), table_[id].placement, margin); !fits) return fits.error();
    const bool rests = table_[id].state == world::CasterState::kStatic;
    object.deforms = traits.deforms;
    if (rests && !traits.deforms && table_[id].margin == margin) return world::Done{};
    if (rests) {
        leaveStatics(id, cache::Cause::kDemotion);
        table_.setState(id, world::CasterState::kActive);
    } else {
        dirtyActive(id);
        sets_.forget(id);
        std::erase(spawned_, id);
    }
    table_.setMargin(id, margin);
    if (traits.atRest) {
        settleAsStatic(id);
        return world::Done{};
    }
    placeActive(id);
    dirtyActive(id);
    if (traits.deforms) sets_.keepActive(id);
    else spawned_.push_back(id);
    return uploadLevels(shown().light, id);
}

void ResidentScene::leaveStatics(world::CasterId id, cache::Cause cause) {
    revocations_ += revoke(std::span(&id, 1));
    statics_.remove(id);
    const auto unseen = std::find_if(arrivals_.begin(), arrivals_.end(),
                                     [&](const cache::Arrival& a) { return a.caster == id; });
    if (unseen != arrivals_.end()) arrivals_.erase(unseen);
    else depart(id, cause);
}

world::Result<world::Done> ResidentScene::remove(ObjectId number) {
    const auto object = living(number);
    if (!object) return object.error();
    const world::CasterId caster = object.value()->caster;
    if (table_[caster].state == world::CasterState::kStatic) {
        leaveStatics(caster, cache::Cause::kDeparture);
    } else {
        dirtyActive(caster);
        sets_.forget(caster);
        std::erase(spawned_, caster);
    }
    removeCaster(caster);
    objects_.erase(number);
    return world::Done{};
}

world::Result<world::Done> ResidentScene::requireMove(const ObjectUpdate& update) const {
    const auto found = living(update.object);
    if (!found) return found.error();
    const world::CasterId id = found.value()->caster;
    return requirePlaceable("object " + std::to_string(update.object), table_.meshOf(id), update.placement, table_[id].margin);
}

void ResidentScene::moveObjects(double time, std::span<const ObjectUpdate> updates, SceneChanges& changes) {
    for (const ObjectUpdate& update : updates) {
        if (const auto can = requireMove(update); !can) {
            changes.errors.push_back(can.error());
            continue;
        }
        const Object& object = *living(update.object).value();
        const world::CasterId id = object.caster;
        if (table_[id].placement == update.placement && !object.deforms) continue;
        if (table_[id].state == world::CasterState::kStatic) {
            leaveStatics(id, cache::Cause::kDemotion);
            table_.setState(id, world::CasterState::kActive);
        } else {
            dirtyActive(id);
        }
        const world::Placement before = table_[id].placement;
        table_.place(id, update.placement);
        placeActive(id);
        dirtyActive(id);
        if (!object.deforms) sets_.moved(id, time);
        if (auto done = uploadLevels(shown().light, id); !done) {  // it stays where its levels are uploaded already
            changes.errors.push_back(done.error());
            table_.place(id, before);
            placeActive(id);
        }
    }
}

void ResidentScene::promote(double time) {
    for (world::CasterId id : sets_.promote(time)) {
        dirtyActive(id);
        settleAsStatic(id);
    }
}

void ResidentScene::settleAsStatic(world::CasterId id) {
    table_.setState(id, world::CasterState::kStatic);
    placeStatic(id);
    statics_.insert(id, table_[id].bounds);
    arrivals_.push_back({id, cache::Cause::kPromotion});
}

void ResidentScene::startOcclusion() {
    occlusionStarted_ = true;
    SunSide& side = *sides_.front();
    const world::Box extent = side.light.space().toLight(store_.header().bounds);
    const culling::SearchConfig search{config_.raysPerCluster, std::max(1.0, extent.extent().z), config_.side};
    side.occlusion = std::make_unique<culling::Occlusion>(
        table_, side.light, culling::OcclusionConfig{search, config_.stickyCertificates});
}

/// Static casters over a square that are new to it: over the strips that its move exposed, or just arrived. All
/// others were there when it was last looked at.
///   from, to  centres, then and now; light-space x, y [m]
///   reach     half of its edge [m]
///   casters   replaced; ascending
void ResidentScene::newcomers(const culling::LightCasters& light, glm::dvec2 from, glm::dvec2 to, double reach,
                              std::vector<world::CasterId>& casters) const {
    casters.clear();
    const glm::dvec2 low = to - reach, high = to + reach;
    std::vector<world::CasterId> over;
    for (int axis = 0; axis < 2; ++axis) {
        glm::dvec2 min = low, max = high;
        if (to[axis] > from[axis]) min[axis] = std::max(low[axis], from[axis] + reach);
        else max[axis] = std::min(high[axis], from[axis] - reach);
        if (to[axis] == from[axis]) continue;
        culling::castersOver(statics_, light, min, max, over);
        casters.insert(casters.end(), over.begin(), over.end());
    }
    for (const cache::Arrival& a : arrivals_) {
        const world::Box& b = light[a.caster].bounds;  // of a static caster: what left is no arrival any more
        if (b.min.x <= high.x && b.max.x >= low.x && b.min.y <= high.y && b.max.y >= low.y) casters.push_back(a.caster);
    }
    std::sort(casters.begin(), casters.end());
    casters.erase(std::unique(casters.begin(), casters.end()), casters.end());
}

void ResidentScene::occlude(SunSide& side, std::span<const Eye> eyes, SceneChanges& changes) {
    // A cascade's rays are spent where a window is or soon will be: the finest cascade covers a
    // thousandth of the coarsest one's ground and would cost most of the rays.
    const auto& cascades = side.light.cascades();
    side.certifiedAt.resize(eyes.size() * cascades.size());
    std::vector<world::CasterId> near;
    for (size_t n = 0; n < side.certifiedAt.size(); ++n) {
        const size_t c = n % cascades.size();
        const glm::dvec2 at(side.light.space().toLight(eyes[n / cascades.size()].position));
        std::optional<glm::dvec2>& before = side.certifiedAt[n];
        const double slack = kSlack * cascades[c].split;
        if (before && arrivals_.empty() && glm::length(at - *before) <= slack / 2) continue;
        const double reach = cascades[c].texel * (config_.side / 2.0 + config_.guardBand) + slack;
        if (before) newcomers(side.light, *before, at, reach, near);
        else culling::castersOver(statics_, side.light, at - reach, at + reach, near);
        before = at;
        side.occlusion->await(int(c), near);
    }
    const culling::CertifyCosts costs = side.occlusion->search(statics_, allowance_.rays());
    allowance_.spent(costs);
    changes.certify += costs;
}

world::Result<SceneChanges> ResidentScene::advance(double time, std::span<const Eye> eyes,
                                                   std::span<const ObjectUpdate> updates) {
    SceneChanges changes;
    for (world::CasterId id : spawned_) sets_.moved(id, time);
    spawned_.clear();
    if (config_.occlusion && !occlusionStarted_) startOcclusion();
    const Stopwatch sets;
    moveObjects(time, updates, changes);
    promote(time);
    changes.setsMs = sets.ms();

    const Stopwatch streaming;
    if (auto done = stream(time, eyes, changes); !done) {
        for (auto& side : sides_) side->certifiedAt.clear();  // arrivals go unseen: look at all again
        return done.error();
    }
    changes.streamMs = streaming.ms();

    const Stopwatch occlusion;
    std::sort(arrivals_.begin(), arrivals_.end(),
              [](const cache::Arrival& a, const cache::Arrival& b) { return a.caster < b.caster; });
    for (auto& side : sides_)
        if (side->occlusion) occlude(*side, eyes, changes);
    changes.revocations += std::exchange(revocations_, 0);
    changes.occlusionMs = occlusion.ms();
    return changes;
}

}  // namespace server
