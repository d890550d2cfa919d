// world/mesh_changes.h — where two states of a shape differ, triangle by triangle.
#pragma once

#include "world/box.h"
#include "world/mesh.h"

namespace world {

/// Bounds of the triangles that only one of the two levels has; empty if they have the same ones. Triangles are the same
/// if their corners are, in the same order and every bit: drawn alike they give the same depths. In the frame of both [m].
Box changedBox(const MeshLevel& before, const MeshLevel& after);

}  // namespace world
