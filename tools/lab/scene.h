// tools/lab/scene.h — a world as the lab sees it: everything that can shade a recorded path, in full detail,
// all at once, with its movers where a recording has them.
#pragma once

#include <glm/glm.hpp>
#include <map>
#include <memory>
#include <span>
#include <vector>

#include "culling/light_casters.h"
#include "culling/light_space.h"
#include "world/casters.h"
#include "world/chunk.h"
#include "world/movers.h"
#include "world/octree.h"
#include "world/path.h"
#include "world/result.h"
#include "world/store.h"

namespace tools::lab {

/// Casters of the world, by id, and who moves. Not streamed: a method is judged by what it draws, not by what has
/// been read. One writer; readers may run side by side.
class Scene {
public:
    /// Reads the chunks that lie within `reach` [m] of a pose, seen along the sun, or may shade what does. kNotFound
    /// for a track whose object the world does not have, kBadData where nothing casts; errors of the store.
    static world::Result<Scene> load(const world::WorldStore& store, std::span<const world::Pose> poses, double reach,
                                     const culling::LightSpace& light, std::vector<world::MoverTrack> tracks);

    const world::CasterTable& casters() const { return table_; }
    const world::Octree& statics() const { return *statics_; }
    std::span<const world::CasterId> movers() const { return movers_; }  ///< ascending
    const world::Box& bounds() const { return bounds_; }  ///< of all that casts at rest, world [m]

    /// Of the world's content and of which casters are there, by what numbers.
    uint64_t hash() const { return hash_; }

    /// Puts the movers where they are at `time`. The movers that it moved.
    std::span<const world::CasterId> moveTo(double time);

private:
    struct Track {
        world::MoverTrack track;
        world::Placement rest;
        world::CasterId caster = 0;
    };
    world::CasterTable table_;
    std::unique_ptr<world::Octree> statics_;
    std::vector<std::shared_ptr<const world::Chunk>> chunks_;
    std::map<uint32_t, std::unique_ptr<const world::Mesh>> meshes_;
    std::vector<Track> tracks_;
    std::vector<world::CasterId> movers_, moved_;
    world::Box bounds_;
    uint64_t hash_ = 0;
};

}  // namespace tools::lab
