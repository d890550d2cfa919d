// world/movers.h — recorded motion of objects: a CSV of world poses over time.
#pragma once

#include <glm/glm.hpp>
#include <glm/gtc/quaternion.hpp>
#include <string>
#include <vector>

#include "world/mesh.h"
#include "world/result.h"

namespace world {

struct MoverSample {
    double time = 0;  ///< [s]
    glm::dvec3 position{0};
    glm::dquat orientation{1, 0, 0, 0};
    double scale = 1;  ///< > 0, of the whole object
};

/// One object's motion; samples ascend in time.
struct MoverTrack {
    std::string name;  ///< of an instance in the world
    std::vector<MoverSample> samples;
};

/// Reads a CSV with the header `time,id,node_or_mesh,x,y,z,qx,qy,qz,qw,scale`. Rows of one name make
/// one track; tracks are sorted by name. kNotFound, or kBadData that names file, line and remedy.
Result<std::vector<MoverTrack>> readMovers(const std::string& path);
Result<Done> writeMovers(const std::string& path, const std::vector<MoverTrack>& tracks);

/// The latest sample at or before `time` (the first one before the track starts). Not interpolated:
/// recorded jumps stay jumps.
const MoverSample& sampleAt(const MoverTrack& track, double time);

/// Placement of an object whose world placement is `rest` at a recorded pose. A recording has one scale, the cube root of
/// the object's three factors, so the rest placement's own factors keep their ratios; a mirrored rest placement stays
/// mirrored, along its own x. Total: no failure.
Placement moved(const Placement& rest, const MoverSample& pose);

/// Whether `a` is the place `b`, as far as a recording's decimals tell: millimetres, and quaternions to five places.
bool standsAt(const Placement& a, const Placement& b);

}  // namespace world
