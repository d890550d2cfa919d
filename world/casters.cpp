#include "world/casters.h"

#include <algorithm>
#include <cmath>

namespace world {

MeshSlot CasterTable::addMesh(const Mesh& mesh) {
    MeshSlot slot = static_cast<MeshSlot>(meshes_.size());
    if (freeMeshes_.empty()) {
        meshes_.emplace_back();
    } else {
        slot = freeMeshes_.back();
        freeMeshes_.pop_back();
    }
    meshes_[slot] = {&mesh, std::vector<uint32_t>(mesh.levels.size(), kNoGeometry)};
    return slot;
}

void CasterTable::removeMesh(MeshSlot slot) {
    CHECK(meshes_[slot].mesh != nullptr);
    meshes_[slot] = {};
    freeMeshes_.push_back(slot);
}

CasterId CasterTable::add(MeshSlot mesh, const Placement& placement, CasterState state, CasterOrigin origin,
                          float margin) {
    CHECK(state != CasterState::kFree && meshes_[mesh].mesh != nullptr);
    CasterId id = static_cast<CasterId>(casters_.size());
    if (free_.empty()) {
        casters_.emplace_back();
    } else {
        id = free_.back();
        free_.pop_back();
    }
    casters_[id] = {mesh, placement, grown(placedBounds(*meshes_[mesh].mesh, placement), double(margin)), margin,
                    state, origin};
    return id;
}

void CasterTable::remove(CasterId id) {
    CHECK(casters_[id].state != CasterState::kFree);
    casters_[id].state = CasterState::kFree;
    free_.push_back(id);
}

void CasterTable::place(CasterId id, const Placement& placement) {
    casters_[id].placement = placement;
    casters_[id].bounds = grown(placedBounds(meshOf(id), placement), double(casters_[id].margin));
}

void CasterTable::setMesh(CasterId id, MeshSlot mesh) {
    CHECK(meshes_[mesh].mesh != nullptr);
    casters_[id].mesh = mesh;
    place(id, casters_[id].placement);
}

void CasterTable::setMargin(CasterId id, float margin) {
    casters_[id].margin = margin;
    place(id, casters_[id].placement);
}

std::string CasterTable::describe(CasterId id) const {
    const CasterOrigin& o = casters_[id].origin;
    const std::string chunk = "chunk " + toString(o.chunk);
    if (o.slot < 0 && o.object >= 0) return "object " + std::to_string(o.object);
    if (o.object >= 0) return "object " + std::to_string(o.object) + " of " + chunk;
    if (o.slot < 0) return "terrain of " + chunk;
    return "instance " + std::to_string(o.slot) + " of " + chunk;
}

Box placedBounds(const Mesh& mesh, const Placement& placement) {
    return transformed(mesh.bounds, glm::dmat3(placement.linear), placement.translation);
}

double stretch(const Placement& placement) {
    // The Frobenius norm bounds the largest singular value from above by at most sqrt(3); with the
    // usual uniform scales it is exactly sqrt(3) times it, so divide where the columns agree.
    const glm::dmat3 m(placement.linear);
    const double a = glm::length(m[0]), b = glm::length(m[1]), c = glm::length(m[2]);
    const double longest = std::max({a, b, c});
    const bool orthogonal = std::abs(glm::dot(m[0], m[1])) <= 1e-6 * a * b &&
                            std::abs(glm::dot(m[1], m[2])) <= 1e-6 * b * c &&
                            std::abs(glm::dot(m[0], m[2])) <= 1e-6 * a * c;
    return orthogonal ? longest : std::sqrt(a * a + b * b + c * c);
}

}  // namespace world
