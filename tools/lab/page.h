// tools/lab/page.h — results of the lab as one HTML file that needs nothing else: which methods are cheap, right and
// steady, and what leaving casters out as hidden breaks, in charts, tables, pictures and series. The charts are drawn by Chart.js, which is part of the page.
#pragma once

#include <span>
#include <string>

#include "tools/lab/occlusion.h"
#include "tools/lab/record.h"

namespace tools::lab {

/// The page of a run. Asks for nothing from anywhere. Text that is not UTF-8 is shown with replacement characters. The
/// same text for the same records.
///   occlusion  of the run; none where that was not asked for
///   claims     of the failure suite; none where it was not played
std::string labPage(const RunRecord& run, std::span<const MethodRecord> methods,
                    std::span<const OcclusionRecord> occlusion = {}, std::span<const ClaimRecord> claims = {});

}  // namespace tools::lab
