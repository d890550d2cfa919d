// world/procedural_path.h — the built-in camera path through the built-in world, and its traffic.
#pragma once

#include <cstdint>
#include <vector>

#include "world/movers.h"
#include "world/path.h"
#include "world/procedural.h"
#include "world/procedural_field.h"

namespace world {

/// The camera 1.7 m above the ground, 30 poses a second for 66 s: it walks through a village (0 s),
/// stands and turns three and a half times (12 s), drives back along the road at 15 m/s (18 s), jumps
/// to the village across the world (48 s; more than 1 km in worlds of 2 km and more), walks (48 s) and
/// stands still (60 s). `options` must be those of the world.
std::vector<Pose> proceduralPath(uint64_t seed, const ProceduralOptions& options);

/// Vehicles on the road around that path, named `mover/0` to `mover/23`; every third stops for 14 s.
/// A track has a sample every 1/30 s while it moves; its first is the instance's place in the world.
std::vector<MoverTrack> proceduralMovers(uint64_t seed, const ProceduralOptions& options);

/// A mover's mesh (ProceduralMesh) by its number.
uint32_t proceduralMoverMesh(size_t mover);
/// The tracks on a landscape that is there already, in order of number.
std::vector<MoverTrack> moversOn(const Landscape& land);

/// The world's edge [m] after rounding up to whole chunks.
double proceduralSize(const ProceduralOptions& options);

}  // namespace world
