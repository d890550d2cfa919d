// server/scene_edits.cpp — the part of ResidentScene that takes up edits of the terrain.

#include "server/resident_scene.h"

namespace server {

world::Placement ResidentScene::terrainPlacement(world::ChunkKey key) const {
    return {glm::mat3(1), glm::dvec3(key.x, 0, key.z) * store_.header().chunkSize};
}

/// Elsewhere the two have the same triangles, bit for bit: what the maps hold stays true, and so does what certificates
/// of the old one hid, until they fall.
///   firstLevel  the level of the whole terrain that `before` begins with
void ResidentScene::departWhereChanged(world::CasterId before, size_t firstLevel, world::CasterId after,
                                       const world::EditedChunk& chunk) {
    for (auto& side : sides_) {
        const culling::LightCasters& light = side->light;
        for (size_t c = 0; c < light.cascades().size(); ++c) {
            const int cascade = int(c), level = light.level(after, cascade);
            world::Box box = light[before].bounds;
            box.add(light[after].bounds);
            if (light.level(before, cascade) + int(firstLevel) == level &&
                light.drawn(before, cascade) == light.drawn(after, cascade))
                box = world::transformed(chunk.changes[size_t(level)], light[after].lightFromMesh, light[after].origin);
            if (!box.empty()) side->departures.push_back({box, cache::Cause::kEdit, 1u << c});
        }
    }
    // What level a spot light draws follows from bounds and errors, which an edit may change anywhere.
    world::Box whole = table_[before].bounds;
    whole.add(table_[after].bounds);
    worldDepartures_.push_back({whole, cache::Cause::kEdit});
}

/// Puts the terrain caster of a chunk in the place of another.
world::Result<world::Done> ResidentScene::swapTerrain(ResidentChunk& chunk, world::CasterId& caster,
                                                      const world::EditedChunk& edited) {
    const world::ChunkKey key = edited.record.key;
    const world::CasterId before = caster;
    const size_t firstLevel = edited_.contains(key) ? 0 : chunk.chunk->firstLevel;
    const world::MeshSlot slot = table_.addMesh(edited.terrain);
    const world::CasterId after = table_.add(slot, terrainPlacement(key), world::CasterState::kStatic, {key, -1, -1});
    placeStatic(after);
    if (auto done = uploadLevels(shown().light, after); !done) {
        removeCaster(after);
        removeMesh(slot);
        return done.error();
    }
    departWhereChanged(before, firstLevel, after, edited);
    revocations_ += revoke(std::span(&before, 1));
    statics_.remove(before);
    removeCaster(before);
    removeMesh(*chunk.terrain);
    statics_.insert(after, table_[after].bounds);
    caster = after;
    chunk.terrain = slot;
    return world::Done{};
}

world::Result<world::Done> ResidentScene::changeTerrain(std::shared_ptr<const world::EditedChunk> edited) {
    const world::ChunkKey key = edited->record.key;
    if (const auto resident = chunks_.find(key); resident != chunks_.end())
        for (world::CasterId& caster : resident->second.casters)
            if (table_[caster].origin.slot < 0)
                if (auto done = swapTerrain(resident->second, caster, *edited); !done) return done;
    streamer_.rebound(key, edited->record.bounds);
    outlook_.forget();  // it may be wanted now where it was not
    if (const auto before = edited_.find(key); before != edited_.end()) editedBytes_ -= memoryBytes(*before->second);
    editedBytes_ += memoryBytes(*edited);
    streamer_.setAside(editedBytes_);
    edited_[key] = std::move(edited);
    return world::Done{};
}

}  // namespace server
