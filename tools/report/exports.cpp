#include "tools/report/exports.h"

#include <zlib.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <ostream>

#include "tools/report/metric.h"

namespace tools::report {
namespace {

using Json = nlohmann::ordered_json;
using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

/// Hands each frame to `visit`, which may end it with an error.
Result<Done> eachFrame(RunFile& run, const Follow& follow, const std::function<Result<Done>(const FrameRow&)>& visit) {
    auto cursor = run.frames();
    if (!cursor) return cursor.error();
    const auto total = size_t(run.record().frames);
    FrameRow row;
    for (size_t done = 0;; follow(std::min(++done, total), total)) {
        const auto more = cursor.value().next(row);
        if (!more) return more.error();
        if (!more.value()) return Done{};
        if (const auto visited = visit(row); !visited) return visited;
    }
}

/// As frames.csv writes it: times with four digits after the point, else the shortest text that reads back the same.
void appendNumber(std::string& out, double value, bool time) {
    if (std::isnan(value)) return;
    char text[64];
    if (time)
        out.append(text, size_t(std::snprintf(text, sizeof text, "%.4f", value)));
    else if (value == std::floor(value) && std::abs(value) < 9e15)
        out += std::to_string(int64_t(value));
    else
        out.append(text, std::to_chars(text, text + sizeof text, value).ptr);
}

/// Where the cell of a column of frames.csv is to be found.
struct Place {
    std::string name;
    enum class In { kFrame, kCascadeNumber, kFrameTable, kCascadeTable, kCause } in = In::kFrame;
    size_t column = 0, part = 0;
    bool text = false;
    size_t textColumn = 0;  ///< among the texts of its table
};

std::vector<Place> places(const ResultColumns& columns) {
    std::vector<Place> list;
    const auto find = [](const std::vector<ResultColumn>& table, const std::string& name, Place::In in, Place& place) {
        size_t texts = 0;
        for (size_t k = 0; k < table.size(); ++k) {
            if (table[k].column.name == name) {
                place.in = in;
                place.column = k;
                place.text = table[k].text;
                place.textColumn = texts;
            }
            texts += table[k].text ? 1 : 0;
        }
    };
    for (const FrameColumn& column : frameColumns()) {
        Place place{column.name, Place::In::kFrame, 0, 0, false, 0};
        if (column.name == "cascade") place.in = Place::In::kCascadeNumber;
        if (const auto cause = causeColumn(column.name)) {
            place.in = Place::In::kCause;
            place.column = size_t(cause->first);
            place.part = cause->second;
        }
        find(columns.frame, column.name, Place::In::kFrameTable, place);
        find(columns.cascade, column.name, Place::In::kCascadeTable, place);
        list.push_back(place);
    }
    return list;
}

void appendCell(std::string& out, const Place& place, const FrameRow& row, size_t cascade) {
    const FrameRow::Cascade& c = row.cascades[cascade];
    const bool time = place.name.starts_with("t_");
    switch (place.in) {
        case Place::In::kFrame: out += std::to_string(row.number); break;
        case Place::In::kCascadeNumber: out += std::to_string(cascade); break;
        case Place::In::kFrameTable:
            if (place.text) out += row.texts[place.textColumn];
            else appendNumber(out, row.values[place.column], time);
            break;
        case Place::In::kCascadeTable:
            if (place.text) out += c.texts[place.textColumn];
            else appendNumber(out, c.values[place.column], time);
            break;
        case Place::In::kCause: {
            const cache::Cost& cost = c.byCause[place.column];
            const uint64_t parts[] = {cost.texels, cost.casters, cost.triangles, cost.draws};
            out += std::to_string(parts[place.part]);
        }
    }
}

/// A gzip file that is written piece by piece, beside its name, and renamed when it is whole.
class GzipFile {
public:
    explicit GzipFile(const std::string& path) : path_(path), file_(gzopen((path + ".partial").c_str(), "wb6")) {}
    ~GzipFile() {
        if (!file_) return;
        gzclose(file_);
        std::remove((path_ + ".partial").c_str());
    }
    GzipFile(const GzipFile&) = delete;
    GzipFile& operator=(const GzipFile&) = delete;
    Result<Done> write(const std::string& text) {
        if (file_ && (text.empty() || gzwrite(file_, text.data(), unsigned(text.size())) == int(text.size()))) return Done{};
        return failed();
    }
    Result<Done> close() {
        if (!file_ || gzclose(std::exchange(file_, nullptr)) != Z_OK || std::rename((path_ + ".partial").c_str(), path_.c_str()) != 0) return failed();
        return Done{};
    }

private:
    Error failed() const { return {ErrorCode::kIo, path_ + ": cannot be written; make room or give another file"}; }
    std::string path_;
    gzFile file_;
};

/// Events of a timeline; times in microseconds.
class Timeline {
public:
    explicit Timeline(GzipFile& file) : file_(file) {}
    Result<Done> begin() { return file_.write("{\"displayTimeUnit\":\"ms\",\"traceEvents\":["); }
    Result<Done> end() { return file_.write("]}\n"); }
    Result<Done> name(int track, const std::string& text) {
        return add({{"ph", "M"}, {"pid", 1}, {"tid", track}, {"name", "thread_name"}, {"args", {{"name", text}}}});
    }
    Result<Done> slice(int track, const std::string& text, double begin, double length, const Json& args = Json::object()) {
        return add({{"ph", "X"}, {"pid", 1}, {"tid", track}, {"name", text}, {"ts", begin}, {"dur", length}, {"args", args}});
    }
    Result<Done> counter(const std::string& text, double at, double value) {
        return add({{"ph", "C"}, {"pid", 1}, {"name", text}, {"ts", at}, {"args", {{"value", value}}}});
    }

private:
    Result<Done> add(const Json& event) {
        const std::string text = (first_ ? "\n" : ",\n") + event.dump(-1, ' ', false, Json::error_handler_t::replace);
        first_ = false;
        return file_.write(text);
    }
    GzipFile& file_;
    bool first_ = true;
};

constexpr int kCpu = 1, kGpu = 2, kReader = 3;  ///< tracks; readers are numbered from there

/// A frame's slices from `begin` on [us]; they end within `length`.
Result<Done> addFrame(Timeline& timeline, const FrameRow& row, const std::function<double(const char*)>& of, const std::vector<std::pair<double, double>>& passes,
                      double begin, double length) {
    const auto us = [&](const char* name) { return std::max(0.0, of(name)) * 1000; };
    if (const auto done = timeline.slice(kCpu, "frame " + std::to_string(row.number), begin, length,
                                         {{"triangles", of("static_triangles")}, {"texels", of("static_texels")}, {"time_s", of("time")}});
        !done)
        return done;
    double at = begin;
    const auto stage = [&](const char* name, double takes) -> Result<Done> {
        takes = std::min(takes, begin + length - at);
        const double from = at;
        at += takes;
        return takes > 0 ? timeline.slice(kCpu, name, from, takes) : Done{};
    };
    for (const auto& [name, metric] : {std::pair("stream", "t_frame_stream_ms"), std::pair("sets", "t_frame_sets_ms"), std::pair("occlusion", "t_frame_occlusion_ms"),
                                       std::pair("plan", "t_frame_plan_ms"), std::pair("record", "t_frame_record_ms")})
        if (const auto done = stage(name, us(metric)); !done) return done;
    const double wall = std::min(us("t_frame_gpu_wall_ms"), begin + length - at), submitted = at;
    if (const auto done = stage("wait for the GPU", wall); !done) return done;
    if (wall > 0) {
        if (const auto done = timeline.slice(kGpu, "frame " + std::to_string(row.number), submitted, wall); !done) return done;
        double pass = submitted;
        for (size_t c = 0; c < passes.size(); ++c)
            for (const auto& [kind, ms] : {std::pair("static", passes[c].first), std::pair("active", passes[c].second)}) {
                const double takes = std::min(ms * 1000, submitted + wall - pass);
                if (!(takes > 0)) continue;
                if (const auto done = timeline.slice(kGpu, "cascade " + std::to_string(c) + " " + kind, pass, takes); !done) return done;
                pass += takes;
            }
    }
    for (const auto& [name, metric] : {std::pair("bytes read", "frame_bytes_read"), std::pair("bytes in memory", "frame_resident_bytes"),
                                       std::pair("chunks that maps lack", "frame_chunks_missing"), std::pair("triangles", "static_triangles")})
        if (const auto done = timeline.counter(name, begin, of(metric)); !done) return done;
    return Done{};
}

}  // namespace

Result<Done> writeCsv(RunFile& run, std::ostream& out, const Follow& follow) {
    out << csvHeader(frameColumns());
    const std::vector<Place> columns = places(run.columns());
    std::string rows;
    return eachFrame(run, follow, [&](const FrameRow& row) -> Result<Done> {
        rows.clear();
        for (size_t c = 0; c < row.cascades.size(); ++c) {
            for (size_t k = 0; k < columns.size(); ++k) {
                if (k > 0) rows += ',';
                appendCell(rows, columns[k], row, c);
            }
            rows += '\n';
        }
        out << rows;
        return Done{};
    });
}

Result<std::string> benchmarkJson(RunFile& run, const Follow& follow) {
    std::vector<Metric> times, counters;
    for (const Metric& metric : allMetrics(run.columns()))
        if (metric.measured() && metric.name != "t_frame_begin_ms") times.push_back(metric);
    for (const char* name : {"static_triangles", "static_texels", "static_casters", "static_draws", "redraw_triangles", "frame_rays", "frame_bytes_read"})
        counters.push_back(metricOf(name, run.columns()));
    std::vector<Distribution> ofTimes(times.size()), ofCounters(counters.size());
    const auto done = eachFrame(run, follow, [&](const FrameRow& row) -> Result<Done> {
        for (size_t k = 0; k < times.size(); ++k) ofTimes[k].add(times[k](row));
        for (size_t k = 0; k < counters.size(); ++k) ofCounters[k].add(counters[k](row));
        return Done{};
    });
    if (!done) return done.error();
    Json benchmarks = Json::array();
    for (size_t k = 0; k < times.size(); ++k) {
        if (ofTimes[k].count() == 0) continue;
        const double ms = ofTimes[k].quantile(0.5);
        Json entry{{"name", run.record().kind + "/" + times[k].name}, {"run_name", run.record().kind + "/" + times[k].name}, {"run_type", "iteration"},
                   {"repetitions", 1}, {"repetition_index", 0}, {"threads", run.record().threads}, {"iterations", ofTimes[k].count()},
                   {"real_time", ms}, {"cpu_time", ms}, {"time_unit", "ms"}, {"mean", ofTimes[k].mean()}, {"p95", ofTimes[k].quantile(0.95)},
                   {"p99", ofTimes[k].quantile(0.99)}, {"max", ofTimes[k].quantile(1)}};
        // What was drawn stands beside the time of the whole frame.
        if (times[k].name == "t_frame_ms")
            for (size_t c = 0; c < counters.size(); ++c) entry[counters[c].name] = ofCounters[c].mean();
        benchmarks.push_back(entry);
    }
    const Json document{{"context", {{"date", run.record().started}, {"host_name", run.record().machine}, {"executable", "gnomon"},
                                     {"num_cpus", run.record().threads}, {"run", run.name()}, {"world", run.record().world}, {"device", run.record().device}}},
                        {"benchmarks", benchmarks}};
    return document.dump(2, ' ', false, Json::error_handler_t::replace) + '\n';
}

Result<Done> writeTimeline(RunFile& run, const std::string& path, const Follow& follow) {
    GzipFile file(path);
    Timeline timeline(file);
    if (const auto done = timeline.begin(); !done) return done;
    if (const auto done = timeline.name(kCpu, "frames"); !done) return done;
    if (const auto done = timeline.name(kGpu, "GPU"); !done) return done;
    std::map<std::string, Metric> metrics;
    for (const Metric& metric : allMetrics(run.columns())) metrics[metric.name] = metric;
    size_t statics = 0, actives = 0;
    for (size_t k = 0; k < run.columns().cascade.size(); ++k) {
        if (run.columns().cascade[k].column.name == "t_gpu_static_ms") statics = k;
        if (run.columns().cascade[k].column.name == "t_gpu_active_ms") actives = k;
    }
    std::optional<double> origin;  // [ms]
    size_t readers = 0;
    const auto done = eachFrame(run, follow, [&](const FrameRow& row) -> Result<Done> {
        const auto of = [&](const char* name) {
            const double value = metrics.at(name)(row);
            return std::isnan(value) ? 0 : value;
        };
        const double began = of("t_frame_begin_ms");
        if (!origin) origin = began;
        std::vector<std::pair<double, double>> passes;
        for (const FrameRow::Cascade& c : row.cascades) passes.emplace_back(c.values[statics], c.values[actives]);
        if (const auto added = addFrame(timeline, row, of, passes, (began - *origin) * 1000, of("t_frame_ms") * 1000); !added) return added;
        for (const ReadRow& read : row.reads) {
            for (; readers <= read.thread; ++readers)
                if (const auto named = timeline.name(kReader + int(readers), "reader " + std::to_string(readers)); !named) return named;
            const auto added = timeline.slice(kReader + int(read.thread), read.name, (read.beginMs - *origin) * 1000, read.ms * 1000,
                                              {{"bytes", read.bytes}, {"frame", row.number}});
            if (!added) return added;
        }
        return Done{};
    });
    if (!done) return done;
    if (const auto ended = timeline.end(); !ended) return ended;
    return file.close();
}

}  // namespace tools::report
