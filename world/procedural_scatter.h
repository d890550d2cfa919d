// world/procedural_scatter.h — what grows and lies about in the built-in world: the best cells of a jittered
// grid. They are found again whenever an area is asked for, so that a world of any size keeps none of them.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <vector>

#include "world/chunk.h"
#include "world/procedural_field.h"

namespace world {

/// Turned by `yaw` about y, then tilted by up to `tilt` radians about a horizontal axis.
glm::mat3 turned(double yaw, double tilt, double scale);

/// Trees, bushes and rocks. Immutable: any thread may ask.
class Scatter {
public:
    /// A grid of `cellsAside` x `cellsAside` over the land with something in its `count` best cells, or in
    /// all. Looks at every cell twice, on all threads, in constant memory.
    ///   land       must outlive this
    ///   buildings  (x, z) [m]; nothing stands within 10 m of one
    Scatter(const Landscape& land, uint32_t seed, uint32_t cellsAside, size_t count,
            std::vector<glm::dvec2> buildings);

    /// What stands in a chunk of `edge` [m], in the order of cells.
    std::vector<Instance> inside(ChunkKey key, double edge) const;

private:
    /// What would grow or lie in a cell, and how much it belongs there.
    struct Candidate {
        double score;
        uint32_t cell;
        uint32_t mesh;
        /// Whether it goes before `other` where not all have room.
        bool before(const Candidate& other) const {
            return score != other.score ? score > other.score : cell < other.cell;
        }
    };
    glm::dvec2 pointOf(uint32_t cell) const;
    double unit(uint32_t cell, int32_t what) const;
    Candidate candidate(uint32_t cell, double least) const;
    Candidate lastOf(size_t count) const;
    Instance place(const Candidate& chosen, glm::dvec2 p) const;

    const Landscape& land_;
    uint32_t seed_;
    uint32_t cells_;   // along each side
    double cellEdge_;  // [m]
    std::vector<glm::dvec2> buildings_;
    Candidate last_;  // the last one that has room
};

}  // namespace world
