// world/procedural_field.cpp — see procedural_field.h.
#include "world/procedural_field.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "world/noise.h"

namespace world {
namespace {

constexpr double kTurn = 2 * std::numbers::pi;

// Seeds of the independent noises.
enum : uint32_t {
    kHills = 1,
    kRough = 11,
    kRegion = 21,
    kEdge = 22,
    kWarpX = 23,
    kWarpZ = 24,
    kWall = 25,
    kDig = 31,
    kVillage = 41
};

constexpr double kPlateau = 38;    // highest plateau [m]
constexpr double kCliff = 0.016;   // half width of a cliff in units of the edge noise: some 8 m of ground
constexpr double kEdgeSize = 300;  // feature size of the edge noise [m]
constexpr double kWarp = 7;        // how far overhangs reach [m]
constexpr double kWarpSize = 24;   // [m]
// Beyond this the warp cannot bring the edge near: 1.4 * 1.9 is the noise's steepest slope.
constexpr double kEdgeReach = kCliff + 1.5 * kWarp * 2.7 / kEdgeSize;
constexpr double kWallNoise = 0.5;  // roughness of tunnel walls [m]

constexpr double kRoadFlat = 8;        // half width of the road's level ground [m]
constexpr double kVillageFlat = 45;    // the same in a village [m]
constexpr double kRoadBlend = 42;      // from there to natural ground [m]
constexpr double kVillageReach = 130;  // [m] along the road from a village's middle
constexpr int kRoadSteps = 4096;

}  // namespace

Landscape::Landscape(uint64_t seed, double size)
    : size_(size), seed_(static_cast<uint32_t>(seed ^ (seed >> 32)) * 64) {
    for (int i = 0; i < 3; ++i) roadPhase_[i] = kTurn * hashUnit(i, 0, 0, seed_ + kVillage);
    roadTable_.resize(kRoadSteps + 1);
    for (int i = 0; i < kRoadSteps; ++i) {
        const double middle = kTurn * (i + 0.5) / kRoadSteps;
        roadTable_[static_cast<size_t>(i) + 1] =
            roadTable_[static_cast<size_t>(i)] +
            kTurn / kRoadSteps * std::hypot(roadRadius(middle), roadSlope(middle));
    }
    const int count = std::max(2, static_cast<int>(std::lround(roadLength() / 950)));
    for (int i = 0; i < count; ++i) {
        const double step = (i + 0.5 + 0.3 * (hashUnit(i, 1, 0, seed_ + kVillage) - 0.5)) / count;
        villageAngles_.push_back(kTurn * step);
        villages_.push_back(roadTable_[static_cast<size_t>(step * kRoadSteps)]);
    }
    digTunnels();
}

// ---- road: a closed curve, radius as a function of the angle around the origin ----

double Landscape::roadRadius(double angle) const {
    return 0.29 * size_ *
           (1 + 0.10 * std::sin(2 * angle + roadPhase_[0]) + 0.05 * std::sin(3 * angle + roadPhase_[1]) +
            0.02 * std::sin(5 * angle + roadPhase_[2]));
}

double Landscape::roadSlope(double angle) const {
    return 0.29 * size_ *
           (0.20 * std::cos(2 * angle + roadPhase_[0]) + 0.15 * std::cos(3 * angle + roadPhase_[1]) +
            0.10 * std::cos(5 * angle + roadPhase_[2]));
}

RoadPoint Landscape::road(double distance) const {
    const double length = roadLength();
    const double wrapped = distance - std::floor(distance / length) * length;
    const auto after = std::upper_bound(roadTable_.begin() + 1, roadTable_.end() - 1, wrapped);
    const double lower = *(after - 1), upper = *after;
    const double step =
        static_cast<double>(after - 1 - roadTable_.begin()) + (wrapped - lower) / (upper - lower);
    const double angle = kTurn * step / kRoadSteps;
    const double c = std::cos(angle), s = std::sin(angle), r = roadRadius(angle), dr = roadSlope(angle);
    return {.position = {r * c, r * s},
            .forward = glm::normalize(glm::dvec2(dr * c - r * s, dr * s + r * c))};
}

Landscape::RoadNear Landscape::roadNear(double x, double z) const {
    const double r = std::hypot(x, z);
    const double most = 0.29 * size_ * 1.17 + 200, least = 0.29 * size_ * 0.83 - 200;
    if (r > most || r < least || r < 1) return {1e9, 0};
    const double angle = std::atan2(z, x), road = roadRadius(angle), slope = roadSlope(angle) / road;
    return {std::abs(r - road) / std::sqrt(1 + slope * slope), angle};
}

double Landscape::roadDistance(double x, double z) const { return roadNear(x, z).distance; }

double Landscape::roadHeight(double angle) const {
    const double r = roadRadius(angle);
    return hills(r * std::cos(angle), r * std::sin(angle), true);
}

double Landscape::villageWeight(double angle) const {
    double weight = 0;
    for (const double village : villageAngles_) {
        const double turn = std::abs(std::remainder(angle - village, kTurn)) * 0.29 * size_;
        weight = std::max(weight, 1 - smoothStep(0.6 * kVillageReach, kVillageReach, turn));
    }
    return weight;
}

// ---- ground ----

double Landscape::hills(double x, double z, bool smooth) const {
    double h =
        60 * noise2(x / 1100, z / 1100, seed_ + kHills) + 30 * noise2(x / 430, z / 430, seed_ + kHills + 1);
    if (smooth) return h;
    // Plains between rough country.
    const double rough = 0.15 + 0.85 * smoothStep(-0.25, 0.3, noise2(x / 700, z / 700, seed_ + kRough));
    return h + rough * (16 * noise2(x / 170, z / 170, seed_ + kHills + 2) +
                        4 * noise2(x / 58, z / 58, seed_ + kHills + 3) +
                        noise2(x / 21, z / 21, seed_ + kHills + 4));
}

Landscape::Column Landscape::column(double x, double z) const {
    Column c;
    c.base = hills(x, z, false);
    const RoadNear near = roadNear(x, z);
    double wild = 1;
    if (near.distance < 250) {
        const double village = villageWeight(near.angle);
        const double flat = kRoadFlat + (kVillageFlat - kRoadFlat) * village;
        const double road = 1 - smoothStep(flat, flat + kRoadBlend, near.distance);
        if (road > 0) c.base += (roadHeight(near.angle) - c.base) * road;
        wild = smoothStep(flat + kRoadBlend, flat + kRoadBlend + 60, near.distance);
    }
    if (wild > 0) {
        const double region = smoothStep(0.0, 0.3, noise2(x / 800, z / 800, seed_ + kRegion));
        c.plateau = kPlateau * wild * region;
        if (c.plateau > 0) c.edge = noise2(x / kEdgeSize, z / kEdgeSize, seed_ + kEdge);
    }
    return c;
}

/// Height of the plateau over the base, as seen at p: where p is high changes where the edge is.
double Landscape::plateauHeight(const Column& c, glm::dvec3 p) const {
    if (c.plateau <= 0 || c.edge <= -kEdgeReach) return 0;
    if (c.edge >= kEdgeReach) return c.plateau;
    const glm::dvec3 q = p / kWarpSize;
    const double x = p.x + kWarp * noise3(q, seed_ + kWarpX), z = p.z + kWarp * noise3(q, seed_ + kWarpZ);
    return c.plateau * smoothStep(-kCliff, kCliff, noise2(x / kEdgeSize, z / kEdgeSize, seed_ + kEdge));
}

double Landscape::flatHeight(double x, double z) const {
    const Column c = column(x, z);
    return c.base + c.plateau * smoothStep(-kCliff, kCliff, c.edge);
}

double Landscape::slope(double x, double z) const {
    const double h = flatHeight(x, z);
    return std::hypot(flatHeight(x + 1, z) - h, flatHeight(x, z + 1) - h);
}

// ---- tunnels ----

/// Distance from the hollow's wall [m], negative inside.
double Landscape::hollow(const Tunnel& tunnel, glm::dvec3 p) const {
    double best = 1e9;
    for (size_t i = 0; i + 1 < tunnel.axis.size(); ++i) {
        const glm::dvec3 a = tunnel.axis[i], ab = tunnel.axis[i + 1] - a;
        const double t = glm::clamp(glm::dot(p - a, ab) / glm::dot(ab, ab), 0.0, 1.0);
        best = std::min(best,
                        glm::distance(p, a + ab * t) - glm::mix(tunnel.radius[i], tunnel.radius[i + 1], t));
    }
    return best + kWallNoise * noise3(p / 5.0, seed_ + kWall);
}

void Landscape::digTunnels() {
    const auto wanted = static_cast<size_t>(std::ceil(48 * size_ * size_ / (4096.0 * 4096.0)));
    const int tries = static_cast<int>(wanted) * 400;
    for (int n = 0; n < tries && tunnels_.size() < wanted; ++n) {
        const auto unit = [&](int k) { return hashUnit(n, k, 0, seed_ + kDig); };
        const double reach = size_ / 2 - 220;
        if (reach <= 0) return;
        const glm::dvec2 mouth(reach * (2 * unit(0) - 1), reach * (2 * unit(1) - 1));
        const double heading = kTurn * unit(2), radius = 3.2 + 1.3 * unit(3), length = 60 + 80 * unit(4);
        const glm::dvec2 dir(std::cos(heading), std::sin(heading));
        if (flatHeight(mouth.x + 25 * dir.x, mouth.y + 25 * dir.y) < flatHeight(mouth.x, mouth.y) + 12)
            continue;

        // From ten metres before the mouth into the hill, winding and rising a little.
        Tunnel tunnel;
        const double floor = flatHeight(mouth.x, mouth.y);
        double covered = 0;
        bool clear = true;
        constexpr double kStep = 6;
        for (double s = -10; s < length; s += kStep) {
            const double aside = 5 * noise2(s / 30, n, seed_ + kDig + 1) * smoothStep(0, 30, s);
            const glm::dvec2 at = mouth + dir * s + glm::dvec2(-dir.y, dir.x) * aside;
            const glm::dvec3 axis(at.x, floor + 0.75 * radius + 0.04 * std::max(s, 0.0), at.y);
            const double cover = flatHeight(at.x, at.y) - axis.y;
            const bool chamber = s > 0.5 * length && s < 0.5 * length + kStep && cover > 18;
            tunnel.axis.push_back(axis);
            tunnel.radius.push_back(chamber ? 9.0 : radius);
            covered += cover > radius + 4 ? kStep : 0;
            clear &= roadDistance(at.x, at.y) > kVillageFlat + kRoadBlend + 20;
        }
        if (!clear || covered < 0.5 * length) continue;
        for (size_t i = 0; i < tunnel.axis.size(); ++i) {
            const double r = tunnel.radius[i] + kWallNoise;
            tunnel.bounds.add(tunnel.axis[i] - r);
            tunnel.bounds.add(tunnel.axis[i] + r);
        }
        widestTunnel_ = std::max(widestTunnel_, tunnel.bounds.max.x - tunnel.bounds.min.x);
        tunnels_.push_back(std::move(tunnel));
    }
    std::stable_sort(tunnels_.begin(), tunnels_.end(), [](const Tunnel& a, const Tunnel& b) {
        return a.bounds.min.x < b.bounds.min.x;
    });
}

/// All tunnels whose bounds meet [x0, x1], and some others.
std::span<const Landscape::Tunnel> Landscape::tunnelsBetween(double x0, double x1) const {
    const auto startsBefore = [](const Tunnel& tunnel, double x) { return tunnel.bounds.min.x < x; };
    const auto first = std::lower_bound(tunnels_.begin(), tunnels_.end(), x0 - widestTunnel_, startsBefore);
    const auto end = std::partition_point(first, tunnels_.end(),
                                          [&](const Tunnel& t) { return t.bounds.min.x <= x1; });
    return {first, end};
}

// ---- asking ----

double Landscape::sign(glm::dvec3 p) const {
    const Column c = column(p.x, p.z);
    double f = p.y - c.base - plateauHeight(c, p);
    for (const Tunnel& tunnel : tunnelsBetween(p.x, p.x)) {
        if (tunnel.bounds.overlaps({p, p})) f = std::max(f, -hollow(tunnel, p));
    }
    return f;
}

double Landscape::groundHeight(double x, double z) const {
    const Column c = column(x, z);
    std::vector<const Tunnel*> near;
    for (const Tunnel& t : tunnelsBetween(x, x)) {
        if (x >= t.bounds.min.x && x <= t.bounds.max.x && z >= t.bounds.min.z && z <= t.bounds.max.z)
            near.push_back(&t);
    }
    const bool cliff = c.plateau > 0 && std::abs(c.edge) < kEdgeReach;
    if (near.empty() && !cliff) return c.base + plateauHeight(c, {x, 0, z});
    const auto solid = [&](double y) {
        const glm::dvec3 p(x, y, z);
        double f = y - c.base - plateauHeight(c, p);
        for (const Tunnel* t : near) f = std::max(f, -hollow(*t, p));
        return f <= 0;
    };
    constexpr double kStep = 0.25;
    double y = c.base + c.plateau + kStep;
    while (!solid(y)) y -= kStep;  // ends: below base and tunnels everything is solid
    double low = y, high = y + kStep;
    for (int i = 0; i < 16; ++i) {
        const double middle = (low + high) / 2;
        (solid(middle) ? low : high) = middle;
    }
    return low;
}

FieldBlock Landscape::sample(const LatticeRect& rect) const {
    const double voxel = rect.voxel, far = kBandVoxels * voxel;
    // Columns with one more on each side, for slopes.
    const int32_t nx = rect.countX + 2, nz = rect.countZ + 2;
    std::vector<Column> columns(static_cast<size_t>(nx) * static_cast<size_t>(nz));
    std::vector<double> heights(columns.size());
    const auto at = [&](int32_t i, int32_t k) {
        return static_cast<size_t>(i + 1) * static_cast<size_t>(nz) + static_cast<size_t>(k + 1);
    };
    double lowest = 1e9, highest = -1e9;
    for (int32_t i = -1; i <= rect.countX; ++i) {
        for (int32_t k = -1; k <= rect.countZ; ++k) {
            Column& c = columns[at(i, k)] = column(rect.x(i), rect.z(k));
            heights[at(i, k)] = c.base + c.plateau * smoothStep(-kCliff, kCliff, c.edge);
            lowest = std::min(lowest, c.base);
            highest = std::max(highest, c.base + c.plateau);
        }
    }
    const Box area{{rect.x(0) - far, -1e9, rect.z(0) - far},
                   {rect.x(rect.countX) + far, 1e9, rect.z(rect.countZ) + far}};
    std::vector<const Tunnel*> near;
    for (const Tunnel& t : tunnelsBetween(area.min.x, area.max.x)) {
        if (!t.bounds.overlaps(area)) continue;
        near.push_back(&t);
        lowest = std::min(lowest, t.bounds.min.y);
    }

    FieldBlock block;
    // Twice the band: on slopes up to 60 degrees the clamped ends are farther than the band.
    block.firstY = static_cast<int64_t>(std::floor((lowest - 2 * far) / voxel));
    block.countY =
        static_cast<int32_t>(static_cast<int64_t>(std::ceil((highest + 2 * far) / voxel)) - block.firstY);
    block.distance.resize(static_cast<size_t>(int64_t{rect.countX} * rect.countZ * block.countY));
    const auto yAt = [&](int32_t j) { return (static_cast<double>(block.firstY + j) + 0.5) * voxel; };
    for (int32_t i = 0; i < rect.countX; ++i) {
        for (int32_t k = 0; k < rect.countZ; ++k) {
            const Column& c = columns[at(i, k)];
            const double x = rect.x(i), z = rect.z(k);
            float* out = &block.distance[static_cast<size_t>((int64_t{i} * rect.countZ + k) * block.countY)];
            const double slopeX = (heights[at(i + 1, k)] - heights[at(i - 1, k)]) / (2 * voxel);
            const double slopeZ = (heights[at(i, k + 1)] - heights[at(i, k - 1)]) / (2 * voxel);
            const double steep = std::sqrt(1 + slopeX * slopeX + slopeZ * slopeZ);
            const bool cliff = c.plateau > 0 && std::abs(c.edge) < kEdgeReach;
            for (int32_t j = 0; j < block.countY; ++j) {
                const double y = yAt(j);
                double d = (y - heights[at(i, k)]) / steep;
                if (cliff && y > c.base - 2 * far && y < c.base + c.plateau + 2 * far) {
                    // A few differences: the overhanging face has no slope that the heights know.
                    const double e = 0.5;
                    const auto f = [&](glm::dvec3 p) { return p.y - c.base - plateauHeight(c, p); };
                    const glm::dvec3 p(x, y, z);
                    const double here = f(p);
                    const glm::dvec3 g(f(p + glm::dvec3(e, 0, 0)) - here, f(p + glm::dvec3(0, e, 0)) - here,
                                       f(p + glm::dvec3(0, 0, e)) - here);
                    d = here / std::max(glm::length(g / e), 0.7);
                } else if (cliff) {
                    d = y < c.base ? -far : far;
                }
                out[j] = static_cast<float>(d);
            }
            for (const Tunnel* t : near) {
                const Box& b = t->bounds;
                if (x < b.min.x - far || x > b.max.x + far || z < b.min.z - far || z > b.max.z + far)
                    continue;
                const auto first = static_cast<int64_t>(std::floor((b.min.y - far) / voxel)) - block.firstY;
                const auto last = static_cast<int64_t>(std::ceil((b.max.y + far) / voxel)) - block.firstY;
                for (int64_t j = std::max<int64_t>(first, 0); j <= std::min<int64_t>(last, block.countY - 1);
                     ++j) {
                    const double d = hollow(*t, {x, yAt(static_cast<int32_t>(j)), z});
                    out[j] = std::max(out[j], static_cast<float>(-d));
                }
            }
        }
    }
    return block;
}

}  // namespace world
