// world/noise.h — smooth noise from integer hashes: the same on every machine, no tables, no state.
// Source: Perlin, "Improving Noise", 2002 (gradients, fade); Appleby, "MurmurHash3", 2011 (finaliser).
#pragma once

#include <cmath>
#include <cstdint>
#include <glm/glm.hpp>

namespace world {

/// Well mixed bits of three integers and a seed.
inline uint32_t hashCell(int32_t x, int32_t y, int32_t z, uint32_t seed) {
    uint32_t h = static_cast<uint32_t>(x) * 0x8da6b343u + static_cast<uint32_t>(y) * 0xd8163841u +
                 static_cast<uint32_t>(z) * 0xcb1ab31fu + seed * 0x9e3779b9u;
    h = (h ^ (h >> 16)) * 0x85ebca6bu;
    h = (h ^ (h >> 13)) * 0xc2b2ae35u;
    return h ^ (h >> 16);
}

/// The hash as a number in [0, 1).
inline double hashUnit(int32_t x, int32_t y, int32_t z, uint32_t seed) {
    return hashCell(x, y, z, seed) * 0x1p-32;
}

namespace noise_detail {
inline double fade(double t) { return t * t * t * (t * (t * 6 - 15) + 10); }
inline double mix(double a, double b, double t) { return a + (b - a) * t; }

inline double corner2(int32_t x, int32_t z, uint32_t seed, double dx, double dz) {
    // Eight directions of equal length.
    constexpr double d = 0.70710678118654752;
    switch (hashCell(x, 0, z, seed) >> 29) {
        case 0:
            return dx;
        case 1:
            return -dx;
        case 2:
            return dz;
        case 3:
            return -dz;
        case 4:
            return (dx + dz) * d;
        case 5:
            return (dx - dz) * d;
        case 6:
            return (dz - dx) * d;
        default:
            return (-dx - dz) * d;
    }
}

inline double corner3(int32_t x, int32_t y, int32_t z, uint32_t seed, double dx, double dy, double dz) {
    // The twelve edge midpoints of a cube, four of them twice.
    const uint32_t h = hashCell(x, y, z, seed) >> 28;
    const double u = h < 8 ? dx : dy;
    const double v = h < 4 ? dy : (h == 12 || h == 14 ? dx : dz);
    return (h & 1 ? -u : u) + (h & 2 ? -v : v);
}
}  // namespace noise_detail

/// Gradient noise over the plane, feature size 1, about in [-1, 1], zero on integers.
/// |x|, |z| < 2^31.
inline double noise2(double x, double z, uint32_t seed) {
    using namespace noise_detail;
    const double fx = std::floor(x), fz = std::floor(z);
    const auto ix = static_cast<int32_t>(fx), iz = static_cast<int32_t>(fz);
    const double dx = x - fx, dz = z - fz, u = fade(dx), v = fade(dz);
    const double low = mix(corner2(ix, iz, seed, dx, dz), corner2(ix + 1, iz, seed, dx - 1, dz), u);
    const double high =
        mix(corner2(ix, iz + 1, seed, dx, dz - 1), corner2(ix + 1, iz + 1, seed, dx - 1, dz - 1), u);
    return 1.4 * mix(low, high, v);
}

/// The same in space.
inline double noise3(glm::dvec3 p, uint32_t seed) {
    using namespace noise_detail;
    const glm::dvec3 f = glm::floor(p), d = p - f;
    const auto x = static_cast<int32_t>(f.x), y = static_cast<int32_t>(f.y), z = static_cast<int32_t>(f.z);
    const double u = fade(d.x), v = fade(d.y), w = fade(d.z);
    const auto edge = [&](int32_t j, int32_t k) {
        return mix(corner3(x, y + j, z + k, seed, d.x, d.y - j, d.z - k),
                   corner3(x + 1, y + j, z + k, seed, d.x - 1, d.y - j, d.z - k), u);
    };
    return mix(mix(edge(0, 0), edge(1, 0), v), mix(edge(0, 1), edge(1, 1), v), w);
}

/// 0 below `a`, 1 above `b`, smooth between; a < b.
inline double smoothStep(double a, double b, double x) {
    const double t = glm::clamp((x - a) / (b - a), 0.0, 1.0);
    return t * t * (3 - 2 * t);
}

}  // namespace world
