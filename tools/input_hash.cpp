#include "tools/input_hash.h"

#include <cstdio>

#include "world/hash.h"

namespace tools {

uint64_t hashText(const std::string& text, uint64_t seed) {
    // The length first: two texts never run into each other.
    const uint64_t size = text.size();
    return world::hashValues(std::span<const char>(text), world::hashValues(std::span(&size, 1), seed));
}

uint64_t hashPoses(std::span<const world::Pose> poses, uint64_t seed) {
    std::vector<double> values;
    for (const world::Pose& p : poses)
        values.insert(values.end(), {p.time, p.position.x, p.position.y, p.position.z, p.orientation.w,
                                     p.orientation.x, p.orientation.y, p.orientation.z});
    const uint64_t size = values.size();
    return world::hashValues(std::span<const double>(values), world::hashValues(std::span(&size, 1), seed));
}

uint64_t hashMovers(const std::vector<world::MoverTrack>& tracks, uint64_t seed) {
    for (const world::MoverTrack& track : tracks) {
        std::vector<world::Pose> poses;
        std::vector<double> scales;
        for (const world::MoverSample& s : track.samples) {
            poses.push_back({s.time, s.position, s.orientation});
            scales.push_back(s.scale);
        }
        seed = world::hashValues(std::span<const double>(scales), hashPoses(poses, hashText(track.name, seed)));
    }
    return seed;
}

std::string hexOf(uint64_t hash) {
    char text[20];
    std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(hash));
    return text;
}

}  // namespace tools
