#include "tools/report/page.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "tools/lab/embedded/chart.h"
#include "tools/lab/embedded/chart_licence.h"
#include "tools/page_text.h"
#include "tools/report/embedded/page.h"
#include "tools/report/overview.h"

namespace tools::report {
namespace {

using Json = nlohmann::ordered_json;
using world::Result;

Result<Json> jsonOf(RunFile& run, const std::function<void(size_t)>& onFrame) {
    Overview overview(run.record(), run.columns());
    auto cursor = run.frames();
    if (!cursor) return cursor.error();
    FrameRow row;
    for (size_t done = 0;; onFrame(++done)) {
        const auto more = cursor.value().next(row);
        if (!more) return more.error();
        if (!more.value()) break;
        overview.add(row);
    }
    Json json = overview.json();
    json["id"] = run.name();
    const auto pictures = run.pictures();
    if (!pictures) return pictures.error();
    json["pictures"] = Json::array();
    for (const DumpedPicture& p : pictures.value()) json["pictures"].push_back({p.frame, p.cascade, base64(p.png)});
    const auto methods = run.methods();
    if (!methods) return methods.error();
    json["methods"] = Json::array();
    for (const MethodFigures& m : methods.value())
        json["methods"].push_back({{"name", m.name}, {"frames", m.frames}, {"judged", m.judged}, {"triangles", m.triangles}, {"texels", m.texels},
                                   {"lit", m.falseLit}, {"shadow", m.falseShadow}, {"flips", m.flips}, {"ms", m.ms}});
    return json;
}

std::vector<uint64_t> unpicturedOf(const Json& run) {
    std::vector<uint64_t> frames;
    if (run["kind"] != "replay") return frames;
    for (const Json& frame : run["dearest"]) {
        const Json& number = frame["n"];
        if (std::none_of(run["pictures"].begin(), run["pictures"].end(), [&](const Json& p) { return p[0] == number; })) frames.push_back(number);
    }
    std::sort(frames.begin(), frames.end());
    return frames;
}

}  // namespace

Result<Page> reportPage(std::vector<RunFile>& runs, const std::function<void(size_t, size_t)>& follow) {
    size_t total = 0, before = 0;
    for (const RunFile& run : runs) total += run.record().frames;
    Page page;
    Json data{{"runs", Json::array()}};
    for (RunFile& run : runs) {
        auto json = jsonOf(run, [&](size_t done) { follow(std::min(before + done, total), total); });
        if (!json) return json.error();
        if (auto frames = unpicturedOf(json.value()); !frames.empty()) page.unpictured.emplace_back(run.name(), std::move(frames));
        data["runs"].push_back(std::move(json.value()));
        before += run.record().frames;
    }
    page.html = viewOf(kPage);
    // The data last: what it says is not looked through for marks.
    put(page.html, "@LICENCE@", viewOf(lab::kChartLicence));
    put(page.html, "@CHART@", viewOf(lab::kChart));
    put(page.html, "@DATA@", embeddable(data));
    return page;
}

}  // namespace tools::report
