#include "tools/frames_csv.h"

#include <charconv>
#include <concepts>
#include <cstdio>
#include <utility>

namespace tools {
namespace {

using cache::CascadeStatistics;
using cache::Cost;

void append(std::string& out, std::integral auto value) { out += std::to_string(value); }

/// The shortest text that reads back as the same number.
void append(std::string& out, double value) {
    char text[32];
    const auto end = std::to_chars(text, text + sizeof text, value).ptr;
    out.append(text, end);
}

void appendHash(std::string& out, uint64_t hash) {
    char text[20];
    std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(hash));
    out += text;
}

/// Microseconds are finer than any clock's noise here.
void appendMs(std::string& out, double ms) {
    char text[32];
    std::snprintf(text, sizeof text, "%.4f", ms);
    out += text;
}

/// Columns as they are listed; each kind of column has its own way to be added.
struct Columns {
    std::vector<FrameColumn> list;

    void frame(const std::string& name, auto get) {
        list.push_back(
            {name, [get](const ReplayFrame& f, size_t, std::string& out) { append(out, get(f)); }});
    }
    void cascade(const std::string& name, auto get) {
        list.push_back({name, [get](const ReplayFrame& f, size_t c, std::string& out) {
                            append(out, get(f.report.cascades[c]));
                        }});
    }
    /// What all spot lights' cache maps took.
    void spots(const std::string& name, uint64_t Cost::*part) {
        frame(name, [part](const ReplayFrame& f) {
            uint64_t sum = 0;
            for (const server::SpotReport& spot : f.report.spots) sum += spot.cost.statics.*part;
            return sum;
        });
    }
    /// Four columns; `get` returns a Cost of a frame and cascade.
    void cost(const std::string& prefix, auto get) {
        const std::pair<const char*, uint64_t Cost::*> parts[] = {{"_texels", &Cost::texels},
                                                                  {"_casters", &Cost::casters},
                                                                  {"_triangles", &Cost::triangles},
                                                                  {"_draws", &Cost::draws}};
        for (const auto& [suffix, part] : parts)
            list.push_back(
                {prefix + suffix, [get, part = part](const ReplayFrame& f, size_t c, std::string& out) {
                     append(out, get(f, c).*part);
                 }});
    }
    /// `get` returns a time of a frame.
    void frameMs(const std::string& name, auto get) {
        list.push_back(
            {name, [get](const ReplayFrame& f, size_t, std::string& out) { appendMs(out, get(f)); }});
    }
};

void addWindow(Columns& columns) {
    columns.frame("frame", [](const ReplayFrame& f) { return f.number; });
    columns.frame("time", [](const ReplayFrame& f) { return f.report.time; });
    columns.list.push_back(
        {"cascade", [](const ReplayFrame&, size_t c, std::string& out) { append(out, c); }});
    columns.cascade("window_x", [](const CascadeStatistics& s) { return s.window.x; });
    columns.cascade("window_y", [](const CascadeStatistics& s) { return s.window.y; });
    columns.cascade("move_x", [](const CascadeStatistics& s) { return s.move.x; });
    columns.cascade("move_y", [](const CascadeStatistics& s) { return s.move.y; });
}

void addCosts(Columns& columns) {
    for (size_t cause = 0; cause < cache::kCauses; ++cause)
        columns.cost(cache::toString(static_cast<cache::Cause>(cause)),
                     [cause](const ReplayFrame& f, size_t c) { return f.report.cascades[c].byCause[cause]; });
    columns.cost("static", [](const ReplayFrame& f, size_t c) { return f.report.cascades[c].total; });
    columns.cost("active", [](const ReplayFrame& f, size_t c) { return f.report.cascades[c].active; });
    columns.cost("redraw", [](const ReplayFrame& f, size_t c) { return f.redraw[c]; });
    columns.cascade("clusters_found", [](const CascadeStatistics& s) { return s.clustersFound; });
    columns.cascade("clusters_hidden", [](const CascadeStatistics& s) { return s.clustersHidden; });
    columns.cascade("triangles_hidden", [](const CascadeStatistics& s) { return s.trianglesHidden; });
}

void addDebts(Columns& columns) {
    columns.cascade("casters_dropped", [](const CascadeStatistics& s) { return s.castersDropped; });
    columns.cascade("asleep", [](const CascadeStatistics& s) { return int(s.asleep); });
    columns.cascade("unknown_texels", [](const CascadeStatistics& s) { return s.unknownTexels; });
    columns.cascade("stale_texels", [](const CascadeStatistics& s) { return s.staleTexels; });
    columns.cascade("oldest_debt", [](const CascadeStatistics& s) { return s.oldestDebt; });
    columns.cascade("missing_texels", [](const CascadeStatistics& s) { return s.missingTexels; });
    columns.cascade("coarse_texels", [](const CascadeStatistics& s) { return s.coarseTexels; });
    const auto limit = [](uint64_t value, std::string& out) {
        if (value != cache::Limits::kNone) append(out, value);
    };
    columns.cascade("sun_error", [](const CascadeStatistics& s) { return s.sunError; });
    columns.frame("frame_sun_lag", [](const ReplayFrame& f) { return f.report.sun.lag; });
    columns.frame("frame_sun_weight", [](const ReplayFrame& f) { return f.report.sun.weight; });
    columns.frame("frame_sun_redrawn", [](const ReplayFrame& f) { return int(f.report.sun.redrawn); });
    columns.list.push_back({"frame_limit_texels", [limit](const ReplayFrame& f, size_t, std::string& out) {
                                limit(f.report.limits.texels, out);
                            }});
    columns.list.push_back({"frame_limit_triangles", [limit](const ReplayFrame& f, size_t, std::string& out) {
                                limit(f.report.limits.triangles, out);
                            }});
}

void addFrame(Columns& columns) {
    columns.frame("frame_chunk_arrivals", [](const ReplayFrame& f) { return f.report.chunkArrivals; });
    columns.frame("frame_chunk_departures", [](const ReplayFrame& f) { return f.report.chunkDepartures; });
    columns.frame("frame_chunk_refinements", [](const ReplayFrame& f) { return f.report.refinements; });
    columns.frame("frame_chunks_missing", [](const ReplayFrame& f) { return f.report.missingChunks; });
    columns.frame("frame_chunks_coarse", [](const ReplayFrame& f) { return f.report.coarseChunks; });
    columns.frame("frame_longest_lack", [](const ReplayFrame& f) { return f.report.longestLack; });
    columns.frame("frame_bytes_read", [](const ReplayFrame& f) { return f.report.bytesRead; });
    columns.frame("frame_bytes_again", [](const ReplayFrame& f) { return f.report.bytesAgain; });
    columns.frame("frame_resident_bytes", [](const ReplayFrame& f) { return f.report.residentBytes; });
    columns.frame("frame_geometry_bytes", [](const ReplayFrame& f) { return f.report.geometryBytes; });
    columns.frame("frame_bytes_uploaded", [](const ReplayFrame& f) { return f.report.bytesUploaded; });
    columns.frame("frame_rays", [](const ReplayFrame& f) { return f.report.rays; });
    columns.frame("frame_certificates", [](const ReplayFrame& f) { return f.report.certificates; });
    columns.frame("frame_revocations", [](const ReplayFrame& f) { return f.report.revocations; });
    columns.spots("frame_spot_texels", &Cost::texels);
    columns.spots("frame_spot_casters", &Cost::casters);
    columns.spots("frame_spot_triangles", &Cost::triangles);
    columns.spots("frame_spot_draws", &Cost::draws);
    columns.frame("frame_spot_active_triangles", [](const ReplayFrame& f) {
        uint64_t sum = 0;
        for (const server::SpotReport& spot : f.report.spots) sum += spot.cost.active.triangles;
        return sum;
    });
    columns.frame("frame_edits", [](const ReplayFrame& f) { return f.report.edits; });
    columns.frame("frame_errors", [](const ReplayFrame& f) { return f.report.errors.size(); });
    columns.list.push_back({"plan_hash", [](const ReplayFrame& f, size_t, std::string& out) {
                                appendHash(out, f.report.planHash);
                            }});
}

void addVerification(Columns& columns) {
    columns.list.push_back({"frame_verified_texels", [](const ReplayFrame& f, size_t, std::string& out) {
                                if (f.verify) append(out, f.verify->texels);
                            }});
    columns.list.push_back({"frame_skipped_texels", [](const ReplayFrame& f, size_t, std::string& out) {
                                if (f.verify) append(out, f.verify->stale);
                            }});
    columns.list.push_back({"frame_differing_texels", [](const ReplayFrame& f, size_t, std::string& out) {
                                if (f.verify) append(out, f.verify->differing);
                            }});
    columns.list.push_back({"cache_hash", [](const ReplayFrame& f, size_t c, std::string& out) {
                                if (!f.hashes.empty()) appendHash(out, f.hashes[c].cache);
                            }});
    columns.list.push_back({"working_hash", [](const ReplayFrame& f, size_t c, std::string& out) {
                                if (!f.hashes.empty()) appendHash(out, f.hashes[c].working);
                            }});
}

void addTimes(Columns& columns) {
    columns.frameMs("t_frame_begin_ms", [](const ReplayFrame& f) { return clockMs(f.report.begin); });
    columns.frameMs("t_frame_ms", [](const ReplayFrame& f) { return f.advanceMs; });
    columns.frameMs("t_frame_stream_ms", [](const ReplayFrame& f) { return f.report.cpu.streamMs; });
    columns.frameMs("t_frame_sets_ms", [](const ReplayFrame& f) { return f.report.cpu.setsMs; });
    columns.frameMs("t_frame_occlusion_ms", [](const ReplayFrame& f) { return f.report.cpu.occlusionMs; });
    columns.frameMs("t_frame_plan_ms", [](const ReplayFrame& f) { return f.report.cpu.planMs; });
    columns.frameMs("t_frame_record_ms", [](const ReplayFrame& f) { return f.report.cpu.recordMs; });
    columns.frameMs("t_frame_gpu_wall_ms", [](const ReplayFrame& f) { return f.report.gpu.wallMs; });
    columns.frameMs("t_frame_spots_ms", [](const ReplayFrame& f) { return f.report.gpu.spotsMs; });
    columns.list.push_back({"t_gpu_static_ms", [](const ReplayFrame& f, size_t c, std::string& out) {
                                appendMs(out, timesOf(f.report.gpu, c).staticMs);
                            }});
    columns.list.push_back({"t_gpu_active_ms", [](const ReplayFrame& f, size_t c, std::string& out) {
                                appendMs(out, timesOf(f.report.gpu, c).activeMs);
                            }});
    columns.list.push_back({"t_redraw_static_ms", [](const ReplayFrame& f, size_t c, std::string& out) {
                                if (f.verify) appendMs(out, timesOf(f.verify->redraw, c).staticMs);
                            }});
    columns.list.push_back({"t_frame_redraw_wall_ms", [](const ReplayFrame& f, size_t, std::string& out) {
                                if (f.verify) appendMs(out, f.verify->redraw.wallMs);
                            }});
}

}  // namespace

double clockMs(std::chrono::steady_clock::time_point time) {
    return std::chrono::duration<double, std::milli>(time.time_since_epoch()).count();
}

std::vector<FrameColumn> frameColumns() {
    Columns columns;
    addWindow(columns);
    addCosts(columns);
    addDebts(columns);
    addFrame(columns);
    addVerification(columns);
    addTimes(columns);
    return std::move(columns.list);
}

std::string csvHeader(const std::vector<FrameColumn>& columns) {
    std::string line;
    for (const FrameColumn& column : columns) line += (line.empty() ? "" : ",") + column.name;
    return line + '\n';
}

std::string csvRows(const std::vector<FrameColumn>& columns, const ReplayFrame& frame) {
    std::string rows;
    for (size_t c = 0; c < frame.report.cascades.size(); ++c) {
        for (size_t k = 0; k < columns.size(); ++k) {
            if (k > 0) rows += ',';
            columns[k].value(frame, c, rows);
        }
        rows += '\n';
    }
    return rows;
}

}  // namespace tools
