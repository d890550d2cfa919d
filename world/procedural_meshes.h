// world/procedural_meshes.h — the shared meshes of the built-in world: trees, rocks, village, cars.
#pragma once

#include <cstdint>
#include <vector>

#include "world/mesh.h"

namespace world {

/// Index into `proceduralMeshes`.
enum ProceduralMesh : uint32_t {
    kConifer,
    kBroadleaf,
    kBush,
    kBoulder,
    kRockSlab,
    kHouse,
    kCottage,
    kShed,
    kPole,
    kWall,
    kFence,
    kCar,
    kVan,
    kTruck,
    kProceduralMeshCount,
};

/// One level each and no clusters; 36 to 600 triangles, every part closed, counter-clockwise from
/// outside. y = 0 is the ground, on which the mesh stands with something of it below; x and z are
/// around the middle. Cars look along -z; walls and fences are 4 m long, along x.
std::vector<Mesh> proceduralMeshes();

}  // namespace world
