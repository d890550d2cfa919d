// tools/report/metric.h — a number that each frame of a run has, by the name of its column.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "tools/report/run_file.h"
#include "world/result.h"

namespace tools::report {

/// A column of docs/columns.md that holds numbers. Columns of cascades and causes are summed over the cascades.
/// "texels", "casters", "triangles" and "draws" stand for the `static_` columns, "ms" for `t_frame_ms`.
struct Metric {
    std::string name;
    enum class Of { kFrame, kCascade, kCause } of = Of::kFrame;
    size_t column = 0;  ///< in its table, or the cause
    size_t part = 0;    ///< of a cause's cost
    bool measured() const { return name.starts_with("t_"); }
    double operator()(const FrameRow& row) const;  ///< NaN where the frame has none
};

/// All that there are, those of causes too.
std::vector<Metric> allMetrics(const ResultColumns& columns);
/// kUsage for a name that no column has; the text tells the nearest that one has.
world::Result<Metric> metricNamed(const std::string& name, const ResultColumns& columns);
/// One that is known to be there.
Metric metricOf(const std::string& name, const ResultColumns& columns);

/// The word of `words` that takes the fewest changes of a letter to become `word` (Levenshtein); `words` is not empty.
std::string nearestWord(const std::string& word, const std::vector<std::string>& words);

/// Values of a metric over the frames of a run, and what is asked of them.
class Distribution {
public:
    void add(double value);  ///< NaN is left out
    size_t count() const { return values_.size(); }
    double sum() const { return sum_; }
    double mean() const { return values_.empty() ? 0 : sum_ / double(values_.size()); }
    /// The value that a share `q` in [0, 1] does not exceed (nearest rank); 0 for none.
    double quantile(double q);

private:
    std::vector<double> values_;
    double sum_ = 0;
    bool sorted_ = false;
};

}  // namespace tools::report
