// tools/options.h — words of the command line turned into values, and errors into exit statuses.
#pragma once

#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <string>

#include "culling/spot_light.h"
#include "world/result.h"

namespace CLI {
class Validator;
}

namespace tools {

/// Frame numbers begin <= n < end.
struct FrameRange {
    uint64_t begin = 0, end = 0;
    friend bool operator==(const FrameRange&, const FrameRange&) = default;
};

/// Exit status of a command that failed: 2 for kUsage, 3 for everything else. 0 is success, and 1 a
/// replay whose maps differ from their redraw.
int exitStatus(world::ErrorCode code);

/// A number from `least` to `most`; CLI::Range takes NaN as well.
CLI::Validator within(double least, double most);

/// "A:B" with A < B. kUsage names the option.
world::Result<FrameRange> parseFrameRange(const std::string& text);

/// "AZIMUTH,ELEVATION" [degrees] as the direction of the light's travel, unit. Azimuth runs clockwise
/// from north (-z). kUsage for what is not two numbers and for a sun less than 1 degree high.
world::Result<glm::dvec3> parseSun(const std::string& text);

/// "X,Y,Z,DX,DY,DZ,ANGLE,RANGE": position [m], direction, angle between axis and edge [degrees], range [m].
/// kUsage for what is not eight numbers and for a light that cannot be.
world::Result<culling::SpotLight> parseSpot(const std::string& text);

/// "XMIN,YMIN,XMAX,YMAX" with XMIN < XMAX and YMIN < YMAX, in the units of the source.
world::Result<std::array<double, 4>> parseBounds(const std::string& text);

/// A whole number >= 1. kUsage names `option`.
world::Result<uint64_t> parseCount(const std::string& option, const std::string& text);

}  // namespace tools
