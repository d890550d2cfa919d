// server/resident_scene.h — the part of the world that is in memory, kept the same for the streamer,
// the caster table, the octree, the certificates and the GPU's geometry.
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <unordered_map>
#include <vector>

#include "cache/caster_sets.h"
#include "cache/shadow_cache.h"
#include "culling/light_casters.h"
#include "culling/occlusion.h"
#include "culling/receivers.h"
#include "gpu/shadow_maps.h"
#include "server/outlook.h"
#include "world/casters.h"
#include "world/edited_terrain.h"
#include "world/octree.h"
#include "world/store.h"
#include "world/streamer.h"

namespace server {

/// An object that a client owns; given out by `adopt` and `spawn`, from 0, never twice.
using ObjectId = uint64_t;

/// What a client says of an object, when it makes it or later.
struct ObjectTraits {
    /// Its shape changes: it stays active, and each update dirties its bounds even where it stands.
    bool deforms = false;
    float margin = 0;  ///< how far its shape may reach beyond its mesh [m], 0 or more
    bool atRest = false;  ///< static from now on, without a margin: it will not move soon
};

struct ObjectUpdate {
    ObjectId object = 0;
    world::Placement placement;
};

struct SceneConfig {
    double farDistance = 600;  ///< [m]
    bool occlusion = true;
    uint32_t raysPerCluster = 4096;
    double restSeconds = 10;
    uint32_t promotionsPerFrame = 16;
    world::StreamerConfig streamer;
    bool prefetch = true;
    int side = 1024;
    int guardBand = 1;  ///< [texels]
    culling::Detail detail;
    bool stickyCertificates = false;  ///< a deliberate defect, for tests
};

/// What a frame's changes cost.
struct SceneChanges {
    uint64_t revocations = 0;  ///< certificates that fell
    uint32_t chunkArrivals = 0, chunkDepartures = 0;
    uint32_t refinements = 0;  ///< chunks that were there and came in other levels of detail
    std::vector<world::ReadSpan> reads;
    uint64_t bytesRead = 0, bytesAgain = 0;
    culling::CertifyCosts certify;
    double streamMs = 0, setsMs = 0, occlusionMs = 0;
    std::vector<world::Error> errors;
};

/// The casters as one sun sees them, and what happened to them since the last `settle`.
struct SunSide {
    SunSide(const culling::LightSpace& space, const std::vector<culling::Cascade>& cascades, const culling::Detail& detail)
        : light(space, cascades, detail) {}
    culling::LightCasters light;
    size_t fitted = 0;   ///< slots of the table, from the first, whose casters were fitted when it was opened
    bool whole = false;  ///< all were; whatever came later is placed as it comes
    std::unique_ptr<culling::Occlusion> occlusion;  ///< null: everything is drawn
    std::vector<std::optional<glm::dvec2>> certifiedAt;  ///< per eye and cascade: eye at the last look for certificates
    std::vector<cache::Departure> departures;
    std::vector<world::Box> activeDirt;  ///< light space
};

/// One thread at a time. Seen by one sun, or by two while the sun steps: side 0 is shown, side 1 is the
/// next one.
class ResidentScene {
public:
    /// All references must outlive it.
    ResidentScene(const world::WorldStore& store, gpu::ShadowMaps& maps, const culling::LightSpace& space,
                  const std::vector<culling::Cascade>& cascades, const SceneConfig& config);

    world::Result<ObjectId> adopt(const std::string& name);
    /// CHECKs that it was not removed.
    const world::Placement& restPlacement(ObjectId object) const { return living(object).value()->rest; }
    /// See ShadowSystem.
    world::Result<ObjectId> spawn(uint32_t mesh, const world::Placement& placement, const ObjectTraits& traits);
    world::Result<world::Done> mark(ObjectId object, const ObjectTraits& traits);
    world::Result<world::Done> remove(ObjectId object);
    world::Result<world::Done> requireMove(const ObjectUpdate& update) const;

    /// The scene fitted to other cascades; nothing has changed yet.
    struct Refit {
        std::unique_ptr<SunSide> side;
        std::vector<cache::Arrival> arrivals;
        SceneConfig config;
    };
    /// For a configuration that differs in `farDistance`, `side`, `guardBand` and `detail` alone. One side, no
    /// next one. kLimit and kDevice where a level that the new cascades draw cannot be uploaded.
    ///   from  per new cascade: the old one whose maps it takes over, or -1. What is drawn differently in any
    ///         of those departs and arrives, with the cause kLevel.
    world::Result<Refit> refit(const std::vector<culling::Cascade>& cascades, const SceneConfig& config,
                               std::span<const int> from);
    /// Takes it over, before anything else has happened. Certificates are sought anew.
    void apply(Refit refit);
    /// The terrain of a chunk is another one from now on, and whenever the chunk comes again. Only where the two
    /// differ is anything redrawn. kLimit and kDevice where it cannot be uploaded: it may be tried again.
    world::Result<world::Done> changeTerrain(std::shared_ptr<const world::EditedChunk> chunk);
    /// Opens side 1. Its casters get no certificates: a sun that steps outlives few of them.
    void openNext(const culling::LightSpace& space);
    /// Fits a share of all casters to side 1, from those that have been; true when all are: only then it may be viewed
    /// or shown. Dear for all at once: the vertices of everything that is resident.
    bool fitNext(double share);
    /// Side 1 becomes side 0, and the old one is dropped.
    void showNext();
    /// Drops side 1.
    void dropNext();
    size_t sides() const { return sides_.size(); }

    /// Moves objects, settles the static and active sets, streams for the eyes, always in the same order,
    /// and certifies what comes near one. Bad items are reported and skipped; an
    /// Error (kLimit, kDevice) means that the scene could not be completed.
    world::Result<SceneChanges> advance(double time, std::span<const Eye> eyes, std::span<const ObjectUpdate> updates);

    /// For the cache. `hide`: with certificates.
    cache::Scene view(size_t side, bool hide) const;
    /// What happened since the last `settle`.
    cache::Events events(size_t side) const {
        return {sides_[side]->departures, arrivals_, sides_[side]->activeDirt};
    }
    /// The same, with all boxes in world metres.
    cache::Events worldEvents() const { return {worldDepartures_, arrivals_, worldDirt_}; }
    /// What the GPU calls a level of the caster's mesh; puts it there first if need be. kLimit and kDevice.
    world::Result<cache::GeometryId> uploadLevel(world::CasterId caster, size_t level);
    /// The caches know of all events.
    void settle();
    /// Cascades (bit c) that serve nothing which `view` can see.
    uint32_t unseen(const culling::View& view, bool servesNearer) const {
        return culling::unseenCascades(view, shown().light.cascades(), statics_, table_, sets_.active(), servesNearer);
    }
    const world::CasterTable& casters() const { return table_; }
    /// Chunks that maps need now and lack, or have too coarsely.
    std::span<const world::Lack> lacking() const { return streamer_.lacking(); }
    const world::Streamer& streamer() const { return streamer_; }
    const culling::LightCasters& light(size_t side) const { return sides_[side]->light; }
    /// A mesh level that casters in memory use; CHECKs that they do.
    const world::MeshLevel& geometry(cache::GeometryId id) const {
        CHECK(id < uploaded_.size() && uploaded_[id]);
        return *uploaded_[id];
    }

private:
    struct Object {
        world::CasterId caster = 0;
        world::Placement rest;
        bool deforms = false;
    };
    struct ResidentChunk {
        std::shared_ptr<const world::Chunk> chunk;
        std::vector<world::CasterId> casters;
        std::optional<world::MeshSlot> terrain;
    };
    const SunSide& shown() const { return *sides_.front(); }
    void placeStatic(world::CasterId caster);
    void placeActive(world::CasterId caster);
    void dirtyActive(world::CasterId caster);
    void depart(world::CasterId caster, cache::Cause cause);
    void removeCaster(world::CasterId caster);
    void moveObjects(double time, std::span<const ObjectUpdate> updates, SceneChanges& changes);
    /// kNotFound says whether it was removed or never was.
    world::Result<const Object*> living(ObjectId object) const;
    /// A margin of 0 or more, and not both of what excludes the other.
    static world::Result<world::Done> requireTraits(const std::string& who, const ObjectTraits& traits);
    /// A placement that the maps can hold: finite, and not beyond kFarthest.
    world::Result<world::Done> requirePlaceable(const std::string& who, const world::Mesh& mesh,
                                                const world::Placement& placement, float margin) const;
    world::Result<world::MeshSlot> pinnedMesh(uint32_t mesh);
    /// The static caster leaves the static set: for an arrival that no map has seen, as if it never came.
    void leaveStatics(world::CasterId caster, cache::Cause cause);
    size_t revoke(std::span<const world::CasterId> casters);
    void promote(double time);
    /// Puts an active caster that has left the active set among the statics.
    void settleAsStatic(world::CasterId caster);
    world::Result<world::Done> stream(double time, std::span<const Eye> eyes, SceneChanges& changes);
    void dropChunk(world::ChunkKey key);
    world::Result<world::Done> addChunk(std::shared_ptr<const world::Chunk> chunk);
    world::Result<world::Done> refineChunk(std::shared_ptr<const world::Chunk> chunk);
    void moveLevels(world::MeshSlot from, world::MeshSlot to);
    world::Result<world::Done> swapTerrain(ResidentChunk& chunk, world::CasterId& caster,
                                            const world::EditedChunk& edited);
    void departWhereChanged(world::CasterId before, size_t firstLevel, world::CasterId after,
                            const world::EditedChunk& chunk);
    world::Placement terrainPlacement(world::ChunkKey key) const;
    world::Result<world::CasterId> addStatic(world::MeshSlot mesh, const world::Placement& placement,
                                             world::CasterOrigin origin);
    /// Fits the casters of so many more slots of the table, from those that have been.
    void fit(SunSide& side, size_t slots);
    /// Uploads the levels that the caster's cascades draw.
    world::Result<world::Done> uploadLevels(const culling::LightCasters& light, world::CasterId caster);
    void removeMesh(world::MeshSlot slot);
    void startOcclusion();
    void newcomers(const culling::LightCasters& light, glm::dvec2 from, glm::dvec2 to, double reach,
                   std::vector<world::CasterId>& casters) const;
    void occlude(SunSide& side, std::span<const Eye> eyes, SceneChanges& changes);

    const world::WorldStore& store_;
    gpu::ShadowMaps& maps_;
    SceneConfig config_;
    world::Streamer streamer_;
    Outlook outlook_;
    world::CasterTable table_;
    std::vector<std::unique_ptr<SunSide>> sides_;  ///< one or two
    world::Octree statics_;
    bool occlusionStarted_ = false;
    culling::RayAllowance allowance_;
    cache::CasterSets sets_;
    std::vector<const world::MeshLevel*> uploaded_;  ///< by GeometryId; null: released
    std::map<uint32_t, world::MeshSlot> meshSlots_;  ///< by mesh id
    std::map<world::ChunkKey, ResidentChunk> chunks_;
    std::map<world::ChunkKey, std::shared_ptr<const world::EditedChunk>> edited_;  ///< whose terrain counts
    uint64_t editedBytes_ = 0;  ///< of those, in memory
    std::unordered_map<ObjectId, Object> objects_;  ///< that were not removed
    ObjectId nextObject_ = 0;
    std::map<std::pair<world::ChunkKey, uint32_t>, ObjectId> adopted_;
    std::optional<std::vector<world::NamedInstance>> names_;
    std::vector<cache::Arrival> arrivals_;  ///< since the last `settle`
    std::vector<cache::Departure> worldDepartures_;  ///< likewise
    std::vector<world::Box> worldDirt_;              ///< likewise
    uint64_t revocations_ = 0;              ///< likewise
    std::vector<world::CasterId> spawned_;  ///< active, rest from the next frame on
};

}  // namespace server
