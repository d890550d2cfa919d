#include "server/shadow_system.h"

#include <algorithm>
#include <bit>
#include <chrono>
#include <cmath>
#include <glm/gtc/constants.hpp>

#include "culling/cascades.h"
#include "culling/light_space.h"
#include "server/resident_scene.h"
#include "world/hash.h"

namespace server {

namespace {

using world::Error;
using world::ErrorCode;
using world::Result;

constexpr size_t kReported = 8;  ///< differences and casters that a verification lists

/// What lavapipe takes for a small triangle, to begin with; frames under a time budget correct it.
constexpr double kFirstMsPerTriangle = 1.0 / 7000;
constexpr double kLargestSunStep = 0.2;  // [rad]
/// Beyond this a point [m] is in no window, and no texel could be counted for it.
constexpr double kFarthestPoint = 1e9;
/// Weight of the latest frame in that correction.
constexpr double kRateGain = 0.25;

/// What a texel of a stored map is worth, for verification and lookups.
enum State : uint8_t { kValid, kStaleTexel, kUnknownTexel };

Result<world::Done> requireBudget(const Budget& budget) {
    if (budget.texels == 0 || budget.triangles == 0)
        return Error{ErrorCode::kUsage, "budget: nothing could ever be drawn; give at least 1 texel or triangle"};
    if (!std::isfinite(budget.ms) || budget.ms < 0)
        return Error{ErrorCode::kUsage, "budget: " + std::to_string(budget.ms) + " ms; give a time of 0 or more"};
    return world::Done{};
}

double msSince(std::chrono::steady_clock::time_point start) {
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace

/// One direction of the sun and what its maps hold.
struct Sun {
    culling::LightSpace space;
    cache::ShadowCache cache;
    cache::Cause begin = cache::Cause::kStart;  ///< of its first drawing
};

struct ShadowSystem::Impl {
    Impl(const world::WorldStore& worldStore, const ShadowConfig& c, std::unique_ptr<gpu::ShadowMaps> m,
         const culling::LightSpace& space, const std::vector<culling::Cascade>& lightCascades)
        : config(c),
          store(worldStore),
          maps(std::move(m)),
          cascades(lightCascades),
          scene(store, *maps, space, cascades,
                {c.farDistance, c.occlusion, c.raysPerCluster, c.restSeconds, c.promotionsPerFrame, c.residentBytes,
                 c.side, c.guardBand, c.smallestCaster, c.sabotage == cache::Sabotage::kStickyCertificate}),
          motion(c.sunMotion, space.sun, c.method == Method::kGnomon),
          sunNow(space.sun) {
        suns.push_back(makeSun(space, 0, cache::Cause::kStart));
    }

    /// `place`: which of the two sets of maps it draws into.
    std::unique_ptr<Sun> makeSun(const culling::LightSpace& space, size_t place, cache::Cause begin) const;
    size_t placeOf(const Sun& sun) const { return sun.cache.config().firstMap / cascades.size(); }
    /// All maps of all suns.
    size_t mapCount() const { return cascades.size() * (config.movingSun ? 2 : 1); }
    const Sun& shown() const { return *suns.front(); }

    void moveSun(const FrameInput& input, FrameReport& report, SunMotion::Decision& decision);
    void redirect(const culling::LightSpace& space);
    bool nextComplete() const;
    void planNext(const cache::Demand& demand, double share, std::vector<cache::CascadeStatistics>& statistics);
    Result<uint64_t> compare(size_t side, int cascade, gpu::MapKind cached, gpu::MapKind redrawn, VerifyReport& report);
    std::vector<std::string> castersAt(size_t side, int cascade, cache::Texel texel) const;
    cache::Limits limits() const;
    std::vector<uint8_t> states(const Sun& sun, int cascade, gpu::MapKind map) const;
    int slot(const Sun& sun, int cascade) const { return int(sun.cache.config().firstMap) + cascade; }
    /// After a frame that was not drawn: what the maps hold is anybody's guess.
    Error lost(const Error& error) {
        for (auto& sun : suns) sun->cache.forget();
        scene.settle();
        return error;
    }

    ShadowConfig config;
    const world::WorldStore& store;
    std::unique_ptr<gpu::ShadowMaps> maps;
    std::vector<culling::Cascade> cascades;
    ResidentScene scene;
    std::vector<std::unique_ptr<Sun>> suns;  ///< as the scene's sides: the one shown and, filling, the next
    SunMotion motion;
    glm::dvec3 sunNow;
    cache::FramePlan plan, redraw;
    uint64_t frame = 0;
    uint64_t uploadedBefore = 0;
    bool planned = false;
    double msPerTriangle = kFirstMsPerTriangle;
};

ShadowSystem::ShadowSystem(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
ShadowSystem::~ShadowSystem() = default;

Result<std::unique_ptr<ShadowSystem>> ShadowSystem::create(gpu::Device& device, const world::WorldStore& store,
                                                           const ShadowConfig& config) {
    ShadowConfig filled = config;
    if (filled.sun == glm::dvec3(0)) filled.sun = store.header().sun;
    if (filled.sun == glm::dvec3(0))
        return Error{ErrorCode::kUsage, store.path() + ": the world names no sun; give --sun AZIMUTH,ELEVATION"};
    auto space = culling::makeLightSpace(filled.sun);
    if (!space) return space.error();
    auto cascades = culling::makeCascades(filled.cascades, filled.side, filled.farDistance, filled.splitRatio,
                                          filled.guardBand);
    if (!cascades) return cascades.error();
    if (!(filled.restSeconds >= 0))
        return Error{ErrorCode::kUsage, "rest time: " + std::to_string(filled.restSeconds) + " s; give 0 or more"};
    if (!(filled.smallestCaster >= 0 && std::isfinite(filled.smallestCaster)))
        return Error{ErrorCode::kUsage, "smallest caster: give a number of texels, 0 or more"};
    if (auto budget = requireBudget(filled.budget); !budget) return budget.error();
    if (store.chunks().empty() || store.header().bounds.empty())
        return Error{ErrorCode::kBadData, store.path() + ": nothing in it casts a shadow; bake a source that has casters"};

    const SunMotionConfig& motion = filled.sunMotion;
    if (!(motion.step > 0 && motion.step <= kLargestSunStep && motion.blendSeconds >= 0 &&
          std::isfinite(motion.blendSeconds)))
        return Error{ErrorCode::kUsage, "sun: give steps above 0 and up to 0.2 radians, and a blend of 0 seconds or more"};

    const int count = filled.cascades * (filled.movingSun ? 2 : 1);
    gpu::ShadowMapsConfig mapsConfig;
    mapsConfig.cascades = count;
    mapsConfig.side = filled.side;
    mapsConfig.geometryBytes = filled.geometryBytes;
    mapsConfig.format = filled.format;
    mapsConfig.timestamps = filled.timestamps;
    auto maps = gpu::ShadowMaps::create(device, mapsConfig);
    if (!maps) return maps.error();
    return std::unique_ptr<ShadowSystem>(new ShadowSystem(
        std::make_unique<Impl>(store, filled, std::move(maps.value()), space.value(), cascades.value())));
}

std::unique_ptr<Sun> ShadowSystem::Impl::makeSun(const culling::LightSpace& space, size_t place,
                                                 cache::Cause begin) const {
    // Depth is anchored to the world, not the camera: a texel's depth never has to change.
    const world::Box extent = space.toLight(store.header().bounds);
    cache::CacheConfig cacheConfig;
    cacheConfig.side = config.side;
    cacheConfig.guardBand = config.guardBand;
    cacheConfig.depthNear = extent.min.z;
    cacheConfig.depthRange = std::max(1.0, extent.max.z - extent.min.z);
    cacheConfig.firstMap = place * cascades.size();
    cacheConfig.sabotage = config.sabotage;
    return std::make_unique<Sun>(Sun{space, cache::ShadowCache(cascades, cacheConfig), begin});
}

Result<ObjectId> ShadowSystem::adopt(const std::string& name) { return impl_->scene.adopt(name); }

Result<ObjectId> ShadowSystem::spawn(uint32_t mesh, const world::Placement& placement, const ObjectTraits& traits) {
    return impl_->scene.spawn(mesh, placement, traits);
}

Result<world::Done> ShadowSystem::remove(ObjectId object) { return impl_->scene.remove(object); }

Result<world::Done> ShadowSystem::setBudget(const Budget& budget) {
    if (auto good = requireBudget(budget); !good) return good.error();
    impl_->config.budget = budget;
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

    auto changed = s.scene.advance(input.time, p, input.objects);
    if (!changed) return s.lost(changed.error());
    SceneChanges& changes = changed.value();
    report.chunkArrivals = changes.chunkArrivals;
    report.chunkDepartures = changes.chunkDepartures;
    report.bytesRead = changes.bytesRead;
    report.rays = changes.certify.rays;
    report.certificates = changes.certify.certificates;
    report.revocations = changes.revocations;
    report.errors.insert(report.errors.end(), changes.errors.begin(), changes.errors.end());
    report.cpu.streamMs = changes.streamMs;
    report.cpu.setsMs = changes.setsMs;
    report.cpu.occlusionMs = changes.occlusionMs;

    const auto planning = std::chrono::steady_clock::now();
    const bool cached = s.config.method == Method::kGnomon;
    Sun& shown = *s.suns.front();
    if (!cached) shown.cache.forget();
    cache::Demand demand{glm::dvec2(shown.space.toLight(p)), shown.begin, 0, {}};
    if (cached) {
        if (!s.motion.report().redrawn) demand.limits = s.limits();
        demand.asleep = s.scene.unseen({p, camera.orientation, camera.verticalFov, camera.aspect},
                                       demand.limits.limited());
    }
    report.limits = demand.limits;
    s.plan.reset(s.mapCount());
    shown.cache.plan(s.scene.view(0, cached), s.scene.events(0), demand, s.plan, report.cascades);
    if (s.suns.size() == 2) {
        demand.eye = glm::dvec2(s.suns[1]->space.toLight(p));
        s.planNext(demand, decision.share, report.cascades);
    }
    for (auto& sun : s.suns) sun->begin = cache::Cause::kStart;
    s.scene.settle();
    report.sun = s.motion.report();
    for (size_t c = 0; c < s.cascades.size(); ++c)
        report.cascades[c].sunError = std::tan(report.sun.lag) * cache::kSunHeight / s.cascades[c].texel;
    s.planned = true;
    report.cpu.planMs = msSince(planning);
    report.planHash = s.plan.hash();

    auto times = s.maps->execute(s.plan);
    if (!times) return s.lost(times.error());
    report.gpu = std::move(times.value());
    uint64_t triangles = 0;
    for (const cache::CascadeStatistics& c : report.cascades) triangles += c.total.triangles;
    if (triangles > 0)
        s.msPerTriangle += kRateGain * (report.gpu.wallMs / double(triangles) - s.msPerTriangle);
    report.cpu.recordMs = report.gpu.recordMs;
    report.bytesUploaded = s.maps->uploadedBytes() - s.uploadedBefore;
    s.uploadedBefore = s.maps->uploadedBytes();
    return report;
}

/// Shows the next sun if it is ready, and makes room for the one that the frame asks for.
void ShadowSystem::Impl::moveSun(const FrameInput& input, FrameReport& report, SunMotion::Decision& decision) {
    if (suns.size() == 2 && motion.showNext(input.time, nextComplete())) {
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
    scene.showNext();
    suns.front() = makeSun(space, placeOf(shown()), cache::Cause::kSun);
}

bool ShadowSystem::Impl::nextComplete() const {
    for (size_t c = 0; c < cascades.size(); ++c)
        if (!suns[1]->cache.drawn(int(c)) || !suns[1]->cache.owed(int(c)).empty()) return false;
    return true;
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
    const auto left = [](uint64_t limit, uint64_t used) {
        return limit == cache::Limits::kNone ? limit : limit - std::min(limit, used);
    };
    const double texels = double(cascades.size()) * config.side * config.side;
    next.limits.triangles = left(demand.limits.triangles, spent.triangles);
    next.limits.texels = left(demand.limits.texels, spent.texels);
    // Once it is complete it keeps up like the shown one.
    if (!nextComplete())
        next.limits.texels = std::min(next.limits.texels, std::max<uint64_t>(1, uint64_t(std::ceil(share * texels))));
    std::vector<cache::CascadeStatistics> more;
    suns[1]->cache.plan(scene.view(1, true), scene.events(1), next, plan, more);
    for (size_t c = 0; c < cascades.size(); ++c) {
        statistics[c].byCause[size_t(cache::Cause::kSun)] += more[c].total;
        statistics[c].total += more[c].total;
        statistics[c].active += more[c].active;
        statistics[c].clustersFound += more[c].clustersFound;
    }
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
    std::vector<cache::CascadeStatistics> statistics;
    s.redraw.reset(s.mapCount());
    for (size_t side = 0; side < s.suns.size(); ++side)
        s.suns[side]->cache.planRedraw(s.scene.view(side, false), s.redraw, statistics);
    auto times = s.maps->redraw(s.redraw);
    if (!times) return times.error();
    s.uploadedBefore = s.maps->uploadedBytes();
    VerifyReport report;
    report.redraw = std::move(times.value());
    for (size_t side = 0; side < s.suns.size(); ++side) {
        for (int c = 0; c < cascades(); ++c) {
            if (!s.suns[side]->cache.drawn(c)) continue;
            auto cache = s.compare(side, c, gpu::MapKind::kCache, gpu::MapKind::kScratchCache, report);
            if (!cache) return cache.error();
            auto working = s.compare(side, c, gpu::MapKind::kWorking, gpu::MapKind::kScratchWorking, report);
            if (!working) return working.error();
            report.differing += cache.value() + working.value();
        }
    }
    return report;
}

/// Per stored texel of a map.
std::vector<uint8_t> ShadowSystem::Impl::states(const Sun& sun, int cascade, gpu::MapKind map) const {
    const cache::ShadowCache& shadows = sun.cache;
    const cache::Lattice& lattice = shadows.lattice(cascade);
    std::vector<uint8_t> states(size_t(lattice.side * lattice.side), kValid);
    const auto paint = [&](const cache::TexelRect& rect, State state) {
        for (int64_t y = rect.min.y; y < rect.max.y; ++y)
            for (int64_t x = rect.min.x; x < rect.max.x; ++x) {
                const cache::Texel slot = lattice.slot({x, y});
                states[size_t(slot.y * lattice.side + slot.x)] = state;
            }
    };
    if (map == gpu::MapKind::kWorking)
        for (const cache::TexelRect& rect : shadows.slept(cascade)) paint(rect, kStaleTexel);
    for (const cache::OwedRegion& region : shadows.owed(cascade))
        paint(region.rect, region.owes == cache::Owes::kUnknown ? kUnknownTexel : kStaleTexel);
    return states;
}

Result<uint64_t> ShadowSystem::Impl::compare(size_t side, int cascade, gpu::MapKind cached, gpu::MapKind redrawn,
                                             VerifyReport& report) {
    const Sun& sun = *suns[side];
    auto a = maps->read(slot(sun, cascade), cached);
    if (!a) return a.error();
    auto b = maps->read(slot(sun, cascade), redrawn);
    if (!b) return b.error();
    const std::vector<float>&held = a.value(), &truth = b.value();
    const std::vector<uint8_t> state = states(sun, cascade, cached);
    uint64_t differing = 0;
    const cache::Lattice& lattice = sun.cache.lattice(cascade);
    const cache::Texel low = sun.cache.window(cascade).min;
    for (size_t i = 0; i < held.size(); ++i) {
        if (state[i] == kStaleTexel) {
            ++report.stale;
            continue;
        }
        ++report.texels;
        const float right = state[i] == kUnknownTexel ? cache::kUnknownDepth : truth[i];
        if (std::bit_cast<uint32_t>(held[i]) == std::bit_cast<uint32_t>(right)) continue;
        ++differing;
        if (report.first.size() == kReported) continue;
        const auto at = static_cast<int64_t>(i);
        const cache::Texel stored(at % lattice.side, at / lattice.side);
        const cache::Texel texel = low + lattice.slot(stored - low);
        report.first.push_back({cascade, cached, texel, held[i], right, castersAt(side, cascade, texel)});
    }
    return differing;
}

std::vector<std::string> ShadowSystem::Impl::castersAt(size_t side, int cascade, cache::Texel texel) const {
    const double t = suns[side]->cache.lattice(cascade).texel;
    const glm::dvec2 min = (glm::dvec2(texel) - 1.0) * t, max = (glm::dvec2(texel) + 2.0) * t;
    std::vector<std::string> names;
    const world::CasterTable& table = scene.casters();
    for (world::CasterId id = 0; id < table.slots() && names.size() < kReported; ++id) {
        if (table[id].state == world::CasterState::kFree) continue;
        const world::Box& b = scene.light(side)[id].bounds;
        if (b.min.x <= max.x && b.max.x >= min.x && b.min.y <= max.y && b.max.y >= min.y)
            names.push_back(table.describe(id));
    }
    return names;
}

CascadeView ShadowSystem::view(int cascade, SunMaps which) const {
    const Impl& s = *impl_;
    CHECK(size_t(which) < s.suns.size());
    const Sun& sun = *s.suns[size_t(which)];
    const culling::Cascade& c = s.cascades[size_t(cascade)];
    const cache::CacheConfig& config = sun.cache.config();
    // Stored depths of casters begin at kNearestDepth.
    const double range = config.depthRange / (1.0 - cache::kNearestDepth);
    return {c.texel, c.split, sun.cache.window(cascade).min, config.depthNear - cache::kNearestDepth * range, range,
            sun.cache.drawn(cascade), sun.space.lightFromWorld};
}

int ShadowSystem::cascades() const { return static_cast<int>(impl_->cascades.size()); }
const ShadowConfig& ShadowSystem::config() const { return impl_->config; }

Result<std::vector<float>> ShadowSystem::readMap(int cascade, gpu::MapKind kind, SunMaps which) {
    CHECK(size_t(which) < impl_->suns.size());
    return impl_->maps->read(impl_->slot(*impl_->suns[size_t(which)], cascade), kind);
}

Result<std::vector<PointAnswer>> ShadowSystem::lookup(std::span<const glm::dvec3> points, const LookupBias& bias) {
    Impl& s = *impl_;
    std::vector<PointAnswer> answers(points.size());
    const Sun& sun = s.shown();
    for (int c = 0; c < cascades(); ++c) {
        if (!sun.cache.drawn(c)) continue;
        const cache::Lattice& lattice = sun.cache.lattice(c);
        const cache::TexelRect window = sun.cache.window(c);
        const CascadeView map = view(c);
        std::vector<float> depths;  // read only if a point asks for it
        std::vector<uint8_t> states;
        for (size_t i = 0; i < points.size(); ++i) {
            if (answers[i].cascade >= 0) continue;
            const glm::dvec3 p = sun.space.toLight(points[i]);
            if (!(glm::length(p) <= kFarthestPoint)) continue;
            const cache::Texel texel = lattice.texelAt(glm::dvec2(p));
            if (!window.contains({texel, texel + int64_t(1)})) continue;
            if (depths.empty()) {
                auto read = readMap(c, gpu::MapKind::kWorking);
                if (!read) return read.error();
                depths = std::move(read.value());
                states = s.states(sun, c, gpu::MapKind::kWorking);
            }
            const cache::Texel slot = lattice.slot(texel);
            const auto at = size_t(slot.y * lattice.side + slot.x);
            if (depths[at] == cache::kUnknownDepth) {  // the next coarser cascade may know
                answers[i].fell = true;
                continue;
            }
            const double caster = map.depthNear + map.depthRange * double(depths[at]);
            const bool shadowed = depths[at] < cache::kEmptyDepth && caster + bias.texels * lattice.texel + bias.metres < p.z;
            answers[i] = {shadowed ? Light::kShadowed : Light::kLit, int8_t(c), answers[i].fell, states[at] == kStaleTexel};
        }
    }
    return answers;
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
    return impl_->plan.cascades[size_t(impl_->slot(impl_->shown(), cascade))].clears;
}

}  // namespace server
