// world/path.h — recorded camera paths in the TUM trajectory format.
// Source: Sturm et al., "A Benchmark for the Evaluation of RGB-D SLAM Systems", 2012 (file format).
#pragma once

#include <glm/glm.hpp>
#include <glm/gtc/quaternion.hpp>
#include <string>
#include <vector>

#include "world/result.h"

namespace world {

/// Camera-to-world: local x right, y up, looking along -z.
struct Pose {
    double time = 0;             ///< [s]
    glm::dvec3 position{0};      ///< [m]
    glm::dquat orientation{1, 0, 0, 0};  ///< unit, (w, x, y, z)
};

/// Reads lines `t tx ty tz qx qy qz qw`; '#' starts a comment. Quaternions within 1e-3 of unit
/// length are normalised. kNotFound, or kBadData that names file, line and remedy: too few or too
/// many fields, a number that is not finite, time that does not ascend, a quaternion of no length,
/// an empty file.
Result<std::vector<Pose>> readTum(const std::string& path);
Result<Done> writeTum(const std::string& path, const std::vector<Pose>& poses);

/// The pose at `time`: position linear, orientation along the shorter arc; held at both ends.
/// `path` is not empty and ascends.
Pose poseAt(const std::vector<Pose>& path, double time);

}  // namespace world
