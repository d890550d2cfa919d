// server/scene_streaming.cpp — the part of ResidentScene that takes up what the streamer brings.

#include <algorithm>

#include "server/resident_scene.h"

namespace server {

void ResidentScene::removeMesh(world::MeshSlot slot) {
    for (uint32_t id : table_.mesh(slot).geometry)
        if (id != world::kNoGeometry) {
            maps_.release(id);
            uploaded_[id] = nullptr;
        }
    table_.removeMesh(slot);
}

void ResidentScene::dropChunk(world::ChunkKey key) {
    const auto at = chunks_.find(key);
    CHECK(at != chunks_.end());
    const ResidentChunk& chunk = at->second;
    for (world::CasterId id : chunk.casters) {
        leaveStatics(id, cache::Cause::kDeparture);
        removeCaster(id);
    }
    if (chunk.terrain) removeMesh(*chunk.terrain);
    chunks_.erase(at);
}

/// After an error nothing of the chunk is there.
world::Result<world::Done> ResidentScene::addChunk(std::shared_ptr<const world::Chunk> chunk) {
    ResidentChunk& resident = chunks_[chunk->key];
    resident.chunk = chunk;
    const auto keep = [&](const world::Result<world::CasterId>& id) -> world::Result<world::Done> {
        if (id) {
            resident.casters.push_back(id.value());
            return world::Done{};
        }
        dropChunk(chunk->key);
        return id.error();
    };
    const auto edited = edited_.find(chunk->key);
    const world::Mesh& terrain = edited != edited_.end() ? edited->second->terrain : chunk->terrain;
    if (!terrain.levels.empty()) {
        resident.terrain = table_.addMesh(terrain);
        if (auto done = keep(addStatic(*resident.terrain, terrainPlacement(chunk->key), {chunk->key, -1, -1})); !done)
            return done;
    }
    for (uint32_t slot = 0; slot < chunk->instances.size(); ++slot) {
        if (adopted_.contains({chunk->key, slot})) continue;
        const world::Instance& instance = chunk->instances[slot];
        auto done = keep(addStatic(meshSlots_.at(instance.mesh), instance.placement,
                                   {chunk->key, static_cast<int32_t>(slot), -1}));
        if (!done) return done;
    }
    return world::Done{};
}

/// What both meshes have, counted from the coarsest level, changes hands on the GPU.
void ResidentScene::moveLevels(world::MeshSlot from, world::MeshSlot to) {
    world::MeshEntry &source = table_.mesh(from), &target = table_.mesh(to);
    const size_t sources = source.geometry.size(), targets = target.geometry.size();
    for (size_t back = 1; back <= std::min(sources, targets); ++back) {
        const uint32_t id = std::exchange(source.geometry[sources - back], world::kNoGeometry);
        target.geometry[targets - back] = id;
        if (id != world::kNoGeometry) uploaded_[id] = &target.mesh->levels[targets - back];
    }
}

/// The chunk's terrain is there in other levels. Where a cascade draws another one than before, the old one departs
/// and the new one arrives; elsewhere nothing happened. After an error all is as before.
world::Result<world::Done> ResidentScene::refineChunk(std::shared_ptr<const world::Chunk> chunk) {
    ResidentChunk& resident = chunks_.at(chunk->key);
    if (edited_.contains(chunk->key)) {  // its terrain is there already, in all levels
        resident.chunk = std::move(chunk);
        return world::Done{};
    }
    if (!resident.terrain || chunk->terrain.levels.empty()) {  // the file was edited by somebody else meanwhile
        dropChunk(chunk->key);
        return addChunk(std::move(chunk));
    }
    const world::MeshSlot before = *resident.terrain, after = table_.addMesh(chunk->terrain);
    const world::CasterId id = resident.casters.front();
    const culling::LightCasters& light = shown().light;
    const auto drawn = [&](world::MeshSlot slot, size_t c) {  // counted from the coarsest level
        return table_.mesh(slot).geometry.size() - static_cast<size_t>(light.level(id, int(c)));
    };
    std::vector<size_t> levels;
    for (size_t c = 0; c < light.cascades().size(); ++c) levels.push_back(drawn(before, c));
    std::vector<world::Box> bounds;  // per side
    for (const auto& side : sides_) bounds.push_back(side->light[id].bounds);
    const world::Box worldBounds = table_[id].bounds;

    moveLevels(before, after);
    table_.setMesh(id, after);
    placeStatic(id);
    if (auto done = uploadLevels(light, id); !done) {
        table_.setMesh(id, before);
        placeStatic(id);
        moveLevels(after, before);
        removeMesh(after);
        return done;
    }
    revocations_ += revoke(std::span(&id, 1));
    statics_.remove(id);
    statics_.insert(id, table_[id].bounds);
    uint32_t changed = 0;
    for (size_t c = 0; c < levels.size(); ++c)
        if (drawn(after, c) != levels[c]) changed |= 1u << c;
    const auto unseen = std::find_if(arrivals_.begin(), arrivals_.end(),
                                     [id](const cache::Arrival& a) { return a.caster == id; });
    if (unseen == arrivals_.end()) {
        for (size_t s = 0; s < sides_.size(); ++s)
            sides_[s]->departures.push_back({bounds[s], cache::Cause::kLevel, changed});
        worldDepartures_.push_back({worldBounds, cache::Cause::kLevel});
        arrivals_.push_back({id, cache::Cause::kLevel, changed});
    }
    removeMesh(before);
    resident.terrain = after;
    resident.chunk = std::move(chunk);
    return world::Done{};
}

world::Result<world::Done> ResidentScene::stream(double time, std::span<const Eye> eyes, SceneChanges& changes) {
    if (outlook_.observe(time, eyes, config_.farDistance)) {
        std::vector<const culling::LightSpace*> suns;
        for (const auto& side : sides_) suns.push_back(&side->light.space());
        const Outlook::Maps maps{shown().light.cascades(), config_.side, config_.guardBand, config_.detail.levelError};
        streamer_.want(outlook_.wants(suns, maps, config_.farDistance, eyes), time);
    }
    world::StreamEvents e = streamer_.advance(time);
    changes.reads = std::move(e.reads);
    changes.bytesRead += e.bytesRead;
    changes.bytesAgain += e.bytesAgain;
    changes.errors.insert(changes.errors.end(), e.errors.begin(), e.errors.end());
    for (world::ChunkKey key : e.departures) dropChunk(key);
    changes.chunkDepartures += static_cast<uint32_t>(e.departures.size());
    for (uint32_t id : e.meshDepartures) {
        removeMesh(meshSlots_.at(id));
        meshSlots_.erase(id);
    }
    for (uint32_t id : e.meshArrivals) meshSlots_.emplace(id, table_.addMesh(streamer_.mesh(id)));
    for (const auto& chunk : e.arrivals) {
        const auto known = chunks_.find(chunk->key);
        const std::shared_ptr<const world::Chunk> held = known == chunks_.end() ? nullptr : known->second.chunk;
        if (auto done = held ? refineChunk(chunk) : addChunk(chunk); !done) {
            if (done.error().code != world::ErrorCode::kLimit) return done;
            streamer_.refuse(chunk->key, held, time);  // it is lacking, and tried again when there is room
            continue;
        }
        ++(held ? changes.refinements : changes.chunkArrivals);
    }
    return world::Done{};
}

}  // namespace server
