// world/procedural_scatter.cpp — see procedural_scatter.h.
#include "world/procedural_scatter.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <glm/gtc/quaternion.hpp>
#include <limits>
#include <mutex>
#include <numbers>

#include "world/noise.h"
#include "world/procedural_meshes.h"

namespace world {
namespace {

enum : uint32_t { kCells = 101, kForest = 102, kGrove = 103 };

constexpr double kMargin = 4;     // [m] around the grid that stays empty
constexpr double kNowhere = -10;  // score of a cell that nothing fits into: below all others
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Scores in bins of equal width; those that nothing has are few and share the bins at the ends.
constexpr size_t kBins = 1 << 16;
constexpr double kBinsPerUnit = 8192, kLowest = -4;
size_t binOf(double score) {
    return static_cast<size_t>(std::clamp((score - kLowest) * kBinsPerUnit, 0.0, double(kBins - 1)));
}
/// Below every score of the bin, whatever rounding did.
double belowBin(size_t bin) { return bin == 0 ? -kInfinity : kLowest + (double(bin) - 1) / kBinsPerUnit; }

}  // namespace

glm::mat3 turned(double yaw, double tilt, double scale) {
    const glm::dquat turn = glm::angleAxis(yaw, glm::dvec3(0, 1, 0));
    const glm::dquat lean = glm::angleAxis(tilt, glm::dvec3(std::cos(3 * yaw), 0, std::sin(3 * yaw)));
    return glm::mat3(glm::mat3_cast(lean * turn) * scale);
}

Scatter::Scatter(const Landscape& land, uint32_t seed, uint32_t cellsAside, size_t count,
                 std::vector<glm::dvec2> buildings)
    : land_(land),
      seed_(seed),
      cells_(cellsAside),
      cellEdge_((land.size() - 2 * kMargin) / cellsAside),
      buildings_(std::move(buildings)),
      last_(lastOf(count)) {}

glm::dvec2 Scatter::pointOf(uint32_t cell) const {
    const auto i = static_cast<int32_t>(cell / cells_), k = static_cast<int32_t>(cell % cells_);
    return {(i + 0.15 + 0.7 * hashUnit(i, 0, k, seed_ + kCells)) * cellEdge_ - land_.size() / 2 + kMargin,
            (k + 0.15 + 0.7 * hashUnit(i, 1, k, seed_ + kCells)) * cellEdge_ - land_.size() / 2 + kMargin};
}

double Scatter::unit(uint32_t cell, int32_t what) const {
    return hashUnit(static_cast<int32_t>(cell / cells_), what, static_cast<int32_t>(cell % cells_),
                    seed_ + kCells);
}

/// Where the score is sure to be below `least`, it may be any number below.
Scatter::Candidate Scatter::candidate(uint32_t cell, double least) const {
    const glm::dvec2 p = pointOf(cell);
    Candidate c{kNowhere, cell, kBush};
    const double luck = unit(cell, 2), kind = unit(cell, 3);
    const double wood =
        noise2(p.x / 320, p.y / 320, seed_ + kForest) + 0.5 * noise2(p.x / 85, p.y / 85, seed_ + kGrove);
    // The ground is what takes time to look at.
    if (std::max(0.8 - luck, wood - 0.6 * luck) < least) return c;
    const double road = land_.roadDistance(p.x, p.y);
    if (road < 10) return c;
    if (road < 60) {
        for (const glm::dvec2& b : buildings_) {
            if (glm::distance(b, p) < 10) return c;
        }
    }
    const double steep = land_.slope(p.x, p.y);
    if (steep > 0.75) {
        c.mesh = kind < 0.6 ? kBoulder : kRockSlab;
        c.score = 0.8 - luck;
    } else {
        const double needles = 0.5 + 1.2 * noise2(p.x / 500, p.y / 500, seed_ + kGrove + 50);
        c.mesh = kind < 0.12               ? kBush
                 : kind < 0.14             ? kBoulder
                 : unit(cell, 4) < needles ? kConifer
                                           : kBroadleaf;
        if (wood < 0.05 && kind > 0.5) c.mesh = kBush;
        c.score = wood - 0.6 * luck - 0.5 * std::max(steep - 0.4, 0.0);
    }
    return c;
}

/// The last of the `count` best cells: one pass finds its bin, another who is in it.
Scatter::Candidate Scatter::lastOf(size_t count) const {
    const uint32_t all = cells_ * cells_;
    if (count == 0) return {kInfinity, 0, 0};
    if (count >= all) return {-kInfinity, all, 0};
    std::vector<std::atomic<uint32_t>> bins(kBins);
    tbb::parallel_for(uint32_t{0}, all, [&](uint32_t cell) {
        bins[binOf(candidate(cell, -kInfinity).score)].fetch_add(1, std::memory_order_relaxed);
    });
    size_t bin = kBins - 1;
    for (; bins[bin] < count; --bin) count -= bins[bin];

    std::vector<Candidate> inBin;
    std::mutex mutex;
    tbb::parallel_for(uint32_t{0}, all, [&](uint32_t cell) {
        const Candidate c = candidate(cell, belowBin(bin));
        if (binOf(c.score) != bin) return;
        const std::lock_guard lock(mutex);
        inBin.push_back(c);
    });
    const auto last = inBin.begin() + static_cast<std::ptrdiff_t>(count) - 1;
    std::nth_element(inBin.begin(), last, inBin.end(),
                     [](const Candidate& a, const Candidate& b) { return a.before(b); });
    return *last;
}

Instance Scatter::place(const Candidate& chosen, glm::dvec2 p) const {
    const bool rock = chosen.mesh == kBoulder || chosen.mesh == kRockSlab;
    const double yaw = 2 * std::numbers::pi * unit(chosen.cell, 5);
    const double tilt = rock ? 0.3 * unit(chosen.cell, 6) : 0, scale = 0.7 + 0.7 * unit(chosen.cell, 7);
    return {chosen.mesh, {turned(yaw, tilt, scale), {p.x, land_.groundHeight(p.x, p.y), p.y}}};
}

std::vector<Instance> Scatter::inside(ChunkKey key, double edge) const {
    // Cells are left by their points by less than a cell; one more allows for rounding.
    const auto range = [&](int32_t k) {
        const double low = (k * edge + land_.size() / 2 - kMargin) / cellEdge_, high = low + edge / cellEdge_;
        const double last = double(cells_) - 1;
        return std::pair(static_cast<uint32_t>(std::clamp(std::floor(low) - 2, 0.0, last)),
                         static_cast<uint32_t>(std::clamp(std::floor(high) + 1, 0.0, last)));
    };
    const auto [firstX, lastX] = range(key.x);
    const auto [firstZ, lastZ] = range(key.z);
    std::vector<Instance> instances;
    for (uint32_t i = firstX; i <= lastX; ++i) {
        for (uint32_t k = firstZ; k <= lastZ; ++k) {
            const uint32_t cell = i * cells_ + k;
            const glm::dvec2 p = pointOf(cell);
            if (std::floor(p.x / edge) != key.x || std::floor(p.y / edge) != key.z) continue;
            const Candidate c = candidate(cell, last_.score);
            if (!last_.before(c)) instances.push_back(place(c, p));
        }
    }
    return instances;
}

}  // namespace world
