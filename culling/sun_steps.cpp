#include "culling/sun_steps.h"

#include <algorithm>
#include <cmath>
#include <glm/gtc/constants.hpp>

#include "culling/light_space.h"

namespace culling {

glm::dvec3 quantisedSun(glm::dvec3 sun, double step) {
    const double elevation = std::asin(std::clamp(-sun.y, -1.0, 1.0));
    const double azimuth = std::atan2(-sun.x, sun.z);
    // The lowest multiple that a light space accepts.
    const double lowest = std::ceil(kLowestSun / step * (1 + 1e-12));
    const double height = std::min(std::max(std::round(elevation / step), lowest) * step, glm::half_pi<double>());
    const double around = glm::two_pi<double>();
    // As many as the widest circle of the band needs.
    const double cells = std::max(1.0, std::ceil(around * std::cos(height - step / 2) / step));
    return sunFromAngles(std::round(azimuth / around * cells) / cells * around, height);
}

double angleBetween(glm::dvec3 a, glm::dvec3 b) {
    return std::atan2(glm::length(glm::cross(a, b)), glm::dot(a, b));
}

}  // namespace culling
