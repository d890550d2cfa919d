#include "tools/mover_feed.h"

#include <cmath>
#include <utility>

namespace tools {
namespace {

// Recordings carry decimals: millimetres, and quaternions to five places. A pose this near to the
// world's own is the same place, rounded.
constexpr double kSamePlace = 1e-3;   // [m]
constexpr double kSameLinear = 1e-4;  // of the largest factor

bool samePose(const world::MoverSample& a, const world::MoverSample& b) {
    return a.position == b.position && a.orientation == b.orientation && a.scale == b.scale;
}

bool standsAt(const world::Placement& a, const world::Placement& b) {
    double largest = 0, apart = 0;
    for (int column = 0; column < 3; ++column) {
        largest = std::max(largest, double(glm::length(b.linear[column])));
        apart = std::max(apart, double(glm::length(a.linear[column] - b.linear[column])));
    }
    return glm::length(a.translation - b.translation) <= kSamePlace && apart <= kSameLinear * largest;
}

}  // namespace

world::Placement moved(const world::Placement& rest, const world::MoverSample& pose) {
    glm::dvec3 factors(glm::length(glm::dvec3(rest.linear[0])), glm::length(glm::dvec3(rest.linear[1])),
                       glm::length(glm::dvec3(rest.linear[2])));
    const double mean = std::cbrt(factors.x * factors.y * factors.z);
    // A flat rest placement has no ratios that a scale could multiply: its factors are kept as they are.
    factors = mean > 0 ? factors * (pose.scale / mean) : factors;
    if (glm::determinant(rest.linear) < 0) factors.x = -factors.x;
    const glm::dmat3 rotation = glm::mat3_cast(pose.orientation);
    world::Placement placement;
    placement.linear = glm::mat3(rotation[0] * factors.x, rotation[1] * factors.y, rotation[2] * factors.z);
    placement.translation = pose.position;
    return placement;
}

world::Result<MoverFeed> MoverFeed::create(server::ShadowSystem& system,
                                           std::vector<world::MoverTrack> tracks) {
    MoverFeed feed;
    for (world::MoverTrack& track : tracks) {
        const auto id = system.adopt(track.name);
        if (!id) return id.error();
        Object object{std::move(track), id.value(), system.restPlacement(id.value()), {}, false};
        const world::MoverSample& first = object.track.samples.front();
        if (standsAt(moved(object.rest, first), object.rest)) {
            object.sent = first;
            object.known = true;
        }
        feed.objects_.push_back(std::move(object));
    }
    return feed;
}

std::span<const server::ObjectUpdate> MoverFeed::at(double time) {
    updates_.clear();
    for (Object& object : objects_) {
        const world::MoverSample& sample = world::sampleAt(object.track, time);
        if (object.known && samePose(sample, object.sent)) continue;
        object.sent = sample;
        object.known = true;
        updates_.push_back({object.id, moved(object.rest, sample)});
    }
    return updates_;
}

}  // namespace tools
