// tools/frames_csv.h — frames.csv: one row per frame and cascade, every count of a replay.
// The columns are documented in docs/columns.md, by name and in order.
#pragma once

#include <chrono>
#include <functional>
#include <string>
#include <vector>

#include "tools/replay.h"

namespace tools {

/// One column; `value` appends the cell of a frame and cascade to the text, or nothing where the
/// frame has none. Columns whose name starts with "t_" are times and differ from run to run; all
/// others are equal for equal input, whatever the number of threads.
struct FrameColumn {
    std::string name;
    std::function<void(const ReplayFrame&, size_t cascade, std::string&)> value;
};

/// As columns have a moment [ms].
double clockMs(std::chrono::steady_clock::time_point time);

/// All columns, deterministic ones first.
std::vector<FrameColumn> frameColumns();

/// The first line, with its newline.
std::string csvHeader(const std::vector<FrameColumn>& columns);
/// The rows of one frame, each with its newline.
std::string csvRows(const std::vector<FrameColumn>& columns, const ReplayFrame& frame);

}  // namespace tools
