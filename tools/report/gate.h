// tools/report/gate.h — rules that a run must keep, for a build to fail on: "triangles.p99 <= 1.05x; unknown_texels.max == 0".
#pragma once

#include <string>
#include <vector>

#include "tools/report/metric.h"

namespace tools::report {

/// COLUMN.STATISTIC OPERATOR NUMBER[x]. With an x the number is a multiple of what the run before had.
struct Rule {
    std::string text;
    Metric metric;
    std::string statistic, comparison;
    double limit = 0;
    bool relative = false;
};

/// A file of rules, or the rules themselves; one a line or with ';' between them, '#' begins a comment. kUsage names the
/// rule, its line, and of a name that is not there the nearest that is.
world::Result<std::vector<Rule>> readRules(const std::string& fileOrText, const ResultColumns& columns);

struct Verdict {
    std::string text;  ///< of the rule
    double value = 0, limit = 0;
    bool kept = false;
};

/// What came of the rules for a run. `before`: the run that relative rules ask about; null: there is none, and they are
/// kUsage.
world::Result<std::vector<Verdict>> judge(const std::vector<Rule>& rules, RunFile& run, RunFile* before);

/// A line a rule.
std::string toText(const std::vector<Verdict>& verdicts);

}  // namespace tools::report
