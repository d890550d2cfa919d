#include "tools/lab/page.h"

#include <nlohmann/json.hpp>

#include "tools/lab/embedded/chart.h"
#include "tools/lab/embedded/chart_licence.h"
#include "tools/lab/embedded/page.h"
#include "tools/page_text.h"

namespace tools::lab {
namespace {

using Json = nlohmann::ordered_json;

Json jsonOf(const RunRecord& run) {
    return {{"world", run.world}, {"path", run.path}, {"movers", run.movers}, {"frames", run.frames},
            {"judged", run.judged}, {"begins", run.begins}, {"ends", run.ends}, {"far", run.farDistance},
            {"fov", glm::degrees(run.verticalFov)}, {"sun", {run.sun.x, run.sun.y, run.sun.z}}, {"width", run.width},
            {"height", run.height}, {"device", run.device}, {"driver", run.driver}, {"threads", run.threads}};
}

Json jsonOf(const MethodRecord& r) {
    Json fields = Json::array(), series = Json::array();
    for (const culling::MethodSetting& f : r.fields) fields.push_back({f.name, f.value, f.unit});
    for (const FrameRecord& f : r.series) {
        Json frame{f.frame, f.triangles, f.ms};
        if (f.judged)
            for (const uint64_t value : {f.judged->pixels, f.judged->falseLit, f.judged->falseShadow}) frame.push_back(value);
        series.push_back(std::move(frame));
    }
    return {{"name", r.name}, {"fields", fields}, {"frames", r.frames}, {"judged", r.judged}, {"pixels", r.pixels},
            {"points", r.points}, {"triangles", r.aFrame(r.cost.triangles)}, {"texels", r.aFrame(r.cost.texels)},
            {"draws", r.aFrame(r.cost.draws)}, {"ms", r.ms}, {"shadingMs", r.shadingMs}, {"lit", r.percent(r.falseLit.all())},
            {"litEdges", r.percent(r.falseLit.atEdges)}, {"shadow", r.percent(r.falseShadow.all())},
            {"shadowEdges", r.percent(r.falseShadow.atEdges)},
            {"wrong", r.percent(r.falseLit.all() + r.falseShadow.all())}, {"off", r.meanDifference()}, {"soft", r.meanSoftDifference()},
            {"flips", r.flipsPerMillion()}, {"ratio50", r.ratio50}, {"ratio99", r.ratio99}, {"used", r.usedPercent()},
            {"unanswered", r.percent(r.unanswered)}, {"worstFrame", r.worstFrame}, {"worstWrong", r.worstWrong},
            {"picture", base64(r.picture)}, {"series", series}};
}

Json jsonOf(const OcclusionRecord& r, const OcclusionRecord& drawn) {
    return {{"name", r.way}, {"asked", r.aFrame(r.asked)}, {"hidden", r.aFrame(r.hidden)}, {"wrongly", r.aFrame(r.wronglyHidden)},
            {"texels", r.aFrame(r.texelsWrong)}, {"deepest", r.deepest}, {"lit", r.percent(r.falseLit)},
            {"added", r.percent(r.falseLit) - drawn.percent(drawn.falseLit)}, {"triangles", r.aFrame(r.triangles)},
            {"rays", r.aFrame(r.rays)}, {"prepareMs", r.aFrame(r.prepareMs)}, {"ms", r.aFrame(r.ms)}};
}

Json jsonOf(const ClaimRecord& r) {
    return {{"situation", r.situation}, {"what", r.what}, {"method", r.method}, {"measure", r.measure}, {"why", r.why},
            {"verdict", r.verdict}, {"value", r.value}, {"limit", r.limit}, {"fails", r.fails}, {"wrong", r.wrong}};
}

}  // namespace

std::string labPage(const RunRecord& run, std::span<const MethodRecord> methods,
                    std::span<const OcclusionRecord> occlusion, std::span<const ClaimRecord> claims) {
    Json data{{"run", jsonOf(run)}, {"methods", Json::array()}, {"occlusion", Json::array()}, {"claims", Json::array()}};
    for (const MethodRecord& method : methods) data["methods"].push_back(jsonOf(method));
    for (const OcclusionRecord& way : occlusion) data["occlusion"].push_back(jsonOf(way, occlusion.front()));
    for (const ClaimRecord& claim : claims) data["claims"].push_back(jsonOf(claim));
    std::string page(viewOf(kPage));
    // The data last: what it says is not looked through for marks.
    put(page, "@LICENCE@", viewOf(kChartLicence));
    put(page, "@CHART@", viewOf(kChart));
    put(page, "@DATA@", embeddable(data));
    return page;
}

}  // namespace tools::lab
