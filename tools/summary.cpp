#include "tools/summary.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "tools/input_hash.h"
#include "world/hash.h"

namespace tools {
namespace {

using Json = nlohmann::ordered_json;

void addCascade(CascadeSummary& sum, const ReplayFrame& frame, size_t c) {
    const cache::CascadeStatistics& statistics = frame.report.cascades[c];
    for (size_t k = 0; k < cache::kCauses; ++k) {
        sum.byCause[k] += statistics.byCause[k];
        sum.framesByCause[k] += statistics.byCause[k] == cache::Cost{} ? 0 : 1;
    }
    sum.total += statistics.total;
    sum.active += statistics.active;
    sum.redraw += frame.redraw[c];
    sum.frames += statistics.total == cache::Cost{} ? 0 : 1;
    sum.clustersFound += statistics.clustersFound;
    sum.clustersHidden += statistics.clustersHidden;
    sum.trianglesHidden += statistics.trianglesHidden;
    if (statistics.asleep) {
        ++sum.sleepingFrames;
    } else {
        sum.owingFrames += statistics.unknownTexels + statistics.staleTexels > 0 ? 1 : 0;
        sum.mostUnknown = std::max(sum.mostUnknown, statistics.unknownTexels);
        sum.mostStale = std::max(sum.mostStale, statistics.staleTexels);
        sum.oldestDebt = std::max(sum.oldestDebt, statistics.oldestDebt);
    }
    const gpu::CascadeTimes times = timesOf(frame.report.gpu, c);
    sum.staticMs += times.staticMs;
    sum.activeMs += times.activeMs;
    if (!frame.verify) return;
    sum.staticTimes.cached.push_back(times.staticMs);
    sum.staticTimes.redrawn.push_back(timesOf(frame.verify->redraw, c).staticMs);
}

void addSpot(SpotSummary& sum, const cache::SpotStatistics& cost) {
    if (cost.statics.texels > 0) {
        sum.byCause[size_t(cost.cause)] += cost.statics;
        ++sum.framesByCause[size_t(cost.cause)];
    }
    sum.active += cost.active;
    sum.activeFrames += cost.active.texels > 0 ? 1 : 0;
}

Json json(const cache::Cost& cost) {
    return {{"texels", cost.texels},
            {"casters", cost.casters},
            {"triangles", cost.triangles},
            {"draws", cost.draws}};
}

Json json(const TimePair& times) {
    return {{"frames", times.cached.size()},
            {"cached_median_ms", median(times.cached)},
            {"redraw_median_ms", median(times.redrawn)}};
}

/// null: none.
Json limit(uint64_t value) { return value == cache::Limits::kNone ? Json() : Json(value); }

const char* clockName(world::Clock clock) {
    return clock == world::Clock::kLive ? "live" : clock == world::Clock::kVirtual ? "virtual" : "lockstep";
}

Json configJson(const ReplayHead& head) {
    const server::ShadowConfig& config = head.config;
    return {{"method", config.method == server::Method::kGnomon ? "gnomon" : "redraw"},
            {"cascades", config.cascades},
            {"resolution", config.side},
            {"far_m", config.farDistance},
            {"split_ratio", config.splitRatio},
            {"guard_band", config.guardBand},
            {"depth_bits", config.format == gpu::DepthFormat::kD16 ? 16 : 32},
            {"level_error_texels", config.levelError},
            {"smallest_caster_texels", config.smallestCaster},
            {"budget_texels", limit(config.budget.texels)},
            {"budget_triangles", limit(config.budget.triangles)},
            {"budget_ms", config.budget.ms},
            {"sun", {config.sun.x, config.sun.y, config.sun.z}},
            {"occlusion", config.occlusion ? "exact" : "off"},
            {"rays_per_cluster", config.raysPerCluster},
            {"rest_seconds", config.restSeconds},
            {"sun_step_rad", config.sunMotion.step},
            {"day_s", head.daySeconds},
            {"vertical_fov_rad", head.verticalFov},
            {"cameras", config.cameras},
            {"clock", clockName(config.streaming.clock)},
            {"prefetch", config.streaming.prefetch},
            {"disk_seed", config.streaming.disk.seed},
            {"disk_latency_s", config.streaming.disk.latency},
            {"disk_bandwidth_bytes_per_s", config.streaming.disk.bandwidth},
            {"memory_budget_bytes", config.residentBytes},
            {"gpu_budget_bytes", config.geometryBytes}};
}

Json cascadeJson(const ReplayHead& head, const Summary& summary, size_t c) {
    const CascadeSummary& sum = summary.cascades[c];
    Json causes;
    for (size_t k = 0; k < cache::kCauses; ++k) {
        Json cause = json(sum.byCause[k]);
        cause["frames"] = sum.framesByCause[k];
        causes[cache::toString(static_cast<cache::Cause>(k))] = cause;
    }
    Json cascade = {{"texel_m", head.texels[c]},
                    {"split_m", head.splits[c]},
                    {"frames_touched", sum.frames},
                    {"causes", causes},
                    {"static", json(sum.total)},
                    {"active", json(sum.active)},
                    {"redraw", json(sum.redraw)},
                    {"clusters_found", sum.clustersFound},
                    {"clusters_hidden", sum.clustersHidden},
                    {"triangles_hidden", sum.trianglesHidden},
                    {"sleeping_frames", sum.sleepingFrames},
                    {"owing_frames", sum.owingFrames},
                    {"most_unknown_texels", sum.mostUnknown},
                    {"most_stale_texels", sum.mostStale},
                    {"oldest_debt_frames", sum.oldestDebt}};
    if (!summary.lastHashes.empty()) {
        cascade["last_cache_hash"] = hexOf(summary.lastHashes[c].cache);
        cascade["last_working_hash"] = hexOf(summary.lastHashes[c].working);
    }
    return cascade;
}

/// Causes that never were are left out.
Json spotJson(const culling::SpotLight& light, const SpotSummary& sum) {
    Json causes = Json::object();
    for (size_t k = 0; k < cache::kCauses; ++k) {
        if (sum.framesByCause[k] == 0) continue;
        Json cause = json(sum.byCause[k]);
        cause["frames"] = sum.framesByCause[k];
        causes[cache::toString(static_cast<cache::Cause>(k))] = cause;
    }
    Json active = json(sum.active);
    active["frames"] = sum.activeFrames;
    return {{"position_m", {light.position.x, light.position.y, light.position.z}},
            {"direction", {light.direction.x, light.direction.y, light.direction.z}},
            {"half_angle_rad", light.halfAngle},
            {"range_m", light.range},
            {"resolution", light.side},
            {"causes", causes},
            {"active", active}};
}

Json timesJson(const Summary& summary) {
    Json cascades = Json::array();
    for (const CascadeSummary& sum : summary.cascades) {
        Json times = json(sum.staticTimes);
        times["static_sum_ms"] = sum.staticMs;
        times["active_sum_ms"] = sum.activeMs;
        cascades.push_back(times);
    }
    return {{"frame_p50_ms", quantile(summary.frameMs, 0.5)},
            {"frame_p95_ms", quantile(summary.frameMs, 0.95)},
            {"frame_p99_9_ms", quantile(summary.frameMs, 0.999)},
            {"frame_max_ms", quantile(summary.frameMs, 1)},
            {"stream_sum_ms", summary.cpu.streamMs},
            {"sets_sum_ms", summary.cpu.setsMs},
            {"occlusion_sum_ms", summary.cpu.occlusionMs},
            {"plan_sum_ms", summary.cpu.planMs},
            {"record_sum_ms", summary.cpu.recordMs},
            {"gpu_wall_sum_ms", summary.gpuWallMs},
            {"occlusion_saved_ms", occlusionValue(summary).msSaved},
            {"update", json(summary.update)},
            {"spots", json(summary.spotTimes)},
            {"static_by_cascade", cascades}};
}

}  // namespace

void Summary::add(const ReplayFrame& frame) {
    const server::FrameReport& report = frame.report;
    if (frames == 0) {
        firstNumber = frame.number;
        firstTime = report.time;
        cascades.resize(report.cascades.size());
        spots.resize(report.spots.size());
    }
    ++frames;
    lastTime = report.time;
    for (size_t c = 0; c < cascades.size(); ++c) addCascade(cascades[c], frame, c);
    for (size_t i = 0; i < spots.size(); ++i) addSpot(spots[i], report.spots[i].cost);
    idleFrames += report.submitted ? 0 : 1;
    chunkArrivals += report.chunkArrivals;
    chunkDepartures += report.chunkDepartures;
    arrivalFrames += report.chunkArrivals > 0 ? 1 : 0;
    refinements += report.refinements;
    lackingFrames += report.missingChunks + report.coarseChunks > 0 ? 1 : 0;
    for (const cache::CascadeStatistics& c : report.cascades) {
        missingTexels += c.missingTexels;
        coarseTexels += c.coarseTexels;
    }
    longestLack = std::max(longestLack, report.longestLack);
    mostResident = std::max(mostResident, report.residentBytes);
    mostGeometry = std::max(mostGeometry, report.geometryBytes);
    bytesRead += report.bytesRead;
    bytesAgain += report.bytesAgain;
    bytesUploaded += report.bytesUploaded;
    rays += report.rays;
    certificates += report.certificates;
    revocations += report.revocations;
    errors += report.errors.size();
    if (report.sun.shown != lastSun && frames > 1) ++sunSteps;
    lastSun = report.sun.shown;
    sunRedraws += report.sun.redrawn ? 1 : 0;
    mostSunLag = std::max(mostSunLag, report.sun.lag);
    planHash = world::hashValues(std::span(&report.planHash, 1), planHash);
    if (!frame.hashes.empty()) lastHashes = frame.hashes;
    frameMs.push_back(frame.advanceMs);
    cpu.streamMs += report.cpu.streamMs;
    cpu.setsMs += report.cpu.setsMs;
    cpu.occlusionMs += report.cpu.occlusionMs;
    cpu.planMs += report.cpu.planMs;
    cpu.recordMs += report.cpu.recordMs;
    gpuWallMs += report.gpu.wallMs;
    if (!frame.verify) return;
    ++verifiedFrames;
    verifiedTexels += frame.verify->texels;
    skippedTexels += frame.verify->stale;
    differingTexels += frame.verify->differing;
    update.cached.push_back(report.gpu.recordMs + report.gpu.wallMs);
    update.redrawn.push_back(frame.verify->redraw.recordMs + frame.verify->redraw.wallMs);
    spotTimes.cached.push_back(report.gpu.spotsMs);
    spotTimes.redrawn.push_back(frame.verify->redraw.spotsMs);
}

double quantile(std::vector<double> values, double q) {
    if (values.empty()) return 0;
    const double rank = std::ceil(q * static_cast<double>(values.size()));
    const auto nth = values.begin() + static_cast<ptrdiff_t>(std::max(rank, 1.0)) - 1;
    std::nth_element(values.begin(), nth, values.end());
    return *nth;
}

OcclusionValue occlusionValue(const Summary& summary) {
    OcclusionValue value;
    for (const CascadeSummary& sum : summary.cascades) {
        value.found += sum.clustersFound;
        value.hidden += sum.clustersHidden;
        value.trianglesHidden += sum.trianglesHidden;
        if (sum.total.triangles == 0) continue;
        value.msSaved +=
            static_cast<double>(sum.trianglesHidden) / static_cast<double>(sum.total.triangles) * sum.staticMs;
    }
    return value;
}

std::string settingsJson(const ReplayHead& head) {
    Json settings = configJson(head);
    Json spots = Json::array();
    for (const culling::SpotLight& light : head.spots)
        spots.push_back({light.position.x, light.position.y, light.position.z, light.direction.x, light.direction.y,
                         light.direction.z, light.halfAngle, light.range});
    if (!spots.empty()) settings["spots"] = spots;
    return settings.dump();
}

std::string toJson(const ReplayHead& head, const Summary& summary) {
    const OcclusionValue occlusion = occlusionValue(summary);
    Json cascades = Json::array();
    for (size_t c = 0; c < summary.cascades.size(); ++c) cascades.push_back(cascadeJson(head, summary, c));
    Json spots = Json::array();
    for (size_t i = 0; i < summary.spots.size(); ++i) spots.push_back(spotJson(head.spots[i], summary.spots[i]));
    const Json document = {
        {"world", {{"file", head.world}, {"source", head.source}, {"content_hash", head.worldHash}}},
        {"path", head.path},
        {"movers", head.movers},
        {"settings", configJson(head)},
        {"frames", summary.frames},
        {"first_frame", summary.firstNumber},
        {"first_time_s", summary.firstTime},
        {"last_time_s", summary.lastTime},
        {"idle_frames", summary.idleFrames},
        {"chunk_arrivals", summary.chunkArrivals},
        {"chunk_departures", summary.chunkDepartures},
        {"chunk_refinements", summary.refinements},
        {"lacking",
         {{"frames", summary.lackingFrames},
          {"missing_texels", summary.missingTexels},
          {"coarse_texels", summary.coarseTexels},
          {"longest_s", summary.longestLack}}},
        {"most_resident_bytes", summary.mostResident},
        {"most_geometry_bytes", summary.mostGeometry},
        {"bytes_read", summary.bytesRead},
        {"bytes_again", summary.bytesAgain},
        {"bytes_uploaded", summary.bytesUploaded},
        {"errors", summary.errors},
        {"sun",
         {{"steps", summary.sunSteps},
          {"redraws", summary.sunRedraws},
          {"most_lag_rad", summary.mostSunLag}}},
        {"verified",
         {{"frames", summary.verifiedFrames},
          {"texels", summary.verifiedTexels},
          {"skipped_texels", summary.skippedTexels},
          {"differing_texels", summary.differingTexels}}},
        {"occlusion",
         {{"rays", summary.rays},
          {"certificates", summary.certificates},
          {"revocations", summary.revocations},
          {"clusters_found", occlusion.found},
          {"clusters_hidden", occlusion.hidden},
          {"triangles_hidden", occlusion.trianglesHidden}}},
        {"plan_hash", hexOf(summary.planHash)},
        {"cascades", cascades},
        {"spots", spots},
        {"times", timesJson(summary)},
        {"machine", {{"device", head.device}, {"driver", head.driver}, {"threads", head.threads}}}};
    // Names of files and devices need not be UTF-8; the writer must not throw over them.
    return document.dump(2, ' ', false, Json::error_handler_t::replace) + '\n';
}

}  // namespace tools
