#include "tools/lab/record.h"

#include <tbb/global_control.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <map>

#include "tools/input_hash.h"
#include "world/hash.h"
#include "world/program.h"

namespace tools::lab {
namespace {

double median(std::vector<double> values) {
    if (values.empty()) return 0;
    const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

}  // namespace

world::Result<RunRecord> describe(const Setting& setting, const RunFiles& files, std::span<const world::Pose> poses,
                                  std::span<const size_t> judged, const RunConfig& config) {
    RunRecord run;
    run.world = files.world;
    run.path = files.path;
    run.movers = files.movers;
    run.frames = poses.size();
    run.judged = 2 * judged.size();
    run.begins = poses.front().time;
    run.ends = poses.back().time;
    run.farDistance = setting.farDistance;
    run.verticalFov = setting.verticalFov;
    run.sun = setting.light.sun;
    run.width = config.width;
    run.height = config.height;
    run.device = setting.device.name();
    run.driver = setting.device.driver();
    run.threads = int(tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism));

    const auto contents = setting.store.contentHash();
    if (!contents) return contents.error();
    const std::array<double, 5> camera{run.farDistance, run.verticalFov, run.sun.x, run.sun.y, run.sun.z};
    const std::array<int, 3> counts{run.width, run.height, run.threads};
    uint64_t key = world::hashProgram(contents.value());
    key = hashMovers(setting.movers, hashPoses(poses, key));
    key = world::hashValues(std::span<const double>(camera), key);
    key = world::hashValues(std::span<const int>(counts), key);
    key = world::hashValues(judged, key);
    run.key = hashText(run.driver, hashText(run.device, key));
    return run;
}

world::Result<MethodRecord> recordOf(const MethodResult& result) {
    const Measures& m = result.measures;
    MethodRecord record;
    record.name = result.method.name;
    record.fields = culling::settingsOf(result.method);
    record.frames = result.frames;
    record.cost = result.cost;
    record.ms = median(result.ms);
    record.shadingMs = median(result.shadingMs);
    record.judged = m.frames;
    record.pixels = m.pixels;
    record.falseLit = m.falseLit;
    record.falseShadow = m.falseShadow;
    record.difference = m.difference;
    record.softDifference = m.softDifference;
    record.unanswered = m.unanswered;
    record.points = m.points;
    record.flips = m.flips;
    record.ratio50 = m.texelRatio(0.5);
    record.ratio99 = m.texelRatio(0.99);
    record.usedShare = m.usedShare;
    record.worstFrame = result.worst.frame;
    record.worstWrong = result.worst.wrong;
    auto picture = pngOf(result.worst.picture);
    if (!picture) return picture.error();
    record.picture = std::move(picture.value());
    std::map<size_t, const Measures*> judged;
    for (const JudgedFrame& frame : result.judged) judged[frame.frame] = &frame.measures;
    for (size_t i = 0; i < result.drawn.size(); ++i) {
        record.series.push_back({result.drawn[i], result.triangles[i], result.ms[i], std::nullopt});
        if (const auto at = judged.find(result.drawn[i]); at != judged.end()) {
            const Measures& f = *at->second;
            record.series.back().judged = {f.pixels, f.falseLit.all(), f.falseShadow.all(), f.points, f.flips};
        }
    }
    return record;
}

uint64_t methodKey(const RunRecord& run, const culling::ShadowMethod& method) {
    uint64_t key = hashText(method.name, run.key);
    for (const culling::MethodSetting& field : culling::settingsOf(method)) key = hashText(field.value, hashText(field.name, key));
    return key;
}

std::string tableHead() {
    char line[256];
    std::snprintf(line, sizeof line,
                  "%-18s %10s %10s %9s %9s %9s | %9s %9s %9s %9s %9s %9s | %10s | %6s %6s %6s %7s", "method", "triangles", "texels",
                  "draws", "ms", "shade ms", "lit %", "at edges", "shadow %", "at edges", "mean off", "soft off", "flips/M", "p50", "p99", "used %",
                  "no map %");
    return line;
}

std::string tableRow(const MethodRecord& r) {
    char line[512];
    std::snprintf(line, sizeof line,
                  "%-18s %10.0f %10.0f %9.0f %9.2f %9.2f | %9.4f %9.4f %9.4f %9.4f %9.5f %9.5f | %10.1f | %6.2f %6.2f %6.2f %7.3f",
                  r.name.c_str(), r.aFrame(r.cost.triangles), r.aFrame(r.cost.texels), r.aFrame(r.cost.draws), r.ms, r.shadingMs,
                  r.percent(r.falseLit.all()), r.percent(r.falseLit.atEdges), r.percent(r.falseShadow.all()),
                  r.percent(r.falseShadow.atEdges), r.meanDifference(), r.meanSoftDifference(), r.flipsPerMillion(), r.ratio50, r.ratio99,
                  r.usedPercent(), r.percent(r.unanswered));
    return line;
}

}  // namespace tools::lab
