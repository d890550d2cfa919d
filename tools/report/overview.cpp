#include "tools/report/overview.h"

#include <algorithm>
#include <cmath>

namespace tools::report {
namespace {

using Json = nlohmann::ordered_json;

/// How frames that share a point are told: the most of them, or their sum.
enum class Way { kMost, kSum };
struct Series {
    const char* metric;
    Way way;
};
const std::vector<Series> kSeries{{"frame_resident_bytes", Way::kMost}, {"frame_geometry_bytes", Way::kMost},
                                  {"frame_bytes_read", Way::kSum},      {"frame_chunk_arrivals", Way::kSum},
                                  {"frame_chunk_departures", Way::kSum}, {"frame_chunks_missing", Way::kMost},
                                  {"frame_chunks_coarse", Way::kMost},  {"frame_rays", Way::kSum},
                                  {"frame_spot_triangles", Way::kSum},
                                  {"triangles_hidden", Way::kSum},      {"t_frame_ms", Way::kMost}};

/// What the page gives p50 to the most of, with its unit.
struct Distributed {
    const char *metric, *label, *unit;
};
const std::vector<Distributed> kDistributed{
    {"static_triangles", "static triangles drawn", "triangles"}, {"static_texels", "static texels redrawn", "texels"},
    {"static_casters", "static casters drawn", "casters"},       {"static_draws", "static draws", "draws"},
    {"active_triangles", "moving triangles drawn", "triangles"}, {"redraw_triangles", "triangles of a whole redraw", "triangles"},
    {"frame_spot_triangles", "static triangles drawn for spot lights", "triangles"},
    {"frame_bytes_read", "read", "bytes"},                       {"frame_bytes_uploaded", "uploaded to the GPU", "bytes"},
    {"frame_rays", "rays for certificates", "rays"},             {"oldest_debt", "oldest debt", "frames"},
    {"missing_texels", "texels that lack a chunk", "texels"},    {"t_frame_ms", "whole frame", "ms"},
    {"t_frame_gpu_wall_ms", "submission to fence", "ms"},        {"t_frame_stream_ms", "streaming, CPU", "ms"},
    {"t_frame_occlusion_ms", "certificates, CPU", "ms"},         {"t_frame_plan_ms", "planning, CPU", "ms"},
    {"t_frame_spots_ms", "maps of spot lights, GPU", "ms"},
    {"t_frame_redraw_wall_ms", "whole redraw, on compared frames", "ms"}};

const std::vector<std::string> kSums{"static_triangles", "static_texels", "static_casters", "static_draws", "active_triangles",
                                     "redraw_triangles", "redraw_texels", "clusters_found", "clusters_hidden", "triangles_hidden",
                                     "frame_rays", "frame_certificates", "frame_revocations", "frame_bytes_read", "frame_bytes_again",
                                     "frame_bytes_uploaded", "frame_chunk_arrivals", "frame_chunk_departures", "frame_chunk_refinements",
                                     "frame_errors", "frame_spot_triangles", "frame_verified_texels", "frame_differing_texels", "t_frame_occlusion_ms", "t_gpu_static_ms"};

double orZero(double value) { return std::isnan(value) ? 0 : value; }

/// Three digits after the point are finer than any figure of the page.
double rounded(double value) { return std::round(value * 1000) / 1000; }

Json list(const std::vector<double>& values) {
    Json out = Json::array();
    for (const double v : values) {
        if (v == std::floor(v) && std::abs(v) < 9e15)
            out.push_back(int64_t(v));
        else
            out.push_back(rounded(v));
    }
    return out;
}

cache::Cost causeOf(const FrameRow& row, size_t cause) {
    cache::Cost sum;
    for (const FrameRow::Cascade& cascade : row.cascades) sum += cascade.byCause[cause];
    return sum;
}

}  // namespace

Overview::Overview(const RunRecord& record, const ResultColumns& columns)
    : record_(record), share_(std::max<uint64_t>(1, (record.frames + kPoints - 1) / kPoints)), distributions_(kDistributed.size()) {
    for (const Metric& metric : allMetrics(columns)) metrics_[metric.name] = metric;
    for (size_t k = 0; k < columns.cascade.size(); ++k) column_[columns.cascade[k].column.name] = k;
}

Json Overview::frameJson(const FrameRow& row) const {
    Json causes = Json::object(), cascades = Json::array(), casters = Json::array();
    for (size_t k = 0; k < cache::kCauses; ++k) {
        const cache::Cost cost = causeOf(row, k);
        if (cost == cache::Cost{}) continue;
        causes[cache::toString(cache::Cause(k))] = {cost.texels, cost.casters, cost.triangles, cost.draws};
    }
    for (const FrameRow::Cascade& cascade : row.cascades) {
        const auto value = [&](const char* name) { return orZero(cascade.values[column_.at(name)]); };
        cascades.push_back(list({value("static_texels"), value("static_triangles"), value("redraw_triangles")}));
    }
    for (const server::CasterCost& c : row.dearest)
        casters.push_back({c.name, rounded(c.pWorld.x), rounded(c.pWorld.y), rounded(c.pWorld.z), c.triangles});
    return {{"n", row.number}, {"t", rounded(of("time", row))}, {"eye", list({rounded(row.eye.x), rounded(row.eye.y), rounded(row.eye.z)})},
            {"causes", causes}, {"cascades", cascades}, {"casters", casters}, {"active", orZero(of("active_triangles", row))},
            {"ms", rounded(orZero(of("t_frame_ms", row)))}, {"missing", orZero(of("frame_chunks_missing", row))},
            {"arrivals", orZero(of("frame_chunk_arrivals", row))}};
}

void Overview::addTo(Point& point, const FrameRow& row, double triangles) {
    if (point.frames++ == 0) {
        point.first = row.number;
        point.triangles.assign(cache::kCauses, 0);
        point.texels.assign(cache::kCauses, 0);
        point.series.assign(kSeries.size(), 0);
    }
    double texels = 0;
    for (size_t k = 0; k < cache::kCauses; ++k) {
        const cache::Cost cost = causeOf(row, k);
        point.triangles[k] += double(cost.triangles);
        point.texels[k] += double(cost.texels);
        texels += double(cost.texels);
    }
    for (size_t k = 0; k < kSeries.size(); ++k) {
        const double value = orZero(of(kSeries[k].metric, row));
        point.series[k] = kSeries[k].way == Way::kSum ? point.series[k] + value : std::max(point.series[k], value);
    }
    point.redraw += orZero(of("redraw_triangles", row));
    point.mostTexels = std::max(point.mostTexels, texels);
    if (triangles <= point.most) return;
    point.most = triangles;
    point.dearest = frameJson(row);
}

void Overview::keepDearest(const FrameRow& row, double triangles) {
    if (triangles == 0) return;
    const double time = of("time", row);
    // Of frames close to each other the dearest counts.
    for (auto& [most, frame] : dearest_) {
        if (std::abs(frame["t"].get<double>() - time) >= kApart) continue;
        if (triangles <= most) return;
    }
    std::erase_if(dearest_, [&](const auto& kept) { return std::abs(kept.second["t"].template get<double>() - time) < kApart; });
    if (dearest_.size() == kDearestFrames && triangles <= dearest_.back().first) return;
    dearest_.emplace_back(triangles, frameJson(row));
    std::stable_sort(dearest_.begin(), dearest_.end(), [](const auto& a, const auto& b) { return a.first > b.first; });
    if (dearest_.size() > kDearestFrames) dearest_.pop_back();
}

void Overview::add(const FrameRow& row) {
    const double triangles = orZero(of("static_triangles", row));
    if (points_.empty() || points_.back().frames == share_) points_.emplace_back();
    addTo(points_.back(), row, triangles);
    keepDearest(row, triangles);
    for (size_t k = 0; k < kDistributed.size(); ++k) distributions_[k].add(of(kDistributed[k].metric, row));
    for (const std::string& name : kSums) sums_[name] += orZero(of(name, row));
    verified_ += std::isnan(of("frame_verified_texels", row)) ? 0 : 1;
    if (cascades_.size() < row.cascades.size()) cascades_.resize(row.cascades.size());
    for (size_t c = 0; c < row.cascades.size(); ++c) {
        const auto value = [&](const char* name) { return row.cascades[c].values[column_.at(name)]; };
        Cascade& sum = cascades_[c];
        sum.triangles += orZero(value("static_triangles"));
        sum.texels += orZero(value("static_texels"));
        sum.redrawTriangles += orZero(value("redraw_triangles"));
        sum.redrawTexels += orZero(value("redraw_texels"));
        sum.touched += value("static_texels") > 0 ? 1 : 0;
        sum.asleep += orZero(value("asleep"));
        sum.ms += orZero(value("t_gpu_static_ms"));
        if (std::isnan(value("t_redraw_static_ms"))) continue;
        sum.cached.add(value("t_gpu_static_ms"));
        sum.redrawn.add(value("t_redraw_static_ms"));
    }
}

Json Overview::seriesJson() const {
    Json first = Json::array(), most = Json::array(), mostTexels = Json::array(), redraw = Json::array(), frames = Json::array();
    Json triangles = Json::object(), texels = Json::object(), series = Json::object();
    for (const Point& p : points_) {
        first.push_back(p.first);
        most.push_back(int64_t(p.most));
        mostTexels.push_back(int64_t(p.mostTexels));
        redraw.push_back(int64_t(p.redraw / double(p.frames)));
        frames.push_back(p.dearest);
    }
    for (size_t k = 0; k < cache::kCauses; ++k) {
        std::vector<double> ofTriangles, ofTexels;
        double all = 0;
        for (const Point& p : points_) {
            ofTriangles.push_back(std::round(p.triangles[k] / double(p.frames)));
            ofTexels.push_back(std::round(p.texels[k] / double(p.frames)));
            all += p.texels[k] + p.triangles[k];
        }
        if (all == 0) continue;
        triangles[cache::toString(cache::Cause(k))] = list(ofTriangles);
        texels[cache::toString(cache::Cause(k))] = list(ofTexels);
    }
    for (size_t k = 0; k < kSeries.size(); ++k) {
        std::vector<double> values;
        for (const Point& p : points_) values.push_back(p.series[k]);
        series[kSeries[k].metric] = list(values);
    }
    return {{"share", share_}, {"first", first}, {"most", most}, {"mostTexels", mostTexels}, {"redraw", redraw},
            {"triangles", triangles}, {"texels", texels}, {"series", series}, {"frames", frames}};
}

Json Overview::cascadesJson() const {
    Json out = Json::array();
    for (Cascade c : cascades_)
        out.push_back({{"triangles", c.triangles}, {"texels", c.texels}, {"redrawTriangles", c.redrawTriangles}, {"redrawTexels", c.redrawTexels},
                       {"touched", c.touched}, {"asleep", c.asleep}, {"cachedMs", rounded(c.cached.quantile(0.5))},
                       {"redrawMs", rounded(c.redrawn.quantile(0.5))}, {"timed", c.cached.count()}});
    return out;
}

Json Overview::occlusionJson() const {
    // A hidden triangle is taken to save the mean time of a drawn one.
    const double drawn = sums_.at("static_triangles"), hidden = sums_.at("triangles_hidden");
    return {{"rays", sums_.at("frame_rays")}, {"certificates", sums_.at("frame_certificates")}, {"revocations", sums_.at("frame_revocations")},
            {"found", sums_.at("clusters_found")}, {"hidden", sums_.at("clusters_hidden")}, {"triangles", hidden}, {"drawn", drawn},
            {"searchMs", rounded(sums_.at("t_frame_occlusion_ms"))}, {"savedMs", drawn > 0 ? rounded(hidden * sums_.at("t_gpu_static_ms") / drawn) : 0}};
}

Json Overview::json() {
    Json settings = Json::parse(record_.settings, nullptr, false), summary = Json::parse(record_.summary, nullptr, false);
    if (settings.is_discarded()) settings = Json::object();
    Json geometry = Json::array();
    if (summary.is_object() && summary.contains("cascades") && summary["cascades"].is_array())
        for (const Json& c : summary["cascades"])
            if (c.is_object()) geometry.push_back({c.value("texel_m", 0.0), c.value("split_m", 0.0)});
    Json spots = Json::array();
    if (summary.is_object() && summary.contains("spots") && summary["spots"].is_array()) spots = summary["spots"];
    Json distributions = Json::array(), sums = Json::object(), dearest = Json::array();
    for (size_t k = 0; k < kDistributed.size(); ++k) {
        Distribution& d = distributions_[k];
        if (d.count() == 0 || d.quantile(1) == 0) continue;
        std::vector<double> curve;
        for (int q = 0; q <= 100; ++q) curve.push_back(d.quantile(q / 100.0));
        distributions.push_back({{"metric", kDistributed[k].metric}, {"label", kDistributed[k].label}, {"unit", kDistributed[k].unit},
                                 {"frames", d.count()}, {"mean", d.mean()}, {"p50", d.quantile(0.5)}, {"p95", d.quantile(0.95)},
                                 {"p99", d.quantile(0.99)}, {"max", d.quantile(1)}, {"curve", list(curve)}});
    }
    for (const auto& [name, value] : sums_) sums[name] = rounded(value);
    for (const auto& [triangles, frame] : dearest_) dearest.push_back(frame);
    const bool frames = !points_.empty();
    return {{"kind", record_.kind}, {"name", record_.name}, {"verdict", record_.verdict}, {"world", record_.world},
            {"worldHash", record_.worldHash}, {"source", record_.source}, {"chunk", record_.chunkSize}, {"path", record_.path},
            {"movers", record_.movers}, {"frames", record_.frames}, {"device", record_.device}, {"driver", record_.driver},
            {"machine", record_.machine}, {"threads", record_.threads}, {"program", record_.program}, {"started", record_.started},
            {"wall", record_.wallSeconds}, {"settings", settings}, {"geometry", geometry}, {"verifiedFrames", verified_},
            {"begins", frames ? points_.front().dearest["t"] : Json(0)}, {"ends", frames ? points_.back().dearest["t"] : Json(0)},
            {"sums", sums}, {"series", frames ? seriesJson() : Json()}, {"cascades", cascadesJson()}, {"spots", spots}, {"dearest", dearest},
            {"distributions", distributions}, {"occlusion", frames ? occlusionJson() : Json()}};
}

}  // namespace tools::report
