// tools/report/apng.h — pictures as one animated PNG: what every browser plays and every other program shows the first of.
// Source: "PNG (Portable Network Graphics) Specification", third edition, W3C (chunks acTL, fcTL and fdAT).
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "world/result.h"

namespace tools::report {

/// PNG files of one size, shown one after the other, for ever.
///   seconds  that each is shown, > 0
/// kUsage where there is none, or one has another size or colour type than the first; kBadData for what is no PNG.
world::Result<std::vector<std::byte>> animated(const std::vector<std::vector<std::byte>>& pngs, double seconds);

}  // namespace tools::report
