#include "server/verification.h"

#include <bit>

namespace server {
namespace {

using world::Result;

std::vector<std::string> castersAt(const ResidentScene& scene, size_t side, const cache::Lattice& lattice,
                                   cache::Texel texel) {
    const glm::dvec2 min = (glm::dvec2(texel) - 1.0) * lattice.texel, max = (glm::dvec2(texel) + 2.0) * lattice.texel;
    std::vector<std::string> names;
    const world::CasterTable& table = scene.casters();
    for (world::CasterId id = 0; id < table.slots() && names.size() < kReported; ++id) {
        if (table[id].state == world::CasterState::kFree) continue;
        const world::Box& b = scene.light(side)[id].bounds;
        if (b.min.x <= max.x && b.max.x >= min.x && b.min.y <= max.y && b.max.y >= min.y)
            names.push_back(table.describe(id));
    }
    return names;
}

/// Compares one map with the same kind of scratch map.
Result<world::Done> compare(gpu::ShadowMaps& maps, const ResidentScene& scene, const Sun& sun, size_t side, int number,
                            gpu::MapKind cached, gpu::MapKind redrawn, VerifyReport& report) {
    const auto [checked, cascade] = sun.of(number);
    const int place = int(checked.map(cascade));
    auto a = maps.read(place, cached);
    if (!a) return a.error();
    auto b = maps.read(place, redrawn);
    if (!b) return b.error();
    const std::vector<float>&held = a.value(), &truth = b.value();
    const std::vector<TexelState> states = texelStates(sun, number, cached);
    const cache::Lattice& lattice = checked.lattice(cascade);
    const cache::Texel low = checked.window(cascade).min;
    for (size_t i = 0; i < held.size(); ++i) {
        if (states[i] == TexelState::kStale) {
            ++report.stale;
            continue;
        }
        ++report.texels;
        const float right = states[i] == TexelState::kUnknown ? cache::kUnknownDepth : truth[i];
        if (std::bit_cast<uint32_t>(held[i]) == std::bit_cast<uint32_t>(right)) continue;
        ++report.differing;
        if (report.first.size() == kReported) continue;
        const auto at = static_cast<int64_t>(i);
        const cache::Texel stored(at % lattice.side, at / lattice.side);
        const cache::Texel texel = low + lattice.slot(stored - low);
        report.first.push_back({number, cached, texel, held[i], right, castersAt(scene, side, lattice, texel)});
    }
    return world::Done{};
}

}  // namespace

Result<VerifyReport> verify(gpu::ShadowMaps& maps, const ResidentScene& scene,
                            std::span<const std::unique_ptr<Sun>> suns, cache::FramePlan& plan) {
    std::vector<cache::CascadeStatistics> statistics;
    for (size_t side = 0; side < suns.size(); ++side)
        for (const cache::ShadowCache& held : suns[side]->caches)
            held.planRedraw(scene.view(side, false), plan, statistics);
    auto times = maps.redraw(plan);
    if (!times) return times.error();
    VerifyReport report;
    report.redraw = std::move(times.value());
    for (size_t side = 0; side < suns.size(); ++side) {
        const Sun& sun = *suns[side];
        for (int c = 0; c < sun.cascades(); ++c) {
            const auto [held, cascade] = sun.of(c);
            if (!held.drawn(cascade)) continue;
            for (const auto& [cached, redrawn] : {std::pair(gpu::MapKind::kCache, gpu::MapKind::kScratchCache),
                                                  std::pair(gpu::MapKind::kWorking, gpu::MapKind::kScratchWorking)})
                if (auto done = compare(maps, scene, sun, side, c, cached, redrawn, report); !done) return done.error();
        }
    }
    return report;
}

}  // namespace server
