#include "server/shadow_system.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <deque>
#include <glm/gtc/constants.hpp>

#include "cache/invalidation.h"
#include "culling/cascades.h"
#include "culling/light_space.h"
#include "server/resident_scene.h"
#include "server/terrain_edits.h"
#include "world/hash.h"

namespace server {

namespace {

using world::Error;
using world::ErrorCode;
using world::Result;

/// What lavapipe takes for a small triangle, to begin with; frames under a time budget correct it.
constexpr double kFirstMsPerTriangle = 1.0 / 7000;
constexpr size_t kFramesInFlight = 2;
/// A new sun's casters are fitted in a quarter of the time in which its maps are filled.
constexpr double kFitsPerFill = 4;
constexpr double kLargestLevelError = 64;  // [texels]
constexpr double kLargestSunStep = 0.2;  // [rad]
/// Weight of the latest frame in that correction.
constexpr double kRateGain = 0.25;

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

/// Pairs of maps that one sun needs: where the world can be longer along the light than a cascade's range of
/// depths, one more to move it.
size_t mapsFor(const world::WorldStore& store, const ShadowConfig& config, const std::vector<culling::Cascade>& cascades) {
    const world::Box& bounds = store.header().bounds;
    const double longest = glm::length(bounds.max - bounds.min);
    const bool moves = config.method == Method::kGnomon && std::any_of(cascades.begin(), cascades.end(), [&](const culling::Cascade& c) {
        return cache::longestRange(c, depthSteps(config.format)) < longest;
    });
    return cascades.size() + (moves ? 1 : 0);
}

std::vector<uint8_t> cascadesOf(const cache::FramePlan& plan) {
    std::vector<uint8_t> cascades;
    for (const cache::CascadePlan& maps : plan.cascades) cascades.push_back(uint8_t(maps.cascade));
    return cascades;
}

/// The times of maps as those of the cascades that they belonged to.
gpu::GpuTimes byCascade(const gpu::GpuTimes& maps, std::span<const uint8_t> cascadeOf, size_t cascades) {
    gpu::GpuTimes times = maps;
    times.cascades.assign(cascades, {});
    for (size_t m = 0; m < maps.cascades.size() && m < cascadeOf.size(); ++m) {
        times.cascades[cascadeOf[m]].staticMs += maps.cascades[m].staticMs;
        times.cascades[cascadeOf[m]].activeMs += maps.cascades[m].activeMs;
    }
    return times;
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
    if (!(config.levelError > 0 && config.levelError <= kLargestLevelError))
        return Error{ErrorCode::kUsage, "level error: give more than 0 and at most 64 texels"};
    if (!(config.smallestCaster >= 0 && std::isfinite(config.smallestCaster)))
        return Error{ErrorCode::kUsage, "smallest caster: give a number of texels, 0 or more"};
    return cascades;
}

double msSince(std::chrono::steady_clock::time_point start) {
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace

struct ShadowSystem::Impl {
    Impl(const world::WorldStore& worldStore, const ShadowConfig& c, std::unique_ptr<gpu::ShadowMaps> m,
         const culling::LightSpace& space, const std::vector<culling::Cascade>& lightCascades,
         world::WorldEditor* editor)
        : config(c),
          store(worldStore),
          maps(std::move(m)),
          cascades(lightCascades),
          mapsPerSun(mapsFor(store, c, cascades)),
          scene(store, *maps, space, cascades, sceneConfig(c)),
          spots(*maps, c.sabotage),
          edits(store, editor),
          motion(c.sunMotion, space.sun, c.method == Method::kGnomon),
          sunNow(space.sun) {
        suns.push_back(makeSun(space, 0, cache::Cause::kStart));
    }

    /// `place`: which of the two sets of maps it draws into.
    std::unique_ptr<Sun> makeSun(const culling::LightSpace& space, size_t place, cache::Cause begin) const;
    size_t placeOf(const Sun& sun) const { return sun.cache.config().firstMap / mapsPerSun; }
    size_t mapCount() const { return mapsPerSun * (config.movingSun ? 2 : 1); }
    const Sun& shown() const { return *suns.front(); }

    void moveSun(const FrameInput& input, FrameReport& report, SunMotion::Decision& decision);
    void redirect(const culling::LightSpace& space);
    void planNext(const cache::Demand& demand, double share, std::vector<cache::CascadeStatistics>& statistics);
    cache::Limits limits() const;
    Result<world::Done> takeEdits(FrameReport& report);
    Result<world::Done> learnRate(const FrameReport& report);
    void findGaps(double time, FrameReport& report);
    /// After a frame that was not drawn: what the maps hold is anybody's guess.
    Error lost(const Error& error) {
        for (auto& sun : suns) sun->cache.forget();
        spots.forget();
        scene.settle();
        return error;
    }

    ShadowConfig config;
    const world::WorldStore& store;
    std::unique_ptr<gpu::ShadowMaps> maps;
    std::vector<culling::Cascade> cascades;
    size_t mapsPerSun;
    ResidentScene scene;
    SpotLights spots;
    TerrainEdits edits;
    std::deque<std::shared_ptr<const world::EditedChunk>> untaken;  ///< edited, and not in the scene yet
    std::vector<std::unique_ptr<Sun>> suns;  ///< as the scene's sides: the one shown and, filling, the next
    SunMotion motion;
    glm::dvec3 sunNow;
    cache::FramePlan plan, redraw;
    std::vector<cache::RectSet> gaps;  ///< per cascade: texels of the shown window that a lacking chunk may shade
    cache::RectSet gap;                ///< scratch
    uint64_t frame = 0;
    uint64_t uploadedBefore = 0;
    bool planned = false;
    struct Submitted {
        gpu::Ticket ticket = 0;
        uint64_t triangles = 0;
    };
    std::deque<Submitted> underWay;  ///< frames that drew something and have not told their rate
    double msPerTriangle = kFirstMsPerTriangle;
};

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
    mapsConfig.cascades = int(mapsFor(store, filled, cascades.value())) * (filled.movingSun ? 2 : 1);
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
    cacheConfig.spareMap = mapsPerSun > cascades.size();
    cacheConfig.firstMap = place * mapsPerSun;
    cacheConfig.sabotage = config.sabotage;
    return std::make_unique<Sun>(Sun{space, cache::ShadowCache(cascades, cacheConfig), begin});
}

Result<ObjectId> ShadowSystem::adopt(const std::string& name) { return impl_->scene.adopt(name); }

Result<ObjectId> ShadowSystem::spawn(uint32_t mesh, const world::Placement& placement, const ObjectTraits& traits) {
    return impl_->scene.spawn(mesh, placement, traits);
}

Result<world::Done> ShadowSystem::remove(ObjectId object) { return impl_->scene.remove(object); }

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
    const size_t perSun = mapsFor(s.store, config, cascades.value());
    std::vector<int> from(cascades.value().size(), -1);  // per cascade
    std::vector<int> fromMaps(perSun * (config.movingSun ? 2 : 1), -1);
    for (size_t c = 0; c < from.size(); ++c) {
        const auto kept = std::find(s.cascades.begin(), s.cascades.end(), cascades.value()[c]);
        if (!sameTexels || kept == s.cascades.end()) continue;
        from[c] = int(kept - s.cascades.begin());
        fromMaps[c] = int(old.cache.map(from[c]));
    }
    auto refit = s.scene.refit(cascades.value(), sceneConfig(config), from);
    if (!refit) return refit.error();
    if (auto shaped = s.maps->reshape(fromMaps, config.side, config.format); !shaped) return shaped.error();

    s.scene.apply(std::move(refit.value()));
    s.config = config;
    s.cascades = std::move(cascades.value());
    s.mapsPerSun = perSun;
    auto sun = s.makeSun(old.space, 0, old.begin);
    for (size_t c = 0; c < from.size(); ++c)
        if (from[c] >= 0) sun->cache.adopt(int(c), old.cache, from[c]);
    s.suns.front() = std::move(sun);
    s.underWay.clear();
    s.planned = false;
    return world::Done{};
}

const world::Placement& ShadowSystem::restPlacement(ObjectId object) const {
    return impl_->scene.restPlacement(object);
}

Result<FrameReport> ShadowSystem::advance(const FrameInput& input) {
    Impl& s = *impl_;
    const glm::dvec3 p = input.camera.position;
    if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z) || !std::isfinite(input.time))
        return Error{ErrorCode::kUsage, "frame " + std::to_string(s.frame) + ": camera position or time is not finite"};
    const Camera& camera = input.camera;
    if (!(camera.verticalFov >= 0 && camera.verticalFov < glm::pi<double>() && camera.aspect > 0 &&
          std::isfinite(camera.aspect)))
        return Error{ErrorCode::kUsage, "frame " + std::to_string(s.frame) +
                                            ": camera: give a field of view in [0, pi) and an aspect above 0"};
    FrameReport report;
    report.frame = s.frame++;
    report.time = input.time;
    SunMotion::Decision decision;
    s.moveSun(input, report, decision);

    const auto editing = std::chrono::steady_clock::now();
    if (const auto taken = s.takeEdits(report); !taken) return s.lost(taken.error());
    const double editMs = msSince(editing);
    auto changed = s.scene.advance(input.time, p, input.ahead, input.objects);
    if (!changed) return s.lost(changed.error());
    SceneChanges& changes = changed.value();
    report.chunkArrivals = changes.chunkArrivals;
    report.chunkDepartures = changes.chunkDepartures;
    report.refinements = changes.refinements;
    report.bytesRead = changes.bytesRead;
    report.bytesAgain = changes.bytesAgain;
    report.residentBytes = s.scene.streamer().residentBytes();
    report.geometryBytes = s.scene.streamer().geometryBytes();
    report.rays = changes.certify.rays;
    report.certificates = changes.certify.certificates;
    report.revocations = changes.revocations;
    report.errors.insert(report.errors.end(), changes.errors.begin(), changes.errors.end());
    report.cpu.streamMs = editMs + changes.streamMs;
    report.cpu.setsMs = changes.setsMs;
    report.cpu.occlusionMs = changes.occlusionMs;

    const auto planning = std::chrono::steady_clock::now();
    const bool cached = s.config.method == Method::kGnomon;
    Sun& shown = *s.suns.front();
    if (!cached) {
        shown.cache.forget();
        s.spots.forget();
    }
    cache::Demand demand{shown.space.toLight(p), shown.begin, 0, {}};
    if (cached) {
        if (!s.motion.report().redrawn) demand.limits = s.limits();
        demand.asleep = s.scene.unseen({p, camera.orientation, camera.verticalFov, camera.aspect},
                                       demand.limits.limited());
    }
    report.limits = demand.limits;
    s.plan.reset(s.mapCount());
    shown.cache.plan(s.scene.view(0, cached), s.scene.events(0), demand, s.plan, report.cascades);
    if (s.suns.size() == 2 && s.scene.fitNext(kFitsPerFill * decision.share)) {
        demand.eye = s.suns[1]->space.toLight(p);
        s.planNext(demand, decision.share, report.cascades);
    }
    for (auto& sun : s.suns) sun->begin = cache::Cause::kStart;
    if (const auto planned = s.spots.plan(s.scene, report.spots); !planned) return s.lost(planned.error());
    s.scene.settle();
    s.findGaps(input.time, report);
    report.sun = s.motion.report();
    for (size_t c = 0; c < s.cascades.size(); ++c)
        report.cascades[c].sunError = std::tan(report.sun.lag) * cache::kSunHeight / s.cascades[c].texel;
    s.planned = true;
    report.cpu.planMs = msSince(planning);
    report.planHash = s.spots.planHash(s.plan.hash());

    const auto ticket = s.maps->submit(s.plan, s.spots.planned());
    if (!ticket) return s.lost(ticket.error());
    report.ticket = ticket.value();
    report.submitted = !s.plan.idle() || !s.spots.planned().idle();
    report.mapCascades = cascadesOf(s.plan);
    if (const auto learned = s.learnRate(report); !learned) return s.lost(learned.error());
    report.bytesUploaded = s.maps->uploadedBytes() - s.uploadedBefore;
    s.uploadedBefore = s.maps->uploadedBytes();
    return report;
}

/// Edits become visible here and nowhere else: all that were given.
Result<world::Done> ShadowSystem::Impl::takeEdits(FrameReport& report) {
    TerrainEdits::Finished finished = edits.take(config.streaming.clock != world::Clock::kLive);
    report.edits = finished.edits;
    report.errors.insert(report.errors.end(), finished.errors.begin(), finished.errors.end());
    untaken.insert(untaken.end(), finished.chunks.begin(), finished.chunks.end());
    for (; !untaken.empty(); untaken.pop_front())
        if (const auto changed = scene.changeTerrain(untaken.front()); !changed) return changed;
    return world::Done{};
}

/// Corrects the rate by a frame that has finished by now, since its place on the GPU was taken again. By
/// timestamps where there are any: the time at which its fence was seen depends on when somebody looked.
Result<world::Done> ShadowSystem::Impl::learnRate(const FrameReport& report) {
    uint64_t triangles = 0;
    for (const cache::CascadeStatistics& c : report.cascades) triangles += c.total.triangles;
    if (triangles == 0) return world::Done{};
    underWay.push_back({report.ticket, triangles});
    if (underWay.size() <= kFramesInFlight) return world::Done{};
    const auto [ticket, drawn] = underWay.front();
    underWay.pop_front();
    if (!maps->remembered(ticket)) return world::Done{};  // long ago: little was drawn in between
    const auto times = maps->finish(ticket);
    if (!times) return times.error();
    double ms = config.timestamps ? 0 : times.value().wallMs;
    for (const gpu::CascadeTimes& t : times.value().cascades) ms += t.staticMs + t.activeMs;
    msPerTriangle += kRateGain * (ms / double(drawn) - msPerTriangle);
    return world::Done{};
}

/// Where chunks that are not there, or too coarse, may shade the windows.
void ShadowSystem::Impl::findGaps(double time, FrameReport& report) {
    gaps.resize(cascades.size());
    for (cache::RectSet& rects : gaps) rects.clear();
    for (const world::Lack& lack : scene.lacking()) {
        ++(lack.absent ? report.missingChunks : report.coarseChunks);
        report.longestLack = std::max(report.longestLack, time - lack.since);
    }
    if (scene.lacking().empty() || config.sabotage == cache::Sabotage::kSilentLack) return;
    const Sun& sun = shown();
    for (size_t c = 0; c < cascades.size(); ++c) {
        if (!sun.cache.drawn(int(c))) continue;
        for (const bool absent : {true, false}) {
            gap.clear();
            for (const world::Lack& lack : scene.lacking()) {
                if (lack.absent != absent) continue;
                if (!absent && lack.error <= config.levelError * cascades[c].texel) continue;
                const world::Box light = sun.space.toLight(scene.streamer().boundsOf(lack.record));
                gap.add(cache::intersection(cache::footprint(sun.cache.lattice(int(c)), light), sun.cache.window(int(c))));
            }
            cache::CascadeStatistics& statistics = report.cascades[c];
            (absent ? statistics.missingTexels : statistics.coarseTexels) = static_cast<uint64_t>(gap.area());
            for (const cache::TexelRect& rect : gap.rects()) gaps[c].add(rect);
        }
    }
}

Result<world::Done> ShadowSystem::finish(FrameReport& report) {
    if (!impl_->maps->remembered(report.ticket))
        return Error{ErrorCode::kUsage, "frame " + std::to_string(report.frame) + ": too long ago to ask what the GPU took"};
    auto times = impl_->maps->finish(report.ticket);
    if (!times) return impl_->lost(times.error());
    report.gpu = byCascade(times.value(), report.mapCascades, report.cascades.size());
    report.cpu.recordMs = report.gpu.recordMs;
    return world::Done{};
}

/// Shows the next sun if it is ready, and makes room for the one that the frame asks for.
void ShadowSystem::Impl::moveSun(const FrameInput& input, FrameReport& report, SunMotion::Decision& decision) {
    if (suns.size() == 2 && motion.showNext(input.time, suns[1]->cache.complete())) {
        scene.showNext();
        suns.erase(suns.begin());
    }
    if (!config.movingSun) {
        if (input.sun != glm::dvec3(0))
            report.errors.push_back({ErrorCode::kUsage, "sun: it stands still; make the system with a moving sun"});
        return;
    }
    if (input.sun != glm::dvec3(0)) {
        if (const auto space = culling::makeLightSpace(input.sun)) sunNow = space.value().sun;
        else report.errors.push_back(space.error());  // and the sun stays where it was
    }
    decision = motion.decide(input.time, sunNow);
    if (decision.dropNext) {
        scene.dropNext();
        suns.pop_back();
    }
    if (decision.action == SunMotion::Action::kNone) return;
    const culling::LightSpace space = culling::makeLightSpace(decision.direction).value();
    if (decision.action == SunMotion::Action::kRedraw) {
        redirect(space);
    } else {
        scene.openNext(space);
        const bool mixed = config.sabotage == cache::Sabotage::kMixedSuns;
        suns.push_back(makeSun(space, placeOf(shown()) ^ (mixed ? 0 : 1), cache::Cause::kSun));
    }
}

/// The shown maps start anew in another direction.
void ShadowSystem::Impl::redirect(const culling::LightSpace& space) {
    scene.openNext(space);
    scene.fitNext(1);
    scene.showNext();
    suns.front() = makeSun(space, placeOf(shown()), cache::Cause::kSun);
}

/// Fills the next sun's maps with a share of all texels, within what the shown ones left of the limits. All
/// of it has one cause: the sun.
void ShadowSystem::Impl::planNext(const cache::Demand& demand, double share,
                                  std::vector<cache::CascadeStatistics>& statistics) {
    cache::Demand next = demand;
    next.begin = suns[1]->begin;
    next.asleep = 0;  // it must be whole before it is shown
    cache::Cost spent;
    for (const cache::CascadeStatistics& s : statistics) spent += s.total;
    const double texels = double(cascades.size()) * config.side * config.side;
    next.limits = demand.limits.less(spent);
    // Once it is complete it keeps up like the shown one.
    if (!suns[1]->cache.complete())
        next.limits.texels = std::min(next.limits.texels, std::max<uint64_t>(1, uint64_t(std::ceil(share * texels))));
    std::vector<cache::CascadeStatistics> more;
    suns[1]->cache.plan(scene.view(1, true), scene.events(1), next, plan, more);
    for (size_t c = 0; c < cascades.size(); ++c) statistics[c].addFor(cache::Cause::kSun, more[c]);
}

cache::Limits ShadowSystem::Impl::limits() const {
    cache::Limits limits{config.budget.texels, config.budget.triangles};
    if (config.budget.ms > 0)
        limits.triangles = std::min(limits.triangles, std::max<uint64_t>(1, uint64_t(config.budget.ms / msPerTriangle)));
    return limits;
}

RedrawCosts ShadowSystem::redrawCosts() const {
    CHECK(impl_->planned);
    std::vector<cache::CascadeStatistics> statistics;
    impl_->redraw.reset(impl_->mapCount());
    impl_->shown().cache.planRedraw(impl_->scene.view(0, false), impl_->redraw, statistics);
    RedrawCosts costs;
    for (const cache::CascadeStatistics& s : statistics) costs.push_back(s.total);
    return costs;
}

Result<VerifyReport> ShadowSystem::verify() {
    Impl& s = *impl_;
    CHECK(s.planned);
    s.redraw.reset(s.mapCount());
    auto report = server::verify(*s.maps, s.scene, s.suns, s.redraw);
    if (report) {
        report.value().redraw = byCascade(report.value().redraw, cascadesOf(s.redraw), s.cascades.size());
        if (const auto done = s.spots.verify(s.scene, report.value()); !done) return done.error();
    }
    s.uploadedBefore = s.maps->uploadedBytes();
    return report;
}

CascadeView ShadowSystem::view(int cascade, SunMaps which) const {
    CHECK(size_t(which) < impl_->suns.size());
    return viewOf(*impl_->suns[size_t(which)], cascade);
}

int ShadowSystem::cascades() const { return static_cast<int>(impl_->cascades.size()); }
const ShadowConfig& ShadowSystem::config() const { return impl_->config; }

Result<std::vector<float>> ShadowSystem::readMap(int cascade, gpu::MapKind kind, SunMaps which) {
    CHECK(size_t(which) < impl_->suns.size());
    return impl_->maps->read(int(impl_->suns[size_t(which)]->cache.map(cascade)), kind);
}

std::vector<TexelState> ShadowSystem::texelStates(int cascade, gpu::MapKind kind) const {
    const auto c = size_t(cascade);
    return server::texelStates(impl_->shown(), cascade, kind,
                               c < impl_->gaps.size() ? impl_->gaps[c].rects() : std::span<const cache::TexelRect>());
}

Result<std::vector<PointAnswer>> ShadowSystem::lookup(std::span<const glm::dvec3> points, const LookupBias& bias) {
    return server::lookup(*impl_->maps, impl_->shown(), impl_->gaps, points, bias);
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

const world::MeshLevel& ShadowSystem::geometry(cache::GeometryId id) const { return impl_->scene.geometry(id); }

std::span<const cache::StoreRect> ShadowSystem::clearedRects(int cascade) const {
    CHECK(impl_->planned);
    return impl_->plan.cascades[impl_->shown().cache.map(cascade)].clears;
}

}  // namespace server
