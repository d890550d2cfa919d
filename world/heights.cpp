// world/heights.cpp — see heights.h.
#include "world/heights.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace world {
namespace {

constexpr float kHighest = 12000;  // [m]: 3 km above any summit, 1 km below any trench
constexpr float kJump = 1000;      // [m] from the neighbours' median: no cliff on Earth
constexpr double kSlope = 10;      // rise over run that a post spacing may have at that

/// A fraction within rounding of a post counts as on it: rasters on the lattice are met exactly, and
/// need no posts beside them.
double snapped(double v) {
    const double whole = std::round(v);
    return std::abs(v - whole) < 1e-6 ? whole : v;
}

}  // namespace

double Heights::between(double x, double z) const {
    const double u = snapped((x - x0) / dx), v = snapped((z - z0) / dz);
    const double fu = std::floor(u), fv = std::floor(v);
    if (!(fu >= 0 && fv >= 0 && fu < columns && fv < rows)) return NAN;
    const auto c = static_cast<int64_t>(fu), r = static_cast<int64_t>(fv);
    const double s = u - fu, t = v - fv;
    double low = at(c, r), high = t > 0 ? at(c, r + 1) : 0;
    if (s > 0) {
        low += (at(c + 1, r) - low) * s;
        if (t > 0) high += (at(c + 1, r + 1) - high) * s;
    }
    return t > 0 ? low + (high - low) * t : low;
}

int64_t mendHeights(Heights& heights) {
    const float jump =
        std::max(kJump, static_cast<float>(kSlope * std::max(heights.dx, std::abs(heights.dz))));
    struct Mend {
        size_t cell;
        float value;
    };
    std::vector<Mend> mends;  // applied at the end: the order of cells must not matter
    for (int32_t r = 0; r < heights.rows; ++r) {
        for (int32_t c = 0; c < heights.columns; ++c) {
            const float h = heights.at(c, r);
            if (std::isnan(h)) continue;
            // Most cells are near one neighbour: no median is needed to believe them.
            const bool possible = std::abs(h) <= kHighest;
            if (possible && (std::abs(h - heights.at(c - 1, r)) <= jump / 2 &&
                             std::abs(h - heights.at(c + 1, r)) <= jump / 2 &&
                             std::abs(h - heights.at(c, r - 1)) <= jump / 2 &&
                             std::abs(h - heights.at(c, r + 1)) <= jump / 2)) {
                continue;
            }
            std::array<float, 8> around;  // the first `known` ascend
            size_t known = 0;
            for (int i = -1; i <= 1; ++i) {
                for (int k = -1; k <= 1; ++k) {
                    const float n = heights.at(c + k, r + i);
                    if ((i == 0 && k == 0) || !(std::abs(n) <= kHighest)) continue;
                    size_t place = known++;
                    for (; place > 0 && around[place - 1] > n; --place) around[place] = around[place - 1];
                    around[place] = n;
                }
            }
            const float median = known > 0 ? (around[(known - 1) / 2] + around[known / 2]) / 2 : NAN;
            if (possible && !(std::abs(h - median) > jump)) continue;
            mends.push_back({static_cast<size_t>(int64_t{r} * heights.columns + c), median});
        }
    }
    for (const Mend& m : mends) heights.values[m.cell] = m.value;
    return static_cast<int64_t>(mends.size());
}

TerrainField fieldOf(const Heights& heights) {
    return [&heights](const LatticeRect& rect) {
        // One more column on each side, for slopes.
        const int32_t nz = rect.countZ + 2;
        std::vector<double> h(static_cast<size_t>(rect.countX + 2) * static_cast<size_t>(nz));
        const auto at = [&](int32_t i, int32_t k) -> double& {
            return h[static_cast<size_t>(i + 1) * static_cast<size_t>(nz) + static_cast<size_t>(k + 1)];
        };
        double lowest = INFINITY, highest = -INFINITY;
        for (int32_t i = -1; i <= rect.countX; ++i) {
            for (int32_t k = -1; k <= rect.countZ; ++k) {
                const double y = at(i, k) = heights.between(rect.x(i), rect.z(k));
                if (std::isnan(y)) continue;
                lowest = std::min(lowest, y);
                highest = std::max(highest, y);
            }
        }
        FieldBlock block;
        if (lowest > highest) return block;
        // Twice the band: on slopes up to 60 degrees the clamped ends are farther than the band.
        const double far = 2 * kBandVoxels * rect.voxel;
        block.firstY = static_cast<int64_t>(std::floor((lowest - far) / rect.voxel));
        block.countY = static_cast<int32_t>(static_cast<int64_t>(std::ceil((highest + far) / rect.voxel)) -
                                            block.firstY);
        // Too tall for any chunk: the caller refuses it by its height alone.
        if (int64_t{rect.countX} * rect.countZ * block.countY > kMaxBandSamples) return block;
        block.distance.resize(static_cast<size_t>(int64_t{rect.countX} * rect.countZ * block.countY));
        const auto slope = [&](double before, double here, double after) {
            if (!std::isnan(before) && !std::isnan(after)) return (after - before) / (2 * rect.voxel);
            if (!std::isnan(after)) return (after - here) / rect.voxel;
            return std::isnan(before) ? 0 : (here - before) / rect.voxel;
        };
        for (int32_t i = 0; i < rect.countX; ++i) {
            for (int32_t k = 0; k < rect.countZ; ++k) {
                float* out =
                    &block.distance[static_cast<size_t>((int64_t{i} * rect.countZ + k) * block.countY)];
                const double y = at(i, k);
                const double sx = slope(at(i - 1, k), y, at(i + 1, k)),
                             sz = slope(at(i, k - 1), y, at(i, k + 1));
                const double scale = 1 / std::sqrt(1 + sx * sx + sz * sz);
                for (int32_t j = 0; j < block.countY; ++j) {
                    const double here = (static_cast<double>(block.firstY + j) + 0.5) * rect.voxel;
                    out[j] = static_cast<float>((here - y) * scale);
                }
            }
        }
        return block;
    };
}

bool anyGround(const Heights& heights, double x0, double z0, double x1, double z1) {
    const auto range = [](double a, double b, int32_t count) {
        const double low = std::floor(std::min(a, b)) - 1, high = std::ceil(std::max(a, b)) + 1;
        return std::pair(static_cast<int64_t>(std::max(low, 0.0)),
                         static_cast<int64_t>(std::min(high, double(count - 1))));
    };
    const auto [c0, c1] =
        range((x0 - heights.x0) / heights.dx, (x1 - heights.x0) / heights.dx, heights.columns);
    const auto [r0, r1] = range((z0 - heights.z0) / heights.dz, (z1 - heights.z0) / heights.dz, heights.rows);
    for (int64_t r = r0; r < r1; ++r) {
        for (int64_t c = c0; c < c1; ++c) {
            if (!std::isnan(heights.at(c, r) + heights.at(c + 1, r) + heights.at(c, r + 1) +
                            heights.at(c + 1, r + 1))) {
                return true;
            }
        }
    }
    return false;
}

}  // namespace world
