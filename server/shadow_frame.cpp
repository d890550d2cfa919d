// server/shadow_frame.cpp — one frame of a ShadowSystem, from what it is given to what the GPU draws.

#include <algorithm>
#include <cmath>
#include <glm/gtc/constants.hpp>

#include "cache/invalidation.h"
#include "culling/light_space.h"
#include "server/shadow_system_impl.h"
#include "server/stopwatch.h"

namespace server {

namespace {

using world::Error;
using world::ErrorCode;
using world::Result;

/// A new sun's casters are fitted in a quarter of the time in which its maps are filled.
constexpr double kFitsPerFill = 4;
/// Weight of the latest frame in the rate by which time is counted in triangles.
constexpr double kRateGain = 0.25;

/// [m]: beyond it texels could not be counted in 64 bits. Casters end a tenth as far.
constexpr double kFarthestEye = 1e9;

cache::Cost spentOn(std::span<const cache::CascadeStatistics> statistics) {
    cache::Cost spent;
    for (const cache::CascadeStatistics& s : statistics) spent += s.total;
    return spent;
}

}  // namespace

gpu::GpuTimes byCascade(const gpu::GpuTimes& maps, std::span<const uint8_t> cascadeOf, size_t cascades) {
    gpu::GpuTimes times = maps;
    times.cascades.assign(cascades, {});
    for (size_t m = 0; m < maps.cascades.size() && m < cascadeOf.size(); ++m) {
        times.cascades[cascadeOf[m]].staticMs += maps.cascades[m].staticMs;
        times.cascades[cascadeOf[m]].activeMs += maps.cascades[m].activeMs;
    }
    return times;
}

Result<world::Done> ShadowSystem::Impl::takeCameras(const FrameInput& input) {
    const auto wrong = [this](const std::string& what) {
        return Error{ErrorCode::kUsage, "frame " + std::to_string(frame) + ": " + what};
    };
    if (!std::isfinite(input.time)) return wrong("its time is not finite; give seconds");
    const size_t given = 1 + input.others.size();
    if (given != size_t(config.cameras))
        return wrong(std::to_string(given) + " cameras; give " + std::to_string(config.cameras) +
                     ", as many as its maps are made for");
    cameras.assign(1, input.camera);
    cameras.insert(cameras.end(), input.others.begin(), input.others.end());
    eyes.clear();
    for (size_t k = 0; k < cameras.size(); ++k) {
        const Camera& camera = cameras[k];
        const glm::dvec3 p = camera.position;
        const std::string name = "camera " + std::to_string(k) + ": ";
        if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z))
            return wrong(name + "its position is not finite; give metres");
        if (glm::any(glm::greaterThan(glm::abs(p), glm::dvec3(kFarthestEye))))
            return wrong(name + "its position is farther than 1e9 m from the origin; texels could not be counted there");
        const double turn = glm::length(camera.orientation);
        if (!(turn > 0.99 && turn < 1.01)) return wrong(name + "its orientation is no rotation; give a unit quaternion");
        if (!(camera.verticalFov >= 0 && camera.verticalFov < glm::pi<double>() && camera.aspect > 0 &&
              std::isfinite(camera.aspect)))
            return wrong(name + "give a field of view in [0, pi) and an aspect above 0");
        eyes.push_back({p, camera.ahead});
    }
    return world::Done{};
}

Result<FrameReport> ShadowSystem::advance(const FrameInput& input) {
    Impl& s = *impl_;
    if (const auto taken = s.takeCameras(input); !taken) return taken.error();
    FrameReport report;
    report.begin = std::chrono::steady_clock::now();
    report.frame = s.frame++;
    report.time = input.time;
    SunMotion::Decision decision;
    s.moveSun(input, report, decision);

    const Stopwatch editing;
    if (const auto taken = s.takeEdits(report); !taken) return s.lost(taken.error());
    const double editMs = editing.ms();
    auto changed = s.scene.advance(input.time, s.eyes, input.objects);
    if (!changed) return s.lost(changed.error());
    SceneChanges& changes = changed.value();
    report.chunkArrivals = changes.chunkArrivals;
    report.chunkDepartures = changes.chunkDepartures;
    report.refinements = changes.refinements;
    report.reads = std::move(changes.reads);
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

    const Stopwatch planning;
    const bool cached = s.config.method == Method::kGnomon;
    if (!cached) {
        s.suns.front()->forget();
        s.spots.forget();
    }
    if (cached && !s.motion.report().redrawn) report.limits = s.limits();
    s.plan.reset(s.mapCount());
    s.planShown(report);
    if (s.suns.size() == 2 && s.scene.fitNext(kFitsPerFill * decision.share)) s.planNext(decision.share, report);
    for (auto& sun : s.suns) sun->begin = cache::Cause::kStart;
    if (const auto planned = s.spots.plan(s.scene, report.spots); !planned) return s.lost(planned.error());
    s.scene.settle();
    s.findGaps(input.time, report);
    report.sun = s.motion.report();
    for (size_t n = 0; n < report.cascades.size(); ++n)
        report.cascades[n].sunError =
            std::tan(report.sun.lag) * cache::kSunHeight / s.cascades[n % s.cascades.size()].texel;
    s.planned = true;
    report.cpu.planMs = planning.ms();
    report.planHash = s.spots.planHash(s.plan.hash());

    const auto ticket = s.maps->submit(s.plan, s.spots.planned());
    if (!ticket) return s.lost(ticket.error());
    report.ticket = ticket.value();
    report.cpu.recordMs = s.maps->recordMs(report.ticket);
    report.submitted = !s.plan.idle() || !s.spots.planned().idle();
    report.mapCascades = s.cascadesOf(s.plan);
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
/// timestamps where there are any: the time at which its fence was seen depends on when somebody looked. Without them
/// only frames of a budget in time count, which whoever gives one waits for.
Result<world::Done> ShadowSystem::Impl::learnRate(const FrameReport& report) {
    const uint64_t triangles = spentOn(report.cascades).triangles;
    if (triangles == 0 || (!config.timestamps && config.budget.ms == 0)) return world::Done{};
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
    gaps.resize(report.cascades.size());
    for (cache::RectSet& rects : gaps) rects.clear();
    for (const world::Lack& lack : scene.lacking()) {
        ++(lack.absent ? report.missingChunks : report.coarseChunks);
        report.longestLack = std::max(report.longestLack, time - lack.since);
    }
    if (scene.lacking().empty() || config.sabotage == cache::Sabotage::kSilentLack) return;
    const Sun& sun = shown();
    for (size_t n = 0; n < gaps.size(); ++n) {
        const auto [held, c] = sun.of(int(n));
        if (!held.drawn(c)) continue;
        for (const bool absent : {true, false}) {
            gap.clear();
            for (const world::Lack& lack : scene.lacking()) {
                if (lack.absent != absent) continue;
                if (!absent && lack.error <= config.levelError * held.lattice(c).texel) continue;
                const world::Box light = sun.space.toLight(scene.streamer().boundsOf(lack.record));
                gap.add(cache::intersection(cache::footprint(held.lattice(c), light), held.window(c)));
            }
            cache::CascadeStatistics& counted = report.cascades[n];
            (absent ? counted.missingTexels : counted.coarseTexels) = static_cast<uint64_t>(gap.area());
            for (const cache::TexelRect& rect : gap.rects()) gaps[n].add(rect);
        }
    }
}

Result<world::Done> ShadowSystem::finish(FrameReport& report) {
    if (!impl_->maps->remembered(report.ticket))
        return Error{ErrorCode::kUsage, "frame " + std::to_string(report.frame) + ": too long ago to ask what the GPU took"};
    auto times = impl_->maps->finish(report.ticket);
    if (!times) return impl_->lost(times.error());
    report.gpu = byCascade(times.value(), report.mapCascades, report.cascades.size());
    return world::Done{};
}

/// Shows the next sun if it is ready, and makes room for the one that the frame asks for.
void ShadowSystem::Impl::moveSun(const FrameInput& input, FrameReport& report, SunMotion::Decision& decision) {
    if (suns.size() == 2 && motion.showNext(input.time, suns[1]->complete())) {
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

/// Each camera gets an equal part of what is left; who comes first, and finds most, takes turns.
void ShadowSystem::Impl::planShown(FrameReport& report) {
    Sun& sun = *suns.front();
    const bool cached = config.method == Method::kGnomon;
    cache::Limits left = report.limits;
    report.cascades.resize(cameras.size() * cascades.size());
    for (size_t done = 0; done < cameras.size(); ++done) {
        const size_t k = (report.frame + done) % cameras.size();
        const Camera& camera = cameras[k];
        cache::Demand demand{sun.space.toLight(camera.position), sun.begin, 0, left.part(cameras.size() - done)};
        if (cached)
            demand.asleep = scene.unseen({camera.position, camera.orientation, camera.verticalFov, camera.aspect},
                                         demand.limits.limited());
        sun.caches[k].plan(scene.view(0, cached), scene.events(0), demand, plan, statistics);
        left = left.less(spentOn(statistics));
        std::copy(statistics.begin(), statistics.end(),
                  report.cascades.begin() + std::ptrdiff_t(k * cascades.size()));
    }
}

/// Fills the next sun's maps with a share of all texels, within what the shown ones left of the limits. All
/// of it has one cause: the sun.
void ShadowSystem::Impl::planNext(double share, FrameReport& report) {
    Sun& sun = *suns[1];
    const double texels = double(cascades.size()) * config.side * config.side;
    cache::Limits left = report.limits.less(spentOn(report.cascades));
    for (size_t done = 0; done < cameras.size(); ++done) {
        const size_t k = (report.frame + done) % cameras.size();
        // Nothing sleeps: it must be whole before it is shown.
        cache::Demand demand{sun.space.toLight(cameras[k].position), sun.begin, 0, left.part(cameras.size() - done)};
        // Once it is complete it keeps up like the shown one.
        if (!sun.caches[k].complete())
            demand.limits.texels =
                std::min(demand.limits.texels, std::max<uint64_t>(1, uint64_t(std::ceil(share * texels))));
        sun.caches[k].plan(scene.view(1, true), scene.events(1), demand, plan, statistics);
        left = left.less(spentOn(statistics));
        for (size_t c = 0; c < cascades.size(); ++c)
            report.cascades[k * cascades.size() + c].addFor(cache::Cause::kSun, statistics[c]);
    }
}

cache::Limits ShadowSystem::Impl::limits() const {
    cache::Limits limits{config.budget.texels, config.budget.triangles};
    if (config.budget.ms > 0)
        limits.triangles = std::min(limits.triangles, std::max<uint64_t>(1, uint64_t(config.budget.ms / msPerTriangle)));
    return limits;
}

}  // namespace server
