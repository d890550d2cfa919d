// world/casters.h — everything that casts right now: placed meshes, static or active.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "world/check.h"
#include "world/chunk.h"
#include "world/mesh.h"

namespace world {

/// Index of a caster; given out again after its removal.
using CasterId = uint32_t;
/// Index of a mesh that casters share; given out again after its removal.
using MeshSlot = uint32_t;

constexpr uint32_t kNoGeometry = 0xffffffffu;

/// A mesh in use.
struct MeshEntry {
    const Mesh* mesh = nullptr;      ///< null in a free slot
    std::vector<uint32_t> geometry;  ///< per level: what the GPU calls it, or kNoGeometry
};

enum class CasterState : uint8_t {
    kFree,    ///< no caster
    kStatic,  ///< at rest: lives in the cache maps
    kActive,  ///< moves, or moved lately: drawn over them every time it moves
};

/// Where a caster comes from, for people.
struct CasterOrigin {
    ChunkKey chunk;
    int32_t slot = -1;   ///< among the chunk's instances; -1 for its terrain
    int64_t object = -1; ///< adopted or spawned object, or -1
};

struct Caster {
    MeshSlot mesh = 0;
    Placement placement;
    Box bounds;  ///< world frame [m], grown by the margin
    float margin = 0;  ///< how far its shape may reach beyond the mesh [m]
    CasterState state = CasterState::kFree;
    CasterOrigin origin;
};

/// Casters and the meshes that they share, by index. One writer; readers may run side by side.
/// Ids are given out in a fixed order: equal calls, equal ids.
class CasterTable {
public:
    /// `mesh` must outlive its slot.
    MeshSlot addMesh(const Mesh& mesh);
    void removeMesh(MeshSlot slot);  ///< no caster may use it any more
    MeshEntry& mesh(MeshSlot slot) { return meshes_[slot]; }
    const MeshEntry& mesh(MeshSlot slot) const { return meshes_[slot]; }

    CasterId add(MeshSlot mesh, const Placement& placement, CasterState state, CasterOrigin origin,
                 float margin = 0);
    void remove(CasterId id);
    void place(CasterId id, const Placement& placement);  ///< updates the bounds too
    void setMesh(CasterId id, MeshSlot mesh);             ///< likewise
    void setMargin(CasterId id, float margin);            ///< likewise
    void setState(CasterId id, CasterState state) { casters_[id].state = state; }

    const Caster& operator[](CasterId id) const { return casters_[id]; }
    const Mesh& meshOf(CasterId id) const { return *meshes_[casters_[id].mesh].mesh; }
    size_t slots() const { return casters_.size(); }  ///< ids run from 0 to slots() - 1, free ones included
    size_t size() const { return casters_.size() - free_.size(); }

    /// "terrain of chunk (1,0,2)", "instance 17 of chunk (1,0,2)", "object 3 of chunk (0,0,0)".
    std::string describe(CasterId id) const;

private:
    std::vector<MeshEntry> meshes_;
    std::vector<MeshSlot> freeMeshes_;
    std::vector<Caster> casters_;
    std::vector<CasterId> free_;
};

/// A box with `margin` [m] of room on every side.
inline Box grown(const Box& box, double margin) { return {box.min - margin, box.max + margin}; }

/// Bounds of a placed mesh in world metres.
Box placedBounds(const Mesh& mesh, const Placement& placement);

/// Largest factor by which the placement stretches a length.
double stretch(const Placement& placement);

}  // namespace world
