// tools/report/overview.h — what a page shows of a run: its frames brought down to a few thousand points, its dearest
// frames whole, sums and distributions. Takes as much memory for any number of frames, but for a few numbers of each.
#pragma once

#include <nlohmann/json.hpp>

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "tools/report/metric.h"

namespace tools::report {

constexpr size_t kPoints = 2000;       ///< most that a series has; more frames share one
constexpr size_t kDearestFrames = 8;   ///< shown whole
constexpr double kApart = 1;           ///< [s] between two of them: what one costs, its neighbours often cost too

/// One run, frame by frame.
class Overview {
public:
    Overview(const RunRecord& record, const ResultColumns& columns);
    void add(const FrameRow& row);
    /// Ends the run; what the page's script calls a run, without pictures and methods.
    nlohmann::ordered_json json();

private:
    using Json = nlohmann::ordered_json;
    /// Consecutive frames that share a point: means and sums, and of the dearest of them all.
    struct Point {
        uint64_t first = 0, frames = 0;
        std::vector<double> triangles, texels;  ///< by cause, summed
        std::vector<double> series;             ///< by kSeries: the most of a frame, or the sum
        double most = -1;                       ///< triangles of the dearest
        double mostTexels = 0;                  ///< of a frame
        double redraw = 0;                      ///< triangles, summed
        Json dearest;
    };
    void addTo(Point& point, const FrameRow& row, double triangles);
    Json frameJson(const FrameRow& row) const;
    void keepDearest(const FrameRow& row, double triangles);
    Json seriesJson() const;
    Json cascadesJson() const;
    Json occlusionJson() const;
    double of(const std::string& name, const FrameRow& row) const { return metrics_.at(name)(row); }

    RunRecord record_;
    uint64_t share_;  ///< frames a point
    std::map<std::string, Metric> metrics_;
    std::vector<Point> points_;
    std::vector<std::pair<double, Json>> dearest_;  ///< triangles and frame
    std::vector<Distribution> distributions_;       ///< by kDistributed
    std::map<std::string, double> sums_;
    struct Cascade {
        double triangles = 0, texels = 0, redrawTriangles = 0, redrawTexels = 0, touched = 0, asleep = 0;
        double ms = 0;
        Distribution cached, redrawn;  ///< [ms] where both were measured
    };
    std::vector<Cascade> cascades_;
    double verified_ = 0;
    std::map<std::string, size_t> column_;  ///< of a cascade
};

}  // namespace tools::report
