// culling/sun_steps.h — suns in quantised steps, so that maps of one direction serve for a while.
// Source: our own.
#pragma once

#include <glm/glm.hpp>

namespace culling {

/// The direction of a fixed grid nearest `sun` (unit, of light travel, from above the horizon): elevations
/// are multiples of `step` [rad, > 0], azimuths of about step / cos(elevation). The same sun gives the same
/// direction whatever came before; it is off by less than 0.75 steps. Within a step of
/// kLowestSun it may be off by one more: the grid's lowest direction is one that light spaces accept.
glm::dvec3 quantisedSun(glm::dvec3 sun, double step);

/// Angle between two unit vectors [rad], exact for small ones too.
double angleBetween(glm::dvec3 a, glm::dvec3 b);

}  // namespace culling
