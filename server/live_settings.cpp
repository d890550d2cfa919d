#include "server/live_settings.h"

#include <glm/gtc/constants.hpp>
#include <sstream>

namespace server {
namespace {

template <class T>
std::string text(const T& value, const char* unit = "") {
    std::ostringstream out;
    out.precision(6);
    out << value << unit;
    return out.str();
}

std::string limit(uint64_t value) { return value == cache::Limits::kNone ? "none" : text(value, " a frame"); }
std::string mebibytes(uint64_t bytes) { return text(double(bytes) / double(1 << 20), " MiB"); }

const char* nameOf(world::Clock clock) {
    switch (clock) {
        case world::Clock::kLockStep: return "lock-step: frames wait for chunks";
        case world::Clock::kVirtual: return "virtual disk";
        case world::Clock::kLive: return "live: no frame waits for chunks";
    }
    return "";
}

}  // namespace

std::vector<LiveSetting> liveSettings(const ShadowConfig& c) {
    std::vector<LiveSetting> s{
        {"method", c.method == Method::kGnomon ? "cache and scroll" : "redraw everything"},
        {"cameras", text(c.cameras)},
        {"cascades", text(c.cascades)},
        {"map", text(c.side) + " x " + text(c.side) + " texels"},
        {"depth", c.format == gpu::DepthFormat::kD16 ? "16 bits" : "32 bits, float"},
        {"shadows reach", text(c.farDistance, " m")},
        {"split ratio", text(c.splitRatio)},
        {"guard band", text(c.guardBand, " texels")},
        {"level error", text(c.levelError, " texels")},
        {"smallest caster", c.smallestCaster > 0 ? text(c.smallestCaster, " texels") : "all are drawn"},
        {"sun", "along (" + text(c.sun.x) + ", " + text(c.sun.y) + ", " + text(c.sun.z) + ")" +
                    (c.movingSun ? ", may move" : ", fixed")},
        {"occlusion", c.occlusion ? "at most " + text(c.raysPerCluster, " rays a cluster") : "off"},
        {"rest before static", text(c.restSeconds, " s")},
        {"chunks come", nameOf(c.streaming.clock)},
        {"memory for chunks", mebibytes(c.residentBytes)},
        {"geometry on the GPU", mebibytes(c.geometryBytes)},
        {"texel budget", limit(c.budget.texels)},
        {"triangle budget", limit(c.budget.triangles)},
        {"time budget", c.budget.ms > 0 ? text(c.budget.ms, " ms a frame") : "none"},
    };
    if (c.movingSun) s.push_back({"sun step", text(c.sunMotion.step * 180 / glm::pi<double>(), " degrees")});
    return s;
}

}  // namespace server
