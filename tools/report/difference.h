// tools/report/difference.h — two runs of the same path: what got dearer or cheaper, by cause, place and caster.
#pragma once

#include <array>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "tools/report/run_file.h"

namespace tools::report {

/// Triangles of the static part of both runs, or another sum.
struct Pair {
    double a = 0, b = 0;
    double change() const { return b - a; }
};

/// A setting, a file or a machine in which the runs differ.
struct OtherInput {
    std::string name, a, b;
};

/// Part of a run's cost, with frames to look at: those in which it changed most.
struct Change {
    std::string name;
    Pair triangles, texels;
    std::vector<uint64_t> frames;  ///< most changed first, at most three; of a caster those that had it among their dearest
};

/// A time, over repeated runs: medians over a run's frames, their mean over the runs of each side.
struct TimeChange {
    std::string name;
    Pair mean;                  ///< [ms]
    size_t runsA = 0, runsB = 0;
    std::optional<double> half; ///< of the 95 % confidence interval of the change [ms] (Welch); none for single runs
};

struct Difference {
    std::string a, b;  ///< names of the runs
    std::vector<OtherInput> inputs;
    uint64_t frames = 0;
    uint64_t differing = 0;  ///< frames in which some counter differs
    std::vector<std::pair<std::string, Pair>> counters;  ///< sums of the deterministic columns that differ in some frame
    std::vector<Change> causes, places, casters;  ///< that changed, most changed first
    std::vector<uint64_t> look;                   ///< frames that changed most
    std::vector<TimeChange> times;
};

/// kUsage for runs that cannot be compared; the text says why. Counters are compared exactly, frame by frame.
///   follow  frames done, of how many
world::Result<Difference> compare(RunFile& a, RunFile& b, const std::function<void(size_t, size_t)>& follow);

/// For people, many lines.
std::string toText(const Difference& difference);

}  // namespace tools::report
