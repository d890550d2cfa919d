#include "culling/cascades.h"

#include <cmath>

namespace culling {

world::Result<std::vector<Cascade>> makeCascades(int count, int side, double farDistance, double ratio,
                                                 int guardBand) {
    const auto usage = [](std::string what) {
        return world::Error{world::ErrorCode::kUsage, std::move(what)};
    };
    if (count < 1 || count > 8) return usage("cascades: " + std::to_string(count) + "; give 1 to 8");
    if (side < 64 || side > 8192) return usage("resolution: " + std::to_string(side) + "; give 64 to 8192 texels");
    if (!(std::isfinite(farDistance) && farDistance >= 1 && farDistance <= 1e6))
        return usage("far: " + std::to_string(farDistance) + " m; give 1 to 1000000");
    if (!(std::isfinite(ratio) && ratio > 1 && ratio <= 16))
        return usage("split ratio: " + std::to_string(ratio) + "; give more than 1, at most 16");
    if (guardBand < 1 || guardBand > side / 4)
        return usage("guard band: " + std::to_string(guardBand) + " texels; give 1 to " + std::to_string(side / 4) +
                     ", a quarter of the resolution");
    std::vector<Cascade> cascades(static_cast<size_t>(count));
    for (int c = 0; c < count; ++c) {
        const double split = farDistance * std::pow(ratio, c - (count - 1));
        cascades[static_cast<size_t>(c)] = {split, 2 * split / (side - 2 * (kWindowMargin + guardBand / 2))};
    }
    return cascades;
}

}  // namespace culling
