#include "culling/light_space.h"

#include <cmath>

namespace culling {

world::Result<LightSpace> makeLightSpace(glm::dvec3 sunDirection) {
    const double length = glm::length(sunDirection);
    if (!std::isfinite(length) || length <= 0)
        return world::Error{world::ErrorCode::kUsage,
                            "sun direction: not a finite vector with a length; give --sun AZIMUTH,ELEVATION"};
    LightSpace space;
    space.sun = sunDirection / length;
    if (-space.sun.y < std::sin(kLowestSun))
        return world::Error{world::ErrorCode::kUsage,
                            "sun: less than 1 degree above the horizon; give --sun AZIMUTH,ELEVATION "
                            "with an elevation from 1 to 90"};
    // Any fixed rule for x will do, as long as it depends on the sun alone; world +x or, for a sun
    // that shines along x, world +z is never parallel to the light.
    const glm::dvec3 helper = std::abs(space.sun.x) < 0.9 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 0, 1);
    const glm::dvec3 y = glm::normalize(glm::cross(space.sun, helper));
    const glm::dvec3 x = glm::cross(y, space.sun);
    space.lightFromWorld = glm::transpose(glm::dmat3(x, y, space.sun));
    return space;
}

glm::dvec3 sunFromAngles(double azimuth, double elevation) {
    const double level = std::cos(elevation);
    return -glm::dvec3(level * std::sin(azimuth), std::sin(elevation), -level * std::cos(azimuth));
}

}  // namespace culling
