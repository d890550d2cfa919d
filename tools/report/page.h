// tools/report/page.h — runs as one HTML file that needs nothing else: what was drawn and why, where, beside drawing
// everything. The charts are drawn by Chart.js, which is part of the page.
#pragma once

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "tools/report/run_file.h"

namespace tools::report {

struct Page {
    std::string html;
    /// Of each replay the dearest frames that have no pictures, ascending, by its name; those that have all are left out.
    std::vector<std::pair<std::string, std::vector<uint64_t>>> unpictured;
};

/// The page of the runs, in their order. Asks for nothing from anywhere. The same text for the same runs. Errors of the
/// files.
///   follow  frames read, of how many, over all runs
world::Result<Page> reportPage(std::vector<RunFile>& runs, const std::function<void(size_t, size_t)>& follow);

}  // namespace tools::report
