#include "tools/report/page.h"

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

}  // namespace

Result<std::string> reportPage(std::vector<RunFile>& runs, const std::function<void(size_t, size_t)>& follow) {
    size_t total = 0, before = 0;
    for (const RunFile& run : runs) total += run.record().frames;
    Json data{{"runs", Json::array()}};
    for (RunFile& run : runs) {
        auto json = jsonOf(run, [&](size_t done) { follow(std::min(before + done, total), total); });
        if (!json) return json.error();
        data["runs"].push_back(std::move(json.value()));
        before += run.record().frames;
    }
    std::string page(viewOf(kPage));
    // The data last: what it says is not looked through for marks.
    put(page, "@LICENCE@", viewOf(lab::kChartLicence));
    put(page, "@CHART@", viewOf(lab::kChart));
    put(page, "@DATA@", embeddable(data));
    return page;
}

}  // namespace tools::report
