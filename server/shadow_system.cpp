#include "server/shadow_system.h"

#include <algorithm>
#include <cmath>

#include "cache/invalidation.h"
#include "culling/cascades.h"
#include "culling/light_space.h"
#include "server/shadow_system_impl.h"
#include "world/hash.h"

namespace server {

namespace {

using world::Error;
using world::ErrorCode;
using world::Result;

constexpr int kMostCameras = 8;
constexpr double kLargestLevelError = 64;  // [texels]
constexpr double kLargestSunStep = 0.2;  // [rad]

Result<world::Done> requireBudget(const Budget& budget) {
    if (budget.texels == 0 || budget.triangles == 0)
        return Error{ErrorCode::kUsage, "budget: nothing could ever be drawn; give at least 1 texel or triangle"};
    if (!std::isfinite(budget.ms) || budget.ms < 0)
        return Error{ErrorCode::kUsage, "budget: " + std::to_string(budget.ms) + " ms; give a time of 0 or more"};
    return world::Done{};
}

/// Distinct depths of a format: a float's are of the size of its largest.
double depthSteps(gpu::DepthFormat format) {
    return format == gpu::DepthFormat::kD16 ? 1 / cache::kNearestDepth - 1 : 1 << 24;
}

/// Pairs of maps that one camera needs for one sun: where the world can be longer along the light than a cascade's range of
/// depths, one more to move it.
size_t mapsFor(const world::WorldStore& store, const ShadowConfig& config, const std::vector<culling::Cascade>& cascades) {
    const world::Box& bounds = store.header().bounds;
    const double longest = glm::length(bounds.max - bounds.min);
    const bool moves = config.method == Method::kGnomon && std::any_of(cascades.begin(), cascades.end(), [&](const culling::Cascade& c) {
        return cache::longestRange(c, depthSteps(config.format)) < longest;
    });
    return cascades.size() + (moves ? 1 : 0);
}

SceneConfig sceneConfig(const ShadowConfig& c) {
    const world::StreamerConfig streamer{c.residentBytes, c.geometryBytes, c.streaming.bytesPerFrame, c.streaming.clock,
                                         c.streaming.disk};
    return {c.farDistance, c.occlusion, c.raysPerCluster, c.restSeconds, c.promotionsPerFrame, streamer,
            c.streaming.prefetch, c.side, c.guardBand, {c.levelError, c.smallestCaster},
            c.sabotage == cache::Sabotage::kStickyCertificate};
}

/// The cascades of a configuration, if all that it says of maps can be.
Result<std::vector<culling::Cascade>> checkedCascades(const ShadowConfig& config) {
    auto cascades = culling::makeCascades(config.cascades, config.side, config.farDistance, config.splitRatio,
                                          config.guardBand);
    if (!cascades) return cascades;
    if (config.cameras < 1 || config.cameras > kMostCameras)
        return Error{ErrorCode::kUsage, "cameras: " + std::to_string(config.cameras) + "; give 1 to 8"};
    if (!(config.levelError > 0 && config.levelError <= kLargestLevelError))
        return Error{ErrorCode::kUsage, "level error: give more than 0 and at most 64 texels"};
    if (!(config.smallestCaster >= 0 && std::isfinite(config.smallestCaster)))
        return Error{ErrorCode::kUsage, "smallest caster: give a number of texels, 0 or more"};
    return cascades;
}

}  // namespace

ShadowSystem::Impl::Impl(const world::WorldStore& worldStore, const ShadowConfig& c, std::unique_ptr<gpu::ShadowMaps> m,
                         const culling::LightSpace& space, const std::vector<culling::Cascade>& lightCascades,
                         world::WorldEditor* editor)
    : config(c),
      store(worldStore),
      maps(std::move(m)),
      cascades(lightCascades),
      mapsPerCamera(mapsFor(store, c, cascades)),
      scene(store, *maps, space, cascades, sceneConfig(c)),
      spots(*maps, c.sabotage),
      edits(store, editor, c.residentBytes / 2),
      motion(c.sunMotion, space.sun, c.method == Method::kGnomon),
      sunNow(space.sun) {
    suns.push_back(makeSun(space, 0, cache::Cause::kStart));
}

ShadowSystem::ShadowSystem(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
ShadowSystem::~ShadowSystem() = default;

Result<std::unique_ptr<ShadowSystem>> ShadowSystem::create(gpu::Device& device, const world::WorldStore& store,
                                                           const ShadowConfig& config, world::WorldEditor* editor) {
    ShadowConfig filled = config;
    if (filled.sun == glm::dvec3(0)) filled.sun = store.header().sun;
    if (filled.sun == glm::dvec3(0))
        return Error{ErrorCode::kUsage, store.path() + ": the world names no sun; give --sun AZIMUTH,ELEVATION"};
    auto space = culling::makeLightSpace(filled.sun);
    if (!space) return space.error();
    auto cascades = checkedCascades(filled);
    if (!cascades) return cascades.error();
    if (!(filled.restSeconds >= 0))
        return Error{ErrorCode::kUsage, "rest time: " + std::to_string(filled.restSeconds) + " s; give 0 or more"};
    if (auto budget = requireBudget(filled.budget); !budget) return budget.error();
    if (auto disk = world::requireDisk(filled.streaming.disk); !disk) return disk.error();
    if (store.chunks().empty() || store.header().bounds.empty())
        return Error{ErrorCode::kBadData, store.path() + ": nothing in it casts a shadow; bake a source that has casters"};

    const SunMotionConfig& motion = filled.sunMotion;
    if (!(motion.step > 0 && motion.step <= kLargestSunStep && motion.blendSeconds >= 0 &&
          std::isfinite(motion.blendSeconds)))
        return Error{ErrorCode::kUsage, "sun: give steps above 0 and up to 0.2 radians, and a blend of 0 seconds or more"};

    gpu::ShadowMapsConfig mapsConfig;
    mapsConfig.cascades = int(mapsFor(store, filled, cascades.value())) * filled.cameras * (filled.movingSun ? 2 : 1);
    mapsConfig.side = filled.side;
    mapsConfig.geometryBytes = filled.geometryBytes;
    mapsConfig.format = filled.format;
    mapsConfig.timestamps = filled.timestamps;
    mapsConfig.framesInFlight = int(kFramesInFlight);
    auto maps = gpu::ShadowMaps::create(device, mapsConfig);
    if (!maps) return maps.error();
    return std::unique_ptr<ShadowSystem>(new ShadowSystem(
        std::make_unique<Impl>(store, filled, std::move(maps.value()), space.value(), cascades.value(), editor)));
}

std::unique_ptr<Sun> ShadowSystem::Impl::makeSun(const culling::LightSpace& space, size_t place,
                                                 cache::Cause begin) const {
    const world::Box extent = space.toLight(store.header().bounds);
    cache::CacheConfig cacheConfig;
    cacheConfig.side = config.side;
    cacheConfig.guardBand = config.guardBand;
    cacheConfig.scene = {extent.min.z, std::max(1.0, extent.max.z - extent.min.z)};
    cacheConfig.depthSteps = depthSteps(config.format);
    cacheConfig.spareMap = mapsPerCamera > cascades.size();
    cacheConfig.sabotage = config.sabotage;
    auto sun = std::make_unique<Sun>(Sun{space, {}, begin});
    for (size_t camera = 0; camera < size_t(config.cameras); ++camera) {
        cacheConfig.firstMap = place * mapsPerSun() + camera * mapsPerCamera;
        sun->caches.emplace_back(cascades, cacheConfig);
    }
    return sun;
}

std::vector<uint8_t> ShadowSystem::Impl::cascadesOf(const cache::FramePlan& executed) const {
    std::vector<uint8_t> numbers;
    for (size_t m = 0; m < executed.cascades.size(); ++m) {
        const size_t camera = m / mapsPerCamera % size_t(config.cameras);
        numbers.push_back(uint8_t(camera * cascades.size() + size_t(executed.cascades[m].cascade)));
    }
    return numbers;
}

Result<ObjectId> ShadowSystem::adopt(const std::string& name) { return impl_->scene.adopt(name); }

Result<ObjectId> ShadowSystem::spawn(uint32_t mesh, const world::Placement& placement, const ObjectTraits& traits) {
    return impl_->scene.spawn(mesh, placement, traits);
}

Result<world::Done> ShadowSystem::mark(ObjectId object, const ObjectTraits& traits) {
    return impl_->scene.mark(object, traits);
}

Result<world::Done> ShadowSystem::remove(ObjectId object) { return impl_->scene.remove(object); }

Result<world::Done> ShadowSystem::requireMove(const ObjectUpdate& update) const {
    return impl_->scene.requireMove(update);
}

Result<world::Done> ShadowSystem::edit(const world::TerrainEdit& edit) { return impl_->edits.give(edit); }

Result<SpotId> ShadowSystem::addSpot(const culling::SpotLight& light) { return impl_->spots.add(light); }

Result<world::Done> ShadowSystem::moveSpot(SpotId id, const culling::SpotLight& light) {
    return impl_->spots.move(id, light);
}

Result<world::Done> ShadowSystem::removeSpot(SpotId id) { return impl_->spots.remove(id); }

Result<world::Done> ShadowSystem::setBudget(const Budget& budget) {
    if (auto good = requireBudget(budget); !good) return good.error();
    impl_->config.budget = budget;
    return world::Done{};
}

Result<world::Done> ShadowSystem::reconfigure(const MapSettings& settings) {
    Impl& s = *impl_;
    ShadowConfig config = s.config;
    static_cast<MapSettings&>(config) = settings;
    auto cascades = checkedCascades(config);
    if (!cascades) return cascades.error();
    if (s.suns.size() == 2) {  // what was filled for the sun's next direction begins anew
        s.scene.dropNext();
        s.suns.pop_back();
        s.motion.dropNext();
    }
    const Sun& old = s.shown();
    const bool sameTexels = config.side == s.config.side && config.guardBand == s.config.guardBand &&
                            config.format == s.config.format;
    const size_t count = cascades.value().size(), perCamera = mapsFor(s.store, config, cascades.value());
    const size_t keptCameras = sameTexels ? std::min(old.caches.size(), size_t(config.cameras)) : 0;
    std::vector<int> from(count, -1);  // per cascade
    std::vector<int> fromMaps(perCamera * size_t(config.cameras) * (config.movingSun ? 2 : 1), -1);
    for (size_t c = 0; c < count; ++c) {
        const auto kept = std::find(s.cascades.begin(), s.cascades.end(), cascades.value()[c]);
        if (keptCameras == 0 || kept == s.cascades.end()) continue;
        from[c] = int(kept - s.cascades.begin());
        if (s.config.sabotage == cache::Sabotage::kLostMaps) continue;
        for (size_t k = 0; k < keptCameras; ++k) fromMaps[k * perCamera + c] = int(old.caches[k].map(from[c]));
    }
    auto refit = s.scene.refit(cascades.value(), sceneConfig(config), from);
    if (!refit) return refit.error();
    if (auto shaped = s.maps->reshape(fromMaps, config.side, config.format); !shaped) return shaped.error();

    s.scene.apply(std::move(refit.value()));
    s.config = config;
    s.cascades = std::move(cascades.value());
    s.mapsPerCamera = perCamera;
    auto sun = s.makeSun(old.space, 0, old.begin);
    std::vector<cache::RectSet> gaps(count * sun->caches.size());
    for (size_t k = 0; k < keptCameras; ++k)
        for (size_t c = 0; c < count; ++c) {
            if (from[c] < 0) continue;
            sun->caches[k].adopt(int(c), old.caches[k], from[c]);
            const size_t before = k * size_t(old.caches[k].cascades()) + size_t(from[c]);
            if (before < s.gaps.size()) gaps[k * count + c] = s.gaps[before];
        }
    s.gaps = std::move(gaps);
    s.suns.front() = std::move(sun);
    s.underWay.clear();
    s.planned = false;
    return world::Done{};
}

const world::Placement& ShadowSystem::restPlacement(ObjectId object) const {
    return impl_->scene.restPlacement(object);
}

RedrawCosts ShadowSystem::redrawCosts() const {
    Impl& s = *impl_;
    CHECK(s.planned);
    s.redraw.reset(s.mapCount());
    RedrawCosts costs;
    for (const cache::ShadowCache& cache : s.shown().caches) {
        cache.planRedraw(s.scene.view(0, false), s.redraw, s.statistics);
        for (const cache::CascadeStatistics& c : s.statistics) costs.push_back(c.total);
    }
    return costs;
}

Result<VerifyReport> ShadowSystem::verify() {
    Impl& s = *impl_;
    CHECK(s.planned);
    s.redraw.reset(s.mapCount());
    auto report = server::verify(*s.maps, s.scene, s.suns, s.redraw);
    if (report) {
        report.value().redraw = byCascade(report.value().redraw, s.cascadesOf(s.redraw), size_t(cascades()));
        if (const auto done = s.spots.verify(s.scene, report.value()); !done) return done.error();
    }
    s.uploadedBefore = s.maps->uploadedBytes();
    return report;
}

CascadeView ShadowSystem::view(int cascade, SunMaps which) const {
    CHECK(size_t(which) < impl_->suns.size());
    return viewOf(*impl_->suns[size_t(which)], cascade);
}

int ShadowSystem::cascades() const { return impl_->config.cameras * impl_->config.cascades; }
const ShadowConfig& ShadowSystem::config() const { return impl_->config; }

Result<std::vector<float>> ShadowSystem::readMap(int cascade, gpu::MapKind kind, SunMaps which) {
    CHECK(size_t(which) < impl_->suns.size());
    const CascadeOf of = impl_->suns[size_t(which)]->of(cascade);
    return impl_->maps->read(int(of.cache.map(of.cascade)), kind);
}

Result<bool> ShadowSystem::share(std::span<std::byte> memory) { return impl_->maps->share(memory); }

Result<world::Done> ShadowSystem::copyWorking(std::vector<gpu::ShadowMaps::MapCopy> copies) {
    for (gpu::ShadowMaps::MapCopy& copy : copies) {
        const CascadeOf of = impl_->shown().of(copy.cascade);
        copy.cascade = int(of.cache.map(of.cascade));
    }
    return impl_->maps->copyWorking(copies);
}

std::vector<TexelState> ShadowSystem::texelStates(int cascade, gpu::MapKind kind) const {
    const auto c = size_t(cascade);
    return server::texelStates(impl_->shown(), cascade, kind,
                               c < impl_->gaps.size() ? impl_->gaps[c].rects() : std::span<const cache::TexelRect>());
}

Result<std::vector<PointAnswer>> ShadowSystem::lookup(std::span<const glm::dvec3> points, const LookupBias& bias,
                                                      int camera) {
    CHECK(camera >= 0 && camera < impl_->config.cameras);
    return server::lookup(*impl_->maps, impl_->shown(), camera, impl_->gaps, points, bias);
}

Result<SpotView> ShadowSystem::viewSpot(SpotId id) const { return impl_->spots.view(id); }

Result<std::vector<SpotAnswer>> ShadowSystem::lookupSpot(SpotId id, std::span<const glm::dvec3> points,
                                                         const LookupBias& bias) {
    return impl_->spots.lookup(id, points, bias);
}

Result<std::vector<float>> ShadowSystem::readSpotMap(SpotId id, gpu::MapKind kind) {
    return impl_->spots.readMap(id, kind);
}

Result<uint64_t> ShadowSystem::mapHash(int cascade, gpu::MapKind kind) {
    auto depths = readMap(cascade, kind);
    if (!depths) return depths.error();
    return world::hashValues(std::span<const float>(depths.value()));
}

const cache::FramePlan& ShadowSystem::plan() const {
    CHECK(impl_->planned);
    return impl_->plan;
}

std::vector<CasterCost> ShadowSystem::dearestCasters(size_t most) const {
    const cache::FramePlan& drawn = plan();
    struct Sum {
        world::CasterId caster;
        uint64_t triangles, draws;
    };
    std::vector<Sum> sums;
    for (const cache::CascadePlan& cascade : drawn.cascades)
        for (const cache::DrawPass& pass : cascade.staticPasses)
            for (uint32_t k = pass.firstItem; k < pass.firstItem + pass.itemCount; ++k)
                sums.push_back({drawn.casters[drawn.items[k].transform], drawn.items[k].indexCount / 3, 1});
    std::sort(sums.begin(), sums.end(), [](const Sum& a, const Sum& b) { return a.caster < b.caster; });
    size_t kept = 0;
    for (size_t k = 0; k < sums.size(); ++k) {
        if (kept > 0 && sums[kept - 1].caster == sums[k].caster) {
            sums[kept - 1].triangles += sums[k].triangles;
            sums[kept - 1].draws += sums[k].draws;
        } else {
            sums[kept++] = sums[k];
        }
    }
    sums.resize(kept);
    most = std::min(most, kept);
    std::partial_sort(sums.begin(), sums.begin() + ptrdiff_t(most), sums.end(), [](const Sum& a, const Sum& b) {
        return std::pair(b.triangles, a.caster) < std::pair(a.triangles, b.caster);
    });
    std::vector<CasterCost> costs;
    const world::CasterTable& table = impl_->scene.casters();
    for (size_t k = 0; k < most; ++k) {
        const world::Box& bounds = table[sums[k].caster].bounds;
        costs.push_back({table.describe(sums[k].caster), 0.5 * (bounds.min + bounds.max), sums[k].triangles, sums[k].draws});
    }
    return costs;
}

const world::MeshLevel& ShadowSystem::geometry(cache::GeometryId id) const { return impl_->scene.geometry(id); }

std::span<const cache::StoreRect> ShadowSystem::clearedRects(int cascade) const {
    CHECK(impl_->planned);
    const CascadeOf of = impl_->shown().of(cascade);
    return impl_->plan.cascades[of.cache.map(of.cascade)].clears;
}

std::span<const cache::Redrawn> ShadowSystem::redrawn(int cascade) const {
    const CascadeOf of = impl_->shown().of(cascade);
    return of.cache.redrawn(of.cascade);
}

std::vector<cache::TexelRect> ShadowSystem::activeRects(int cascade, size_t most) const {
    const CascadeOf of = impl_->shown().of(cascade);
    const cache::Scene scene = impl_->scene.view(0, false);
    std::vector<cache::TexelRect> rects;
    for (const world::CasterId caster : scene.active) {
        if (rects.size() == most) break;
        const cache::TexelRect rect = cache::intersection(
            cache::footprint(of.cache.lattice(of.cascade), scene.light[caster].bounds), of.cache.window(of.cascade));
        if (!rect.empty()) rects.push_back(rect);
    }
    return rects;
}

const world::CasterTable& ShadowSystem::casters() const { return impl_->scene.casters(); }

double ShadowSystem::chunkSize() const { return impl_->store.header().chunkSize; }

std::vector<ChunkPlace> ShadowSystem::chunks() const {
    const world::Streamer& streamer = impl_->scene.streamer();
    std::vector<ChunkPlace> places;
    for (uint32_t i = 0; i < impl_->store.chunks().size(); ++i)
        if (const world::ChunkPhase phase = streamer.phaseOf(i); phase != world::ChunkPhase::kAway)
            places.push_back({impl_->store.chunks()[i].key, phase});
    return places;
}

}  // namespace server
