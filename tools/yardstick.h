// tools/yardstick.h — a fixed scene for comparison with other shadow systems: boxes on a large ground.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "world/path.h"
#include "world/result.h"

namespace tools {

constexpr uint32_t kYardstickBoxes = 10'000;  ///< of 12 triangles, nodes of one mesh
constexpr uint32_t kYardstickGround = 320;    ///< quads along each side
constexpr double kYardstickEdge = 2000;       ///< of the ground, which lies around the origin [m]

/// Writes it as a .glb: core glTF 2.0, boxes of 1 to 6 m by 1 to 12 m in height, strewn with `seed`, and one
/// level ground mesh. Equal seeds, equal files. kIo.
world::Result<world::Done> writeYardstick(const std::string& path, uint32_t seed);

/// Of light travel: azimuth 120, elevation 35 degrees, as in the built-in world.
glm::dvec3 yardstickSun();
/// 30 s along x through the middle at 15 m/s, 1.7 m high.
std::vector<world::Pose> yardstickTrack();

}  // namespace tools
