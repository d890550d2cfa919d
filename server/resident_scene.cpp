#include "server/resident_scene.h"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "culling/caster_query.h"

namespace server {

namespace {

/// Chunks are wanted this share of the far distance beyond what the windows need, and kept twice as
/// far; wants are looked at again when the eye has used up half of the room.
constexpr double kSlack = 0.25;

/// The octree splits no further than cells of this edge [m]: smaller ones hold single props.
constexpr double kSmallestCell = 8;

class Stopwatch {
public:
    double ms() const {
        return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start_).count();
    }

private:
    std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

bool finite(const world::Placement& p) {
    for (int c = 0; c < 3; ++c)
        for (int r = 0; r < 3; ++r)
            if (!std::isfinite(p.linear[c][r])) return false;
    return std::isfinite(p.translation.x) && std::isfinite(p.translation.y) && std::isfinite(p.translation.z);
}

}  // namespace

ResidentScene::ResidentScene(const world::WorldStore& store, gpu::ShadowMaps& maps, const culling::LightSpace& space,
                             std::vector<culling::Cascade> cascades, const SceneConfig& config)
    : store_(store),
      maps_(maps),
      config_(config),
      streamer_(store, config.residentBytes),
      light_(space, std::move(cascades)),
      statics_(store.header().bounds, kSmallestCell),
      sets_(config.restSeconds, config.promotionsPerFrame) {}

cache::Scene ResidentScene::view(bool hide) const {
    return {table_, light_, statics_, sets_.active(), hide ? occlusion_.get() : nullptr};
}

world::Result<world::Done> ResidentScene::uploadLevels(world::CasterId caster) {
    world::MeshEntry& entry = table_.mesh(table_[caster].mesh);
    for (size_t c = 0; c < light_.cascades().size(); ++c) {
        const auto level = static_cast<size_t>(light_.level(caster, int(c)));
        if (entry.geometry[level] != world::kNoGeometry) continue;
        auto id = maps_.upload(entry.mesh->levels[level]);
        if (!id) return id.error();
        entry.geometry[level] = id.value();
    }
    return world::Done{};
}

void ResidentScene::removeMesh(world::MeshSlot slot) {
    for (uint32_t id : table_.mesh(slot).geometry)
        if (id != world::kNoGeometry) maps_.release(id);
    if (occlusion_) occlusion_->forgetMesh(slot);
    table_.removeMesh(slot);
}

world::Result<world::CasterId> ResidentScene::addStatic(world::MeshSlot mesh, const world::Placement& placement,
                                                        world::CasterOrigin origin, SceneChanges& changes) {
    const world::CasterId id = table_.add(mesh, placement, world::CasterState::kStatic, origin);
    light_.addStatic(id, table_);
    statics_.insert(id, table_[id].bounds);
    if (auto done = uploadLevels(id); !done) return done.error();
    changes.arrivals.push_back({id, cache::Cause::kArrival});
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
    if (const auto known = adopted_.find(place); known != adopted_.end()) return known->second;
    const auto id = static_cast<ObjectId>(objects_.size());
    const world::CasterOrigin origin{named->chunk, static_cast<int32_t>(named->slot), static_cast<int32_t>(id)};

    auto chunk = store_.readChunk(named->chunk);
    if (!chunk) return chunk.error();
    if (named->slot >= chunk.value().instances.size())
        return world::Error{world::ErrorCode::kBadData, store_.path() + ": name \"" + name + "\" is beyond chunk " +
                                                            world::toString(named->chunk) + "; bake the world again"};
    const world::Instance& instance = chunk.value().instances[named->slot];
    if (auto pinned = streamer_.pin(instance.mesh); !pinned) return pinned.error();
    auto slot = meshSlots_.find(instance.mesh);
    if (slot == meshSlots_.end())
        slot = meshSlots_.emplace(instance.mesh, table_.addMesh(streamer_.mesh(instance.mesh))).first;

    Object object{0, instance.placement};
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
        SceneChanges changes;
        auto caster = addStatic(slot->second, instance.placement, origin, changes);
        if (!caster) return caster.error();
        object.caster = caster.value();
        waiting_.insert(waiting_.end(), changes.arrivals.begin(), changes.arrivals.end());
    }
    objects_.push_back(object);
    adopted_.emplace(place, id);
    return id;
}

void ResidentScene::moveObjects(double time, std::span<const ObjectUpdate> updates, SceneChanges& changes) {
    for (const ObjectUpdate& update : updates) {
        const auto refuse = [&](const char* why) {
            changes.errors.push_back({world::ErrorCode::kUsage, "object " + std::to_string(update.object) + ": " + why});
        };
        if (update.object >= objects_.size()) {
            refuse("not adopted; adopt it by name first");
            continue;
        }
        if (!finite(update.placement)) {
            refuse("its placement is not finite; it stays where it was");
            continue;
        }
        const world::CasterId id = objects_[update.object].caster;
        if (table_[id].placement == update.placement) continue;
        if (table_[id].state == world::CasterState::kStatic) {
            if (occlusion_) changes.revocations += occlusion_->remove(std::span(&id, 1));
            statics_.remove(id);
            const auto unseen = std::find_if(waiting_.begin(), waiting_.end(),
                                             [&](const cache::Arrival& a) { return a.caster == id; });
            if (unseen != waiting_.end()) waiting_.erase(unseen);  // moved before any map showed it
            else changes.departures.push_back({light_[id].bounds, cache::Cause::kDemotion});
            table_.setState(id, world::CasterState::kActive);
        } else {
            changes.activeDirt.push_back(light_[id].bounds);
        }
        table_.place(id, update.placement);
        light_.addActive(id, table_);
        changes.activeDirt.push_back(light_[id].bounds);
        sets_.moved(id, time);
        if (auto done = uploadLevels(id); !done) changes.errors.push_back(done.error());
    }
}

world::Result<world::Done> ResidentScene::promote(double time, SceneChanges& changes) {
    for (world::CasterId id : sets_.promote(time)) {
        changes.activeDirt.push_back(light_[id].bounds);
        table_.setState(id, world::CasterState::kStatic);
        light_.addStatic(id, table_);
        statics_.insert(id, table_[id].bounds);
        changes.arrivals.push_back({id, cache::Cause::kPromotion});
    }
    return world::Done{};
}

void ResidentScene::dropChunk(world::ChunkKey key, SceneChanges& changes) {
    const auto at = chunks_.find(key);
    CHECK(at != chunks_.end());
    ResidentChunk& chunk = at->second;
    if (occlusion_) changes.revocations += occlusion_->remove(chunk.casters);
    for (world::CasterId id : chunk.casters) {
        changes.departures.push_back({light_[id].bounds, cache::Cause::kDeparture});
        statics_.remove(id);
        table_.remove(id);
    }
    if (chunk.terrain) removeMesh(*chunk.terrain);
    chunks_.erase(at);
    ++changes.chunkDepartures;
}

world::Result<world::Done> ResidentScene::addChunk(std::shared_ptr<const world::Chunk> chunk, SceneChanges& changes) {
    ResidentChunk& resident = chunks_[chunk->key];
    resident.chunk = chunk;
    const auto keep = [&](world::Result<world::CasterId> id) -> world::Result<world::Done> {
        if (!id) return id.error();
        resident.casters.push_back(id.value());
        return world::Done{};
    };
    if (!chunk->terrain.levels.empty()) {
        resident.terrain = table_.addMesh(chunk->terrain);
        world::Placement placement;
        placement.translation = glm::dvec3(chunk->key.x, 0, chunk->key.z) * store_.header().chunkSize;
        if (auto done = keep(addStatic(*resident.terrain, placement, {chunk->key, -1, -1}, changes)); !done)
            return done.error();
    }
    for (uint32_t slot = 0; slot < chunk->instances.size(); ++slot) {
        if (adopted_.contains({chunk->key, slot})) continue;
        const world::Instance& instance = chunk->instances[slot];
        auto done = keep(addStatic(meshSlots_.at(instance.mesh), instance.placement,
                                   {chunk->key, static_cast<int32_t>(slot), -1}, changes));
        if (!done) return done.error();
    }
    ++changes.chunkArrivals;
    return world::Done{};
}

world::Result<world::Done> ResidentScene::stream(glm::dvec3 eye, SceneChanges& changes) {
    const double slack = kSlack * config_.farDistance;
    if (streamedAt_ && glm::length(eye - *streamedAt_) <= slack / 2) return world::Done{};
    // What may cast onto receivers near the eye: everything in their column of light, toward the sun
    // without end, away from it as far as receivers can be.
    const auto within = [&](const world::Box& bounds, double reach) {
        const world::Box b = light_.space().toLight(bounds);
        return b.min.x <= eye.x + reach && b.max.x >= eye.x - reach && b.min.y <= eye.y + reach &&
               b.max.y >= eye.y - reach && b.min.z <= eye.z + reach;
    };
    const double windows = config_.farDistance * config_.side / (config_.side - 2.0 * culling::kWindowMargin);
    auto events = streamer_.advance([&](const world::Box& b) { return within(b, windows + slack); },
                                    [&](const world::Box& b) { return within(b, windows + 2 * slack); });
    if (!events) return events.error();
    streamedAt_ = eye;
    world::StreamEvents& e = events.value();
    changes.bytesRead += e.bytesRead;
    changes.errors.insert(changes.errors.end(), e.errors.begin(), e.errors.end());
    for (world::ChunkKey key : e.departures) dropChunk(key, changes);
    for (uint32_t id : e.meshDepartures) {
        removeMesh(meshSlots_.at(id));
        meshSlots_.erase(id);
    }
    for (uint32_t id : e.meshArrivals) meshSlots_.emplace(id, table_.addMesh(streamer_.mesh(id)));
    for (auto& chunk : e.arrivals)
        if (auto done = addChunk(chunk, changes); !done) return done.error();
    return world::Done{};
}

void ResidentScene::occlude(glm::dvec3 eye, SceneChanges& changes) {
    // A cascade's rays are spent where its window is or soon will be: the finest cascade covers a
    // thousandth of the coarsest one's ground and would cost most of the rays.
    const auto& cascades = light_.cascades();
    const bool first = certifiedAt_.empty();
    certifiedAt_.resize(cascades.size());
    std::vector<world::CasterId> near;
    for (size_t c = 0; c < cascades.size(); ++c) {
        const double slack = kSlack * cascades[c].split;
        const glm::dvec2 at(eye);
        if (!first && changes.arrivals.empty() && glm::length(at - certifiedAt_[c]) <= slack / 2) continue;
        certifiedAt_[c] = at;
        const double reach = cascades[c].texel * config_.side / 2 + slack;
        culling::castersOver(statics_, light_, at - reach, at + reach, near);
        changes.certify += occlusion_->admit(int(c), near);
    }
}

world::Result<SceneChanges> ResidentScene::advance(double time, glm::dvec3 eye,
                                                   std::span<const ObjectUpdate> updates) {
    SceneChanges changes;
    if (config_.occlusion && !occlusion_) {
        auto occlusion = culling::Occlusion::create(
            table_, light_,
            {config_.raysPerCluster, config_.depthRange, eye, config_.side, config_.stickyCertificates});
        if (!occlusion) return occlusion.error();
        occlusion_ = std::move(occlusion.value());
    }
    const Stopwatch sets;
    moveObjects(time, updates, changes);
    if (auto done = promote(time, changes); !done) return done.error();
    changes.setsMs = sets.ms();

    const Stopwatch streaming;
    if (auto done = stream(eye, changes); !done) return done.error();
    changes.streamMs = streaming.ms();

    const Stopwatch occlusion;
    changes.arrivals.insert(changes.arrivals.end(), waiting_.begin(), waiting_.end());
    waiting_.clear();
    std::sort(changes.arrivals.begin(), changes.arrivals.end(),
              [](const cache::Arrival& a, const cache::Arrival& b) { return a.caster < b.caster; });
    if (occlusion_) occlude(eye, changes);
    changes.occlusionMs = occlusion.ms();
    return changes;
}

}  // namespace server
