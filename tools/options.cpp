#include "tools/options.h"

#include <CLI/CLI.hpp>

#include <charconv>
#include <cmath>
#include <sstream>
#include <string_view>

#include "culling/light_space.h"

namespace tools {
namespace {

world::Error usage(std::string what) { return {world::ErrorCode::kUsage, std::move(what)}; }

/// True if `text` is one number of type T from its first character to its last.
template <class T>
bool parseWhole(std::string_view text, T& value) {
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    return error == std::errc() && end == text.data() + text.size();
}

/// True if `text` is N finite numbers with commas between them.
template <size_t N>
bool parseNumbers(std::string_view text, std::array<double, N>& values) {
    for (size_t i = 0; i < N; ++i) {
        const size_t comma = text.find(',');
        if ((comma == std::string_view::npos) != (i + 1 == N)) return false;
        if (!parseWhole(text.substr(0, comma), values[i]) || !std::isfinite(values[i])) return false;
        if (i + 1 < N) text.remove_prefix(comma + 1);
    }
    return true;
}

}  // namespace

CLI::Validator within(double least, double most) {
    std::ostringstream range;
    range << least << " to " << most;
    return CLI::Validator(
        [=, text = range.str()](std::string& given) -> std::string {
            double value = 0;
            return parseWhole(given, value) && value >= least && value <= most ? "" : "'" + given + "'; give " + text;
        },
        "[" + range.str() + "]");
}

int exitStatus(world::ErrorCode code) { return code == world::ErrorCode::kUsage ? 2 : 3; }

world::Result<FrameRange> parseFrameRange(const std::string& text) {
    const std::string_view view = text;
    const size_t colon = view.find(':');
    FrameRange range;
    if (colon == std::string_view::npos || !parseWhole(view.substr(0, colon), range.begin) ||
        !parseWhole(view.substr(colon + 1), range.end) || range.begin >= range.end)
        return usage("--frames " + text + ": not a range; give FIRST:END, as in 100:200, with FIRST < END");
    return range;
}

world::Result<glm::dvec3> parseSun(const std::string& text) {
    std::array<double, 2> degrees{};
    if (!parseNumbers(text, degrees) || std::abs(degrees[1]) > 90)
        return usage("--sun " + text + ": not a direction; give AZIMUTH,ELEVATION in degrees, as in 135,40");
    const glm::dvec3 sun = culling::sunFromAngles(glm::radians(degrees[0]), glm::radians(degrees[1]));
    if (const auto space = culling::makeLightSpace(sun); !space)
        return usage("--sun " + text + ": " + space.error().what);
    return sun;
}

world::Result<culling::SpotLight> parseSpot(const std::string& text) {
    std::array<double, 8> n{};
    if (!parseNumbers(text, n))
        return usage("--spot " + text + ": not a light; give X,Y,Z,DX,DY,DZ,ANGLE,RANGE in metres and degrees, as in "
                     "0,8,0,0,-1,0,35,30");
    culling::SpotLight light;
    light.position = {n[0], n[1], n[2]};
    light.direction = {n[3], n[4], n[5]};
    light.halfAngle = glm::radians(n[6]);
    light.range = n[7];
    if (const auto space = culling::makeSpotSpace(light); !space)
        return usage("--spot " + text + ": " + space.error().what);
    return light;
}

world::Result<std::array<double, 4>> parseBounds(const std::string& text) {
    std::array<double, 4> bounds{};
    if (!parseNumbers(text, bounds) || bounds[0] >= bounds[2] || bounds[1] >= bounds[3])
        return usage("--bounds " + text +
                     ": not a rectangle; give XMIN,YMIN,XMAX,YMAX, each minimum below "
                     "its maximum");
    return bounds;
}

world::Result<uint64_t> parseCount(const std::string& option, const std::string& text) {
    uint64_t count = 0;
    if (!parseWhole(std::string_view(text), count) || count == 0)
        return usage(option + " " + text + ": not a count; give a whole number from 1");
    return count;
}

}  // namespace tools
