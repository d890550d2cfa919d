// server/shadow_system.h — the service without a socket: one call advances world, cache and GPU.
#pragma once

#include <chrono>
#include <cstdint>
#include <glm/glm.hpp>
#include <glm/gtc/quaternion.hpp>
#include <limits>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "cache/shadow_cache.h"
#include "cache/statistics.h"
#include "gpu/device.h"
#include "gpu/shadow_maps.h"
#include "server/lookup.h"
#include "server/resident_scene.h"
#include "server/spot_lights.h"
#include "server/sun.h"
#include "server/sun_motion.h"
#include "server/verification.h"
#include "world/mesh.h"
#include "world/result.h"
#include "world/store.h"
#include "world/terrain_edit.h"
#include "world/world_editor.h"

namespace server {

enum class Method {
    kGnomon,  ///< cache and scroll
    kRedraw,  ///< every cascade drawn whole, every frame: what the cache is measured against
};

/// What a frame may spend on its cache maps. What does not fit is owed, and reported.
struct Budget {
    uint64_t texels = cache::Limits::kNone;     ///< redrawn, > 0
    uint64_t triangles = cache::Limits::kNone;  ///< sent to the rasteriser, > 0; one smallest block may exceed it
    double ms = 0;  ///< wall time of the GPU's part, by the rates of the frames before: not deterministic; 0: any
};

/// What the maps are like; may be changed while a system runs.
struct MapSettings {
    int cameras = 1;           ///< 1 to 8, each with maps of its own; world, casters and certificates are shared
    int cascades = 4;          ///< 1 to 8
    int side = 1024;           ///< texels a side, 64 to 8192
    double farDistance = 600;  ///< split of the last cascade [m]: shadows reach this far from the eye
    double splitRatio = 3;     ///< each split is this many times the one before, > 1
    int guardBand = 4;         ///< windows move in steps of this many texels, 1 to side / 4
    double levelError = 0.5;   ///< a cascade draws the coarsest level of detail that is off by at most so many texels
    double smallestCaster = 0; ///< casters smaller than so many texels of a cascade are not drawn there; 0: all
    gpu::DepthFormat format = gpu::DepthFormat::kD32;
};

/// How chunks come.
struct StreamingConfig {
    world::Clock clock = world::Clock::kLockStep;
    world::DiskModel disk{};   ///< of the virtual clock
    bool prefetch = true;      ///< where reads take time: what the eye's way leads to is read ahead
    uint64_t bytesPerFrame = 1ull << 20;  ///< decoded, of the chunks taken up in one; one may exceed it. Not in lock-step
};

struct ShadowConfig : MapSettings {
    glm::dvec3 sun{0};         ///< direction of light travel; zero: the world's own
    bool movingSun = false;    ///< frames may turn it: doubles the memory of the maps
    SunMotionConfig sunMotion;
    Method method = Method::kGnomon;
    bool occlusion = true;     ///< certificates, texel-exact
    uint32_t raysPerCluster = 4096;  ///< above this a cluster is simply drawn
    double restSeconds = 10;   ///< an active object is static after resting this long
    uint32_t promotionsPerFrame = 16;
    uint64_t residentBytes = 4ull << 30;  ///< decoded chunks and meshes; edited chunks may take half of it
    StreamingConfig streaming{};
    uint64_t geometryBytes = 512ull << 20;  ///< GPU arena
    Budget budget;
    bool timestamps = true;  ///< of GPU passes; each costs a software driver 0.1 ms, without them cascades' times are 0
    cache::Sabotage sabotage = cache::Sabotage::kNone;  ///< for tests of the verification
};

struct Camera {
    glm::dvec3 position{0};  ///< [m]
    glm::dquat orientation{1, 0, 0, 0};  ///< camera-to-world, looks along -z
    /// Of the projection [rad], in (0, pi), or 0 where it is not known. Known, cascades that serve no
    /// receiver in view sleep until they do.
    double verticalFov = 0;
    double aspect = 1;  ///< width over height, > 0
    std::span<const AheadEye> ahead{};  ///< where it will be, if that is known; else its speed tells
};

struct FrameInput {
    double time = 0;  ///< [s], ascending
    Camera camera;
    std::span<const ObjectUpdate> objects;  ///< those that moved; the rest stay where they are
    /// Direction of light travel; zero: as before. Needs ShadowConfig::movingSun. A sun that light spaces
    /// refuse is an error of the report, and the last one stays.
    glm::dvec3 sun{0};
    std::span<const Camera> others{};  ///< the further cameras, always in the same order: MapSettings::cameras less one
};

/// CPU time of a frame by stage [ms]. Not deterministic.
struct StageTimes {
    double streamMs = 0;     ///< edits of the ground, wants, reads, caster tables, uploads
    double occlusionMs = 0;  ///< certificates
    double setsMs = 0;       ///< moved objects, static and active sets
    double planMs = 0;       ///< queries, plan
    double recordMs = 0;     ///< filling buffers, recording commands
};

struct FrameReport {
    uint64_t frame = 0;
    double time = 0;
    std::chrono::steady_clock::time_point begin;  ///< of `advance`; measured
    std::vector<cache::CascadeStatistics> cascades;  ///< by number
    std::vector<SpotReport> spots;  ///< by id
    uint32_t chunkArrivals = 0, chunkDepartures = 0;
    uint32_t refinements = 0;    ///< chunks that were there and came in other levels of detail
    uint32_t missingChunks = 0;  ///< that maps need now and that are not there
    uint32_t coarseChunks = 0;   ///< that are there, more coarsely than a map needs now
    double longestLack = 0;      ///< of all these, how long the first has been needed [s]
    uint64_t edits = 0;          ///< of the terrain, taken up in this frame
    std::vector<world::ReadSpan> reads;  ///< of chunks and meshes, that ended since the last frame
    uint64_t bytesRead = 0;      ///< decoded
    uint64_t bytesAgain = 0;     ///< of these, had been read before
    uint64_t residentBytes = 0;  ///< decoded chunks and meshes, with what is being read and what was edited
    uint64_t geometryBytes = 0;  ///< of what is resident, on the GPU
    uint64_t bytesUploaded = 0;  ///< to the GPU: geometry, transforms, commands
    uint64_t rays = 0;           ///< for certificates
    uint64_t certificates = 0;   ///< clusters newly proven hidden, over all cascades
    uint64_t revocations = 0;    ///< certificates that fell with an occluder
    uint64_t planHash = 0;
    cache::Limits limits;        ///< that the frame had to keep
    SunReport sun;
    StageTimes cpu;
    bool submitted = false;  ///< anything was drawn; if not, nothing is submitted
    gpu::Ticket ticket = 0;  ///< the GPU's number for the frame
    std::vector<uint8_t> mapCascades;  ///< per pair of maps on the GPU: its cascade in this frame
    gpu::GpuTimes gpu;       ///< empty until the frame is finished
    std::vector<world::Error> errors;  ///< per item; the frame went on without it
};

/// What a static caster cost in a frame, over all cascades.
struct CasterCost {
    std::string name;       ///< as errors name it: "instance 17 of chunk (1,0,2)"
    glm::dvec3 pWorld{0};   ///< middle of its bounds [m]
    uint64_t triangles = 0;  ///< sent to the rasteriser, once for each region that it was drawn in
    uint64_t draws = 0;
};

/// What drawing every cascade whole would cost in the current state, without drawing: static part. By number.
using RedrawCosts = std::vector<cache::Cost>;

/// A chunk of the world and where it stands.
struct ChunkPlace {
    world::ChunkKey key;
    world::ChunkPhase phase = world::ChunkPhase::kAway;
};

/// Which maps, while the sun steps.
enum class SunMaps : uint8_t {
    kShown,
    kNext,  ///< being filled or blended in; only while SunReport::next is not zero
};

/// Streams a world, keeps its shadow maps and accounts for every redrawn texel.
/// Cascades are numbered camera by camera: cascade c of camera k is number k * MapSettings::cascades + c, wherever
/// a cascade is named. A budget is shared: each camera gets an equal part, and what one leaves goes to the next.
/// One thread at a time; the work inside uses all of TBB's threads and gives the same plans and maps
/// for any number of them.
class ShadowSystem {
public:
    /// `device` and `store` must outlive the system, and so must `editor`, through which terrain edits reach the world's
    /// file; null: they stay in memory. kUsage for a configuration or a sun that cannot
    /// work, kBadData for a world without casters, kDevice and kLimit from the GPU.
    static world::Result<std::unique_ptr<ShadowSystem>> create(gpu::Device& device,
                                                              const world::WorldStore& store,
                                                              const ShadowConfig& config,
                                                              world::WorldEditor* editor = nullptr);
    ~ShadowSystem();

    /// Takes the named instance out of its chunk and makes it an object that updates can move.
    /// Until its first update it stands where the world has it. kNotFound names the name.
    world::Result<ObjectId> adopt(const std::string& name);
    /// Puts a new object into the world from the next frame on: active, unless its traits say that it
    /// rests. `mesh` is a row of the world. kNotFound for a mesh that the world does not have; kUsage and
    /// kLimit for a placement that is not finite or reaches beyond 1e8 m; then nothing changed.
    world::Result<ObjectId> spawn(uint32_t mesh, const world::Placement& placement, const ObjectTraits& traits = {});
    /// Says anew what an object is: at rest, deforming, or neither, and then it is active until it has rested. From the
    /// next frame on. kNotFound as below, kUsage and kLimit as above: then nothing changed. kLimit and kDevice where a
    /// level of detail that its new bounds draw cannot be uploaded.
    world::Result<world::Done> mark(ObjectId object, const ObjectTraits& traits);
    /// Takes the object out of the world for good, from the next frame on. kNotFound for an object that
    /// does not exist or was removed already.
    world::Result<world::Done> remove(ObjectId object);
    /// What `advance` would say of an update: kNotFound, kUsage and kLimit as above.
    world::Result<world::Done> requireMove(const ObjectUpdate& update) const;
    /// Digs or fills, from the next frame on; in the order in which edits are given. Made on a thread of its own from
    /// here on, which `advance` waits for but under the live clock. Chunks need not be in memory. kUsage, kLimit and
    /// kNotFound for an edit that makes no sense: then nothing happens. What goes wrong later, and kLimit for more
    /// edited chunks than memory may hold, is an error of the next frame's report, and leaves the ground, and with an editor the file, as they were.
    world::Result<world::Done> edit(const world::TerrainEdit& edit);
    /// Adds a cone of light, drawn from the next frame on. It is served by the chunks that the cameras need.
    /// kUsage for numbers that cannot work, kLimit for more than kMostSpots; the text names the number. After
    /// an error here or below nothing changed.
    world::Result<SpotId> addSpot(const culling::SpotLight& light);
    /// Places, turns or changes it, from the next frame on; all but its resolution. kNotFound for a light that
    /// does not exist or was removed already, here and below.
    world::Result<world::Done> moveSpot(SpotId id, const culling::SpotLight& light);
    /// Waits for the frames under way.
    world::Result<world::Done> removeSpot(SpotId id);
    /// kUsage for a limit of 0 or a time that is negative or not finite: the old budget stays.
    world::Result<world::Done> setBudget(const Budget& budget);
    /// Other maps from the next frame on; waits for the GPU. A cascade that serves the same distance as one before, with
    /// the same texels and format, keeps its maps: another number of cascades at the same ratio leaves those that
    /// stay as they are. The others are drawn anew, within the budget, and so is what a kept cascade now draws
    /// differently. Of fewer cameras the first ones stay. Certificates are sought anew. kUsage, kLimit, kDevice as in `create`: then nothing has changed,
    /// but that maps for the sun's next direction begin anew. `verify` and `redrawCosts` need a frame first.
    world::Result<world::Done> reconfigure(const MapSettings& settings);
    /// Where the world has it, or it was spawned. CHECKs that it was not removed.
    const world::Placement& restPlacement(ObjectId object) const;

    /// Advances everything by one frame and hands its drawing to the GPU, in one submission. Does not wait for
    /// it, but where two frames are under way already, for the older one. Views and windows are those of this
    /// frame at once; whatever reads maps waits for them by itself. Errors of single items are in the
    /// report; an Error means that the frame could not be drawn at all.
    world::Result<FrameReport> advance(const FrameInput& input);
    /// Waits for a frame's drawing and fills in what it took. May be left out. kUsage for a frame that is 64 or
    /// more submissions old; kDevice where drawing failed: then the next frame draws everything anew.
    world::Result<world::Done> finish(FrameReport& report);

    /// Cost of a whole redraw of the static part, by count alone.
    RedrawCosts redrawCosts() const;
    /// Draws every cascade's and spot light's static and working map from scratch and compares each texel.
    world::Result<VerifyReport> verify();

    CascadeView view(int cascade, SunMaps which = SunMaps::kShown) const;
    int cascades() const;  ///< of all cameras together
    const ShadowConfig& config() const;  ///< with the sun filled in
    /// Answers for world points [m] from a camera's working maps of the shown sun as they are, the nearest cascade that
    /// holds and knows a point first. Reads whole maps back: for batches.
    world::Result<std::vector<PointAnswer>> lookup(std::span<const glm::dvec3> points, const LookupBias& bias = {},
                                                   int camera = 0);
    world::Result<SpotView> viewSpot(SpotId id) const;
    /// Answers for world points [m] from a spot light's working map as it is. Reads the whole map back: for
    /// batches.
    world::Result<std::vector<SpotAnswer>> lookupSpot(SpotId id, std::span<const glm::dvec3> points,
                                                      const LookupBias& bias = {});
    world::Result<std::vector<float>> readSpotMap(SpotId id, gpu::MapKind kind);
    /// A map's depths, row by row in stored order.
    world::Result<std::vector<float>> readMap(int cascade, gpu::MapKind kind, SunMaps which = SunMaps::kShown);
    /// Memory that `copyWorking` writes to from now on; as ShadowMaps::share.
    world::Result<bool> share(std::span<std::byte> memory);
    /// Copies working maps of the shown sun there, of cascades by number; as ShadowMaps::copyWorking.
    world::Result<world::Done> copyWorking(std::vector<gpu::ShadowMaps::MapCopy> copies);
    /// What each texel of that is worth, in the same order: of the shown sun's.
    std::vector<TexelState> texelStates(int cascade, gpu::MapKind kind) const;
    /// Hash of a map's bits.
    world::Result<uint64_t> mapHash(int cascade, gpu::MapKind kind);
    /// The last frame's plan for the cascades, until the next `advance`.
    const cache::FramePlan& plan() const;
    /// The static casters that cost the last frame the most triangles, dearest first, at most `most`; until the next
    /// `advance`.
    std::vector<CasterCost> dearestCasters(size_t most = std::numeric_limits<size_t>::max()) const;
    /// What that plan's items draw.
    const world::MeshLevel& geometry(cache::GeometryId id) const;
    /// Regions of the last frame's plan that were cleared (redrawn from nothing), stored order.
    std::span<const cache::StoreRect> clearedRects(int cascade) const;
    /// What the last frame drew into a cascade's shown cache map, lattice texels: disjoint, each region with its one
    /// cause. Until the next `advance`.
    std::span<const cache::Redrawn> redrawn(int cascade) const;
    /// Texels of a cascade's window that active casters may cover: one rectangle each, by caster, of the first `most`
    /// that show there.
    std::vector<cache::TexelRect> activeRects(int cascade, size_t most) const;
    /// All casters in memory, as the last frame left them; until the next call that changes something.
    const world::CasterTable& casters() const;
    /// All chunks that are not away, by key.
    std::vector<ChunkPlace> chunks() const;
    double chunkSize() const;  ///< edge of a chunk [m]

private:
    struct Impl;
    explicit ShadowSystem(std::unique_ptr<Impl> impl);
    std::unique_ptr<Impl> impl_;
};

}  // namespace server
