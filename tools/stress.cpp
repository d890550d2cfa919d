#include "tools/stress.h"

#include <algorithm>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "tools/chart.h"

namespace tools {
namespace {

using server::ShadowSystem;
using world::Done;
using world::Error;
using world::Result;

/// Room that a system which must have everything gets [bytes].
constexpr uint64_t kPlenty = 16ull << 30, kPlentyGeometry = 1ull << 30;

/// The case's maps, drawn by a system that waits for every chunk.
server::ShadowConfig complete(const StressCase& c) {
    server::ShadowConfig config = c.config;
    config.streaming = {};
    config.residentBytes = kPlenty;
    config.geometryBytes = kPlentyGeometry;
    config.occlusion = false;  // it changes no texel
    config.timestamps = false;
    return config;
}

struct Compared {
    uint64_t texels = 0, holes = 0, silent = 0;
};

/// Receivers are at most the far distance behind the eye: depths beyond that are all the same to them.
Result<Compared> compare(ShadowSystem& system, ShadowSystem& truth, const server::FrameInput& frame) {
    Compared result;
    for (int c = 0; c < system.cascades(); ++c) {
        const server::CascadeView view = system.view(c);
        const int camera = c / system.config().cascades;
        const glm::dvec3 eye = camera == 0 ? frame.camera.position : frame.others[size_t(camera) - 1].position;
        const double farthest = (view.lightFromWorld * eye).z + system.config().farDistance;
        const auto deepest = static_cast<float>((farthest - view.depthNear) / view.depthRange);
        const auto kind = gpu::MapKind::kWorking;
        const auto held = system.readMap(c, kind), right = truth.readMap(c, kind);
        if (!held) return held.error();
        if (!right) return right.error();
        if (system.view(c).window != truth.view(c).window)
            return Error{world::ErrorCode::kBadData, "cascade " + std::to_string(c) + ": windows differ"};
        std::vector<server::TexelState> states;  // read only if a texel asks for it
        result.texels += held.value().size();
        for (size_t i = 0; i < held.value().size(); ++i) {
            if (std::min(held.value()[i], deepest) == std::min(right.value()[i], deepest)) continue;
            ++result.holes;
            if (states.empty()) states = system.texelStates(c, kind);
            result.silent += states[i] == server::TexelState::kValid ? 1 : 0;
        }
    }
    return result;
}

std::string count(uint64_t n) { return std::to_string(n); }

void addMoving(StressResult& r, const ReplayFrame& frame) {
    const server::FrameReport& report = frame.report;
    ++r.frames;
    r.lackingFrames += report.missingChunks + report.coarseChunks > 0 ? 1 : 0;
    for (const cache::CascadeStatistics& s : report.cascades) {
        r.missingTexels += s.missingTexels;
        r.coarseTexels += s.coarseTexels;
        r.unknownTexels += s.unknownTexels;
        r.staleTexels += s.staleTexels;
        r.oldestDebt = std::max(r.oldestDebt, s.oldestDebt);
    }
    r.longestLack = std::max(r.longestLack, report.longestLack);
    r.mostArrivals = std::max<uint64_t>(r.mostArrivals, report.chunkArrivals + report.refinements);
    r.mostRays = std::max(r.mostRays, report.rays);
    r.frameMs.push_back(frame.advanceMs);
}

void judge(const StressCase& c, const StressNeed& need, StressResult& r) {
    const auto fail = [&](const std::string& what) { r.failures.push_back(what); };
    if (r.silentHoles > 0) fail(count(r.silentHoles) + " wrong texels were not known to be");
    if (r.holes > 0 && !c.mayLack) fail(count(r.holes) + " wrong texels although memory and disk suffice");
    if (r.restingHoles > 0 && !c.losesChunks && c.memoryShare == 0)
        fail(count(r.restingHoles) + " texels still wrong after the rest");
    if (r.summary.mostResident > r.memoryBudget) fail("the memory budget was exceeded");
    if (r.summary.mostGeometry > r.geometryBudget) fail("the geometry budget was exceeded");
    if (c.mostShare > 0 && double(r.summary.mostResident) > c.mostShare * double(need.memory))
        fail(count(r.summary.mostResident) + " bytes in memory, where one camera needs " + count(need.memory));
    if (r.mostRays >= culling::RayAllowance::kMost + c.config.raysPerCluster)
        fail(count(r.mostRays) + " rays for certificates in a frame");
    if (r.summary.differingTexels > 0) fail(count(r.summary.differingTexels) + " texels differ from the redraw");
    if (r.summary.errors > 0 && !c.losesChunks) fail(count(r.summary.errors) + " errors");
}

double percent(uint64_t part, uint64_t whole) { return whole == 0 ? 0 : 100.0 * double(part) / double(whole); }

}  // namespace

Result<StressNeed> measureNeed(gpu::Device& device, const world::WorldStore& store, const StressCase& c) {
    server::ShadowConfig config = complete(c);
    config.cameras = 1;
    const auto system = ShadowSystem::create(device, store, config);
    if (!system) return system.error();
    StressNeed need;
    ReplayInput input;
    input.poses = c.poses;
    std::vector<server::Camera> none;
    for (size_t i = c.start; i < c.end; i += size_t(kStressRate) / 2) {
        const auto report = system.value()->advance(camerasAt(input, i, none));
        if (!report) return report.error();
        need.memory = std::max(need.memory, report.value().residentBytes);
        need.geometry = std::max(need.geometry, report.value().geometryBytes);
    }
    return need;
}

Result<StressResult> runStress(gpu::Device& device, const world::WorldStore& store, const StressCase& c,
                               const StressNeed& need, uint64_t compareEvery, const StressFrame& onFrame) {
    const auto named = [&](const Error& error) { return Error{error.code, "case " + c.name + ": " + error.what, error.native}; };
    server::ShadowConfig config = c.config;
    if (c.memoryShare > 0) {
        config.residentBytes = uint64_t(double(need.memory) * c.memoryShare);
        config.geometryBytes = uint64_t(double(need.geometry) * c.memoryShare);
    }
    const auto system = ShadowSystem::create(device, store, config);
    if (!system) return named(system.error());
    const auto truth = ShadowSystem::create(device, store, complete(c));
    if (!truth) return named(truth.error());

    StressResult r;
    r.name = c.name;
    r.what = c.what;
    r.memoryBudget = config.residentBytes;
    r.geometryBudget = config.geometryBytes;
    r.windowTexels = uint64_t(config.cameras * config.cascades) * uint64_t(config.side) * uint64_t(config.side);
    ReplayInput input;
    input.poses = c.poses;
    input.others = c.others;
    input.verifyEvery = c.poses.size();
    input.live = config.streaming.clock == world::Clock::kLive;
    input.foresight = c.foresight;
    input.dearest = c.dearest;
    std::vector<server::Camera> others;
    auto edit = c.edits.begin();
    const auto done = replay(*system.value(), input, nullptr, nullptr, [&](const ReplayFrame& frame) -> Result<Done> {
        r.summary.add(frame);
        const bool last = frame.number + 1 == c.poses.size(), moving = frame.number >= c.start && frame.number < c.end;
        if (moving) addMoving(r, frame);
        if (last || (moving && (frame.number - c.start) % compareEvery == 0)) {
            const server::FrameInput seen = camerasAt(input, frame.number, others);
            const auto drawn = truth.value()->advance(seen);
            if (!drawn) return drawn.error();
            const auto compared = compare(*system.value(), *truth.value(), seen);
            if (!compared) return compared.error();
            r.silentHoles += compared.value().silent;
            if (last) r.restingHoles = compared.value().holes;
            if (moving) {
                r.comparedTexels += compared.value().texels;
                r.holes += compared.value().holes;
                r.worstHoles = std::max(r.worstHoles, compared.value().holes);
            }
        }
        for (; edit != c.edits.end() && edit->first == frame.number; ++edit) {
            for (ShadowSystem* each : {system.value().get(), truth.value().get()})
                if (const auto given = each->edit(edit->second); !given) return given.error();
            ++r.edits;
        }
        return onFrame(frame);
    });
    if (!done) return named(done.error());
    r.config = system.value()->config();
    for (int cascade = 0; cascade < system.value()->cascades(); ++cascade) {
        r.texels.push_back(system.value()->view(cascade).texel);
        r.splits.push_back(system.value()->view(cascade).split);
    }
    judge(c, need, r);
    return r;
}

std::string stressTable(const std::vector<StressResult>& results) {
    std::string out;
    char line[320];
    const auto print = [&](auto... values) {
        std::snprintf(line, sizeof line, values...);
        out += line;
    };
    print("%-20s %-7s %9s %9s %9s %8s %8s %7s %8s %8s %8s\n", "case", "verdict", "wrong", "missing", "coarse", "lack",
          "read", "again", "memory", "p50", "p99.9");
    print("%-20s %-7s %9s %9s %9s %8s %8s %7s %8s %8s %8s\n", "", "", "of texels", "of texels", "of texels", "[s]",
          "[MB]", "[MB]", "[MB]", "[ms]", "[ms]");
    for (const StressResult& r : results) {
        const Summary& s = r.summary;
        print("%-20s %-7s %8.4f%% %8.4f%% %8.4f%% %8.2f %8.1f %7.1f %8.1f %8.2f %8.2f\n", r.name.c_str(),
              r.failures.empty() ? "pass" : "FAIL", percent(r.holes, r.comparedTexels),
              percent(r.missingTexels, r.frames * r.windowTexels), percent(r.coarseTexels, r.frames * r.windowTexels),
              r.longestLack, double(s.bytesRead) / 1e6, double(s.bytesAgain) / 1e6, double(s.mostResident) / 1e6,
              quantile(r.frameMs, 0.5), quantile(r.frameMs, 0.999));
    }
    for (const StressResult& r : results)
        for (const std::string& failure : r.failures) out += r.name + ": " + failure + '\n';
    return out;
}

std::string prefetchChart(const std::vector<StressResult>& results) {
    Chart chart{.title = "What looking ahead is worth: none, by the eye's speed, or with its path told beforehand",
                .x = "read [MB, decoded]",
                .y = "wrong texels [% of those compared]",
                .lines = {}};
    for (const StressResult& r : results) {
        const size_t speed = r.name.find('-') + 1, kind = r.name.rfind('-') + 1;  // prefetch-SPEED-KIND
        const std::string line = r.name.substr(speed, kind - 1 - speed) + " m/s";
        if (chart.lines.empty() || chart.lines.back().name != line) chart.lines.push_back({line, {}});
        chart.lines.back().points.push_back(
            {double(r.summary.bytesRead) / 1e6, percent(r.holes, r.comparedTexels), r.name.substr(kind)});
    }
    return toSvg(chart);
}

std::string stressJson(const std::vector<StressResult>& results, const std::string& world, uint64_t seed) {
    using Json = nlohmann::ordered_json;
    Json cases = Json::array();
    for (const StressResult& r : results) {
        const Summary& s = r.summary;
        cases.push_back({{"name", r.name},
                         {"what", r.what},
                         {"passed", r.failures.empty()},
                         {"failures", r.failures},
                         {"frames", s.frames},
                         {"moving_frames", r.frames},
                         {"compared_texels", r.comparedTexels},
                         {"holes", r.holes},
                         {"silent_holes", r.silentHoles},
                         {"worst_frame_holes", r.worstHoles},
                         {"resting_holes", r.restingHoles},
                         {"window_texels", r.windowTexels},
                         {"missing_texels", r.missingTexels},
                         {"coarse_texels", r.coarseTexels},
                         {"unknown_texels", r.unknownTexels},
                         {"stale_texels", r.staleTexels},
                         {"oldest_debt_frames", r.oldestDebt},
                         {"longest_lack_s", r.longestLack},
                         {"lacking_frames", r.lackingFrames},
                         {"bytes_read", s.bytesRead},
                         {"bytes_again", s.bytesAgain},
                         {"most_resident_bytes", s.mostResident},
                         {"most_geometry_bytes", s.mostGeometry},
                         {"memory_budget_bytes", r.memoryBudget},
                         {"geometry_budget_bytes", r.geometryBudget},
                         {"chunk_arrivals", s.chunkArrivals},
                         {"chunk_refinements", s.refinements},
                         {"chunk_departures", s.chunkDepartures},
                         {"most_arrivals_in_a_frame", r.mostArrivals},
                         {"most_rays_in_a_frame", r.mostRays},
                         {"edits", r.edits},
                         {"errors", s.errors},
                         {"plan_hash", s.planHash},
                         {"times",
                          {{"frame_p50_ms", quantile(r.frameMs, 0.5)},
                           {"frame_p95_ms", quantile(r.frameMs, 0.95)},
                           {"frame_p99_ms", quantile(r.frameMs, 0.99)},
                           {"frame_p99_9_ms", quantile(r.frameMs, 0.999)},
                           {"frame_max_ms", quantile(r.frameMs, 1)}}}});
    }
    const Json document = {{"world", world}, {"seed", seed}, {"cases", cases}};
    return document.dump(2, ' ', false, Json::error_handler_t::replace) + '\n';
}

}  // namespace tools
