// tools/results_columns.h — which table of a results file holds which column of frames.csv: those of a frame, of a frame
// and cascade, and of a cause. Names are the same everywhere: docs/columns.md explains them.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "tools/frames_csv.h"

namespace tools {

/// One column of a table.
struct ResultColumn {
    FrameColumn column;
    bool text = false;  ///< a hash; else a number
    bool measured() const { return column.name.starts_with("t_"); }  ///< differs from run to run
};

/// Without the keys `run`, `frame` and `cascade`. Columns of causes are in neither: a cause with costs has a row.
struct ResultColumns {
    std::vector<ResultColumn> frame, cascade;
};
ResultColumns resultColumns();

/// What of a Cost, in the order of its members: "texels", "casters", "triangles", "draws".
constexpr std::array<const char*, 4> kCostParts{"texels", "casters", "triangles", "draws"};

/// A column of causes as cause and index of the part: "scroll_triangles" is {kScroll, 2}; none for all others.
std::optional<std::pair<cache::Cause, size_t>> causeColumn(std::string_view name);

}  // namespace tools
