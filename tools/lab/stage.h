// tools/lab/stage.h — small made-up worlds: ground, boxes, and terrain in levels, baked into a file that goes with them.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "world/chunk.h"
#include "world/mesh.h"
#include "world/movers.h"
#include "world/result.h"
#include "world/store.h"

namespace tools::lab {

/// What stands in such a world; a value.
struct Stage {
    struct Piece {
        std::string name;      ///< empty: none
        glm::dvec3 centre{0};  ///< [m]
        glm::dvec3 size{1};    ///< edge lengths along the world's axes [m]; height 0: a sheet of ground
    };
    glm::dvec3 origin{0};  ///< of all that the others say [m]
    std::vector<Piece> pieces;
    std::map<world::ChunkKey, world::Mesh> terrain;  ///< in the chunk's own frame, which knows nothing of `origin`

    /// A square of sheets around the middle, at height 0, `edge` metres a side, in tiles of a chunk each.
    void addGround(glm::dvec2 middle, double edge);
    void addBox(glm::dvec3 centre, glm::dvec3 size, const std::string& name = "");
    /// Boxes of up to three metres on the ground, about one in each square of `gap` metres of a field around the
    /// middle, none nearer to it than a gap.
    void addBlocks(uint32_t seed, glm::dvec2 middle, double edge, double gap);
    /// A row of upright boxes on the ground, `width` thick, one each `step`, along x.
    void addBars(glm::dvec3 first, int count, double step, double width, double height);

    /// Where a named piece stands, as a track has it. CHECKs that there is one.
    world::MoverSample restOf(const std::string& name, double time) const;
};

constexpr double kStageChunk = 32;  ///< edge of its chunks [m]

/// A box around its own origin, one metre a side.
void addUnitBox(world::MeshLevel& level, glm::vec3 centre, glm::vec3 size);

/// A world file in a folder that goes with it.
class StageWorld {
public:
    /// Errors of the folder, the bake and the store.
    static world::Result<StageWorld> bake(const Stage& stage);
    const world::WorldStore& store() const { return *store_; }

private:
    std::shared_ptr<const std::string> folder_;  ///< removed with the last copy
    std::unique_ptr<world::WorldStore> store_;   ///< closed before
};

}  // namespace tools::lab
