#include "tools/report/metric.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace tools::report {
namespace {

uint64_t partOf(const cache::Cost& cost, size_t part) {
    const uint64_t parts[] = {cost.texels, cost.casters, cost.triangles, cost.draws};
    return parts[part];
}

/// Letters that are to be put in, left out or exchanged. Source: Levenshtein, 1966; two rows of the table at a time.
size_t changes(const std::string& a, const std::string& b) {
    std::vector<size_t> row(b.size() + 1);
    std::iota(row.begin(), row.end(), size_t(0));
    for (size_t i = 0; i < a.size(); ++i) {
        size_t diagonal = std::exchange(row[0], i + 1);
        for (size_t j = 0; j < b.size(); ++j) {
            const size_t above = row[j + 1];
            row[j + 1] = std::min({above + 1, row[j] + 1, diagonal + (a[i] == b[j] ? 0 : 1)});
            diagonal = above;
        }
    }
    return row.back();
}

std::string columnOf(const std::string& name) {
    for (const char* part : kCostParts)
        if (name == part) return "static_" + name;
    return name == "ms" ? "t_frame_ms" : name;
}

}  // namespace

double Metric::operator()(const FrameRow& row) const {
    if (of == Of::kFrame) return row.values[column];
    double sum = 0;
    for (const FrameRow::Cascade& cascade : row.cascades)
        sum += of == Of::kCause ? double(partOf(cascade.byCause[column], part)) : cascade.values[column];
    return row.cascades.empty() ? std::numeric_limits<double>::quiet_NaN() : sum;
}

std::vector<Metric> allMetrics(const ResultColumns& columns) {
    std::vector<Metric> all;
    for (size_t k = 0; k < columns.frame.size(); ++k)
        if (!columns.frame[k].text) all.push_back({columns.frame[k].column.name, Metric::Of::kFrame, k, 0});
    for (size_t k = 0; k < columns.cascade.size(); ++k)
        if (!columns.cascade[k].text) all.push_back({columns.cascade[k].column.name, Metric::Of::kCascade, k, 0});
    for (size_t cause = 0; cause < cache::kCauses; ++cause)
        for (size_t part = 0; part < kCostParts.size(); ++part)
            all.push_back({std::string(cache::toString(cache::Cause(cause))) + "_" + kCostParts[part], Metric::Of::kCause, cause, part});
    return all;
}

world::Result<Metric> metricNamed(const std::string& name, const ResultColumns& columns) {
    const std::vector<Metric> all = allMetrics(columns);
    const std::string wanted = columnOf(name);
    std::vector<std::string> names(kCostParts.begin(), kCostParts.end());
    for (const Metric& metric : all) {
        if (metric.name == wanted) return metric;
        names.push_back(metric.name);
    }
    return world::Error{world::ErrorCode::kUsage, "there is no column " + name + "; the nearest is " + nearestWord(name, names) +
                                                      ", docs/columns.md has all"};
}

Metric metricOf(const std::string& name, const ResultColumns& columns) {
    auto metric = metricNamed(name, columns);
    CHECK(metric);
    return metric.value();
}

std::string nearestWord(const std::string& word, const std::vector<std::string>& words) {
    return *std::min_element(words.begin(), words.end(),
                             [&](const std::string& a, const std::string& b) { return changes(word, a) < changes(word, b); });
}

void Distribution::add(double value) {
    if (std::isnan(value)) return;
    values_.push_back(value);
    sum_ += value;
    sorted_ = false;
}

double Distribution::quantile(double q) {
    if (values_.empty()) return 0;
    if (!std::exchange(sorted_, true)) std::sort(values_.begin(), values_.end());
    const double rank = std::ceil(q * double(values_.size()));
    return values_[size_t(std::clamp(rank, 1.0, double(values_.size()))) - 1];
}

}  // namespace tools::report
