#include "tools/report/gate.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <sstream>

namespace tools::report {
namespace {

using world::Error;
using world::ErrorCode;
using world::Result;

constexpr size_t kLongestRule = 200;  ///< [bytes]; the longest that makes sense has 80, and the nearest name to a longer one takes long

const std::array<std::pair<const char*, double>, 6> kQuantiles{
    {{"min", 0}, {"p50", 0.5}, {"p95", 0.95}, {"p99", 0.99}, {"p99.9", 0.999}, {"max", 1}}};

double statisticOf(Distribution& values, const std::string& name) {
    if (name == "sum") return values.sum();
    if (name == "mean") return values.mean();
    for (const auto& [word, q] : kQuantiles)
        if (name == word) return values.quantile(q);
    CHECK(false);
}

std::vector<std::string> statistics() {
    std::vector<std::string> names{"sum", "mean"};
    for (const auto& [word, q] : kQuantiles) names.push_back(word);
    return names;
}

bool holds(double value, const std::string& comparison, double limit) {
    if (comparison == "<=") return value <= limit;
    if (comparison == "<") return value < limit;
    if (comparison == ">=") return value >= limit;
    if (comparison == ">") return value > limit;
    return value == limit;
}

std::string trimmed(const std::string& text) {
    const size_t first = text.find_first_not_of(" \t"), last = text.find_last_not_of(" \t");
    return first == std::string::npos ? "" : text.substr(first, last - first + 1);
}

Result<Rule> parse(const std::string& text, const std::string& where, const ResultColumns& columns) {
    const auto wrong = [&](const std::string& what) { return Error{ErrorCode::kUsage, where + ": " + text + ": " + what}; };
    const size_t sign = std::min(text.find_first_of("<>="), text.size()), after = std::min(text.find_first_not_of("<>=", sign), text.size());
    const std::string name = trimmed(text.substr(0, sign)), comparison = text.substr(sign, after - sign), limit = trimmed(text.substr(after));
    const size_t dot = name.find('.');
    const bool compares = comparison == "<=" || comparison == "<" || comparison == ">=" || comparison == ">" || comparison == "==";
    if (text.size() > kLongestRule || !compares || dot == std::string::npos || limit.empty() || (name + limit).find_first_of(" \t") != std::string::npos)
        return wrong("no rule; give COLUMN.STATISTIC OPERATOR NUMBER, as in triangles.p99 <= 1.05x");
    Rule rule;
    rule.text = text;
    const auto metric = metricNamed(name.substr(0, dot), columns);
    if (!metric) return wrong(metric.error().what);
    rule.metric = metric.value();
    rule.statistic = name.substr(dot + 1);
    const std::vector<std::string> known = statistics();
    if (std::find(known.begin(), known.end(), rule.statistic) == known.end())
        return wrong("there is no statistic " + rule.statistic + "; the nearest is " + nearestWord(rule.statistic, known) +
                     " of sum, mean, min, p50, p95, p99, p99.9, max");
    rule.comparison = comparison;
    std::string number = limit;
    rule.relative = number.ends_with('x');
    if (rule.relative) number.pop_back();
    const auto [end, error] = std::from_chars(number.data(), number.data() + number.size(), rule.limit);
    if (error != std::errc() || end != number.data() + number.size() || !std::isfinite(rule.limit))
        return wrong(limit + " is no number; give one, with an x after it for a multiple of the run before");
    return rule;
}

/// Values of each rule's statistic.
Result<std::vector<double>> valuesOf(const std::vector<Rule>& rules, RunFile& run) {
    auto cursor = run.frames();
    if (!cursor) return cursor.error();
    std::vector<Distribution> values(rules.size());
    FrameRow row;
    for (;;) {
        const auto more = cursor.value().next(row);
        if (!more) return more.error();
        if (!more.value()) break;
        for (size_t k = 0; k < rules.size(); ++k) values[k].add(rules[k].metric(row));
    }
    std::vector<double> statistic;
    for (size_t k = 0; k < rules.size(); ++k) {
        // A rule over nothing would always hold.
        if (values[k].count() == 0)
            return Error{ErrorCode::kUsage, rules[k].text + ": no frame of " + run.name() + " has a value of " + rules[k].metric.name};
        statistic.push_back(statisticOf(values[k], rules[k].statistic));
    }
    return statistic;
}

}  // namespace

Result<std::vector<Rule>> readRules(const std::string& fileOrText, const ResultColumns& columns) {
    std::error_code ignored;
    const bool file = std::filesystem::is_regular_file(fileOrText, ignored);
    std::string text = fileOrText;
    if (file) {
        std::ifstream in(fileOrText);
        text.assign(std::istreambuf_iterator<char>(in), {});
        if (!in) return Error{ErrorCode::kIo, fileOrText + ": cannot be read; check its permissions"};
    }
    std::vector<Rule> rules;
    std::istringstream lines(text);
    int number = 0;
    for (std::string line; std::getline(lines, line);) {
        ++number;
        line = line.substr(0, line.find('#'));
        std::istringstream parts(line);
        for (std::string part; std::getline(parts, part, ';');) {
            const size_t first = part.find_first_not_of(" \t\r");
            if (first == std::string::npos) continue;
            part = part.substr(first, part.find_last_not_of(" \t\r") - first + 1);
            auto rule = parse(part, file ? fileOrText + ":" + std::to_string(number) : "--gate", columns);
            if (!rule) return rule.error();
            rules.push_back(std::move(rule.value()));
        }
    }
    if (rules.empty()) return Error{ErrorCode::kUsage, "--gate " + fileOrText + ": holds no rule; give one, as in triangles.p99 <= 1.05x"};
    return rules;
}

Result<std::vector<Verdict>> judge(const std::vector<Rule>& rules, RunFile& run, RunFile* before) {
    for (const Rule& rule : rules)
        if (rule.relative && !before)
            return Error{ErrorCode::kUsage, rule.text + ": a multiple of what? give the run before with --diff, or a number without x"};
    const auto values = valuesOf(rules, run);
    if (!values) return values.error();
    Result<std::vector<double>> old = std::vector<double>(rules.size());
    if (before) old = valuesOf(rules, *before);
    if (!old) return old.error();
    std::vector<Verdict> verdicts;
    for (size_t k = 0; k < rules.size(); ++k) {
        const double limit = rules[k].relative ? rules[k].limit * old.value()[k] : rules[k].limit;
        verdicts.push_back({rules[k].text, values.value()[k], limit, holds(values.value()[k], rules[k].comparison, limit)});
    }
    return verdicts;
}

std::string toText(const std::vector<Verdict>& verdicts) {
    std::string out;
    for (const Verdict& v : verdicts) {
        char line[512];
        std::snprintf(line, sizeof line, "%-6s %s: %.10g against %.10g\n", v.kept ? "kept" : "BROKEN", v.text.c_str(), v.value, v.limit);
        out += line;
    }
    return out;
}

}  // namespace tools::report
