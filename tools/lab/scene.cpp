#include "tools/lab/scene.h"

#include <algorithm>
#include <limits>
#include <set>
#include <string>
#include <utility>

#include "tools/mover_feed.h"
#include "world/hash.h"

namespace tools::lab {
namespace {

using world::CasterId;
using world::Error;
using world::ErrorCode;
using world::Result;

/// Cells of the octree that are smaller than this [m] would hold a caster each.
constexpr double kSmallestCell = 8;

/// Whether two boxes of light space lie in common columns of light.
bool sameColumn(const world::Box& a, const world::Box& b) {
    return a.min.x <= b.max.x && a.max.x >= b.min.x && a.min.y <= b.max.y && a.max.y >= b.min.y;
}

using InstanceKey = std::pair<world::ChunkKey, uint32_t>;

Result<std::map<InstanceKey, size_t>> instancesOf(const world::WorldStore& store,
                                                  const std::vector<world::MoverTrack>& tracks) {
    std::map<InstanceKey, size_t> found;
    if (tracks.empty()) return found;
    const auto names = store.names();
    if (!names) return names.error();
    for (size_t t = 0; t < tracks.size(); ++t) {
        const auto at = std::lower_bound(names.value().begin(), names.value().end(), tracks[t].name,
                                         [](const world::NamedInstance& n, const std::string& name) { return n.name < name; });
        if (at == names.value().end() || at->name != tracks[t].name)
            return Error{ErrorCode::kNotFound, store.path() + ": no object is named '" + tracks[t].name +
                                                   "'; give the movers that were recorded in this world"};
        found[{at->chunk, at->slot}] = t;
    }
    return found;
}

}  // namespace

Result<Scene> Scene::load(const world::WorldStore& store, std::span<const world::Pose> poses, double reach,
                          const culling::LightSpace& light, std::vector<world::MoverTrack> tracks) {
    CHECK(!poses.empty());
    Scene scene;
    const world::Header& header = store.header();
    scene.statics_ = std::make_unique<world::Octree>(header.bounds, kSmallestCell);
    world::Box near;
    for (const world::Pose& pose : poses) {
        const glm::dvec3 at = light.toLight(pose.position);
        near.add(world::Box{at - reach, at + reach});
    }
    const auto instances = instancesOf(store, tracks);
    if (!instances) return instances.error();
    // A mover may come from anywhere.
    std::set<world::ChunkKey> wanted;
    for (const auto& [key, track] : instances.value()) wanted.insert(key.first);
    for (const world::ChunkRecord& record : store.chunks())
        if (!record.bounds.empty() && sameColumn(light.toLight(record.bounds), near)) wanted.insert(record.key);

    std::map<uint32_t, world::MeshSlot> slots;
    for (const world::ChunkKey key : wanted) {
        auto read = store.readChunk(key);
        if (!read) return read.error();
        scene.chunks_.push_back(std::make_shared<const world::Chunk>(std::move(read.value())));
        const world::Chunk& chunk = *scene.chunks_.back();
        const auto place = [&](CasterId id) {
            scene.statics_->insert(id, scene.table_[id].bounds);
            scene.bounds_.add(scene.table_[id].bounds);
        };
        if (!chunk.terrain.levels.empty()) {
            const world::Placement at{glm::mat3(1), glm::dvec3(key.x, 0, key.z) * header.chunkSize};
            place(scene.table_.add(scene.table_.addMesh(chunk.terrain), at, world::CasterState::kStatic, {key, -1, -1}));
        }
        for (uint32_t i = 0; i < chunk.instances.size(); ++i) {
            const world::Instance& instance = chunk.instances[i];
            if (!slots.contains(instance.mesh)) {
                auto mesh = store.readMesh(instance.mesh);
                if (!mesh) return mesh.error();
                auto& kept = scene.meshes_[instance.mesh];
                kept = std::make_unique<const world::Mesh>(std::move(mesh.value()));
                slots[instance.mesh] = scene.table_.addMesh(*kept);
            }
            const auto track = instances.value().find({key, i});
            const bool moves = track != instances.value().end();
            const CasterId id = scene.table_.add(slots.at(instance.mesh), instance.placement,
                                                 moves ? world::CasterState::kActive : world::CasterState::kStatic,
                                                 {key, int32_t(i), -1});
            if (!moves) {
                place(id);
                continue;
            }
            scene.bounds_.add(scene.table_[id].bounds);
            scene.movers_.push_back(id);
            scene.tracks_.push_back({std::move(tracks[track->second]), instance.placement, id});
        }
    }
    if (scene.table_.size() == 0)
        return Error{ErrorCode::kBadData, store.path() + ": nothing near the path casts a shadow; give a path through it"};
    const auto content = store.contentHash();
    if (!content) return content.error();
    // Chunks are read whole and in order: which they are says which caster has which number.
    std::vector<int32_t> keys;
    for (const world::ChunkKey key : wanted) keys.insert(keys.end(), {key.x, key.y, key.z});
    scene.hash_ = world::hashValues(std::span<const int32_t>(keys), content.value());
    return scene;
}

std::span<const CasterId> Scene::moveTo(double time) {
    moved_.clear();
    for (const Track& t : tracks_) {
        const world::Placement placement = world::moved(t.rest, world::sampleAt(t.track, time));
        if (placement == table_[t.caster].placement) continue;
        table_.place(t.caster, placement);
        moved_.push_back(t.caster);
    }
    return moved_;
}

}  // namespace tools::lab
