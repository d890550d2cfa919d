// world/procedural_field.h — the ground of the built-in world: hills, plateaus with overhanging cliffs,
// tunnels, and a ring road through villages.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "world/terrain_field.h"

namespace world {

/// A point of the road's centre line; the plane's coordinates are (x, z).
struct RoadPoint {
    glm::dvec2 position{0};  ///< [m]
    glm::dvec2 forward{0};   ///< unit, along growing distance
    /// Unit, to the right of somebody who looks along `forward`.
    glm::dvec2 right() const { return {-forward.y, forward.x}; }
};

/// What a seed makes of a square of `size` [m] around the origin. Immutable: any thread may ask.
class Landscape {
public:
    Landscape(uint64_t seed, double size);

    double size() const { return size_; }

    /// Positive in air, negative in solid; its size says nothing.
    double sign(glm::dvec3 p) const;
    /// Height of the highest ground at (x, z) [m], found by marching down where there is more than one.
    double groundHeight(double x, double z) const;
    /// Rise over run of the ground at (x, z), cliffs included as they are without overhang.
    double slope(double x, double z) const;
    /// Distance from the road's centre line [m], to a few percent; more than 200 m away any larger number.
    double roadDistance(double x, double z) const;

    /// The road is closed: distances [m] repeat after `roadLength`.
    double roadLength() const { return roadTable_.back(); }
    RoadPoint road(double distance) const;
    /// Distances along the road at which villages have their middle, ascending.
    const std::vector<double>& villages() const { return villages_; }

    /// A chain of balls of varying radius, hollowed out of the ground.
    struct Tunnel {
        std::vector<glm::dvec3> axis;  ///< [m]
        std::vector<double> radius;    ///< [m], same size
        Box bounds;                    ///< of the hollow
    };
    /// Ascending by bounds.min.x.
    const std::vector<Tunnel>& tunnels() const { return tunnels_; }

    /// The field for baking. The landscape must outlive the calls.
    FieldBlock sample(const LatticeRect& rect) const;

private:
    /// All that depends on x and z alone.
    struct Column {
        double base = 0;     // ground without plateaus [m]
        double plateau = 0;  // height of the plateau that may stand on it [m]
        double edge = 0;     // plateau noise: the cliff is where it is zero
    };
    struct RoadNear {
        double distance, angle;
    };
    RoadNear roadNear(double x, double z) const;
    double roadRadius(double angle) const;
    double roadSlope(double angle) const;
    double roadHeight(double angle) const;
    double villageWeight(double angle) const;
    double hills(double x, double z, bool smooth) const;
    Column column(double x, double z) const;
    double plateauHeight(const Column& c, glm::dvec3 p) const;
    double flatHeight(double x, double z) const;
    double hollow(const Tunnel& tunnel, glm::dvec3 p) const;
    void digTunnels();
    std::span<const Tunnel> tunnelsBetween(double x0, double x1) const;

    double size_;
    uint32_t seed_;
    double roadPhase_[3];
    std::vector<double> roadTable_;  // distance along the road at equal steps of angle
    std::vector<double> villageAngles_, villages_;
    std::vector<Tunnel> tunnels_;
    double widestTunnel_ = 0;  // along x [m]
};

}  // namespace world
