// tools/bench_occlusion.h — the search for certificates beside bare Embree, ray for ray.
#pragma once

#include <string>
#include <vector>

#include "server/shadow_system.h"
#include "tools/bench_report.h"
#include "world/store.h"

namespace tools {

/// What certificates cost in one cascade, for all static casters that its window reaches at once.
struct SearchCost {
    double texel = 0;  ///< [m]
    size_t casters = 0;
    uint64_t triangles = 0;  ///< at the level that the cascade draws
    culling::CertifyCosts counts{};
    std::vector<double> bare{};    ///< Embree alone, all the rays [ms]
    std::vector<double> search{};  ///< Occlusion::search for all that are new [ms]
};

/// Reads what the windows around `eye` reach and measures each cascade in turns, Embree and search, so that a busy
/// machine slows both. Both run on all of TBB's threads. Errors of the store, of cascades and suns, and of Embree.
world::Result<std::vector<SearchCost>> measureSearch(const world::WorldStore& store, glm::dvec3 eye,
                                                     const server::ShadowConfig& config);

std::string searchTable(const std::vector<SearchCost>& costs);
/// All cascades together: 0.8 of the rays a second of bare Embree.
Goal searchGoal(const std::vector<SearchCost>& costs);

}  // namespace tools
