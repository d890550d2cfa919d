#include "tools/stress_case.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <functional>
#include <glm/glm.hpp>
#include <iterator>
#include <limits>
#include <random>
#include <utility>

#include "culling/light_space.h"

namespace tools {
namespace {

/// What cameras side by side may hold of what one needs at each moment: chunks that are read ahead come on top, and the
/// outer ones see a little more.
constexpr double kRowShare = 1.25;

/// How long an eye rests before it starts and at the end [s]: the last is long enough for the slowest disk below to
/// bring what is still wanted.
constexpr double kLead = 10, kRest = 30;

/// Where chunks lie, and how high [m].
struct Middle {
    glm::dvec3 at{0};
    double chunk = 0;
};

Middle middleOf(const world::WorldStore& store) {
    std::vector<double> x, z;
    for (const world::ChunkRecord& r : store.chunks()) {
        if (r.bounds.empty()) continue;
        x.push_back(r.key.x);
        z.push_back(r.key.z);
    }
    const auto median = [](std::vector<double>& values) {
        const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
        std::nth_element(values.begin(), middle, values.end());
        return *middle;
    };
    Middle m;
    if (x.empty()) return m;
    m.chunk = store.header().chunkSize;
    m.at = {(median(x) + 0.5) * m.chunk, 0, (median(z) + 0.5) * m.chunk};
    double nearest = std::numeric_limits<double>::max();
    for (const world::ChunkRecord& r : store.chunks()) {
        if (r.bounds.empty()) continue;
        const glm::dvec3 from = (r.bounds.min + r.bounds.max) * 0.5 - m.at;
        const double d = glm::length(glm::dvec2(from.x, from.z));
        if (d >= nearest) continue;
        nearest = d;
        m.at.y = r.bounds.max.y + 2;
    }
    return m;
}

using Way = std::function<glm::dvec3(double)>;  ///< of the time [s], from the middle [m]

Way straight(double speed, double seconds) {
    return [=](double t) { return glm::dvec3(speed * (t - seconds / 2), 0, 0.2 * speed * (t - seconds / 2)); };
}

Way orbit(double radius, double speed) {
    return [=](double t) {
        const double angle = speed / radius * t;
        return glm::dvec3(radius * std::cos(angle), 0, radius * std::sin(angle));
    };
}

/// Back and forth across the border between two chunks.
Way pingPong(double chunk, double reach, double speed) {
    return [=](double t) {
        const double phase = std::fmod(speed * t, 4 * reach);
        return glm::dvec3(chunk / 2 + (phase < 2 * reach ? phase - reach : 3 * reach - phase), 0, 0);
    };
}

/// A jump every two seconds, at rest in between.
Way teleports(uint64_t seed, double reach, double seconds) {
    std::mt19937_64 rng(seed);
    std::vector<glm::dvec3> stops;
    // Distributions differ between libraries; this division does not.
    const auto coordinate = [&] { return (double(rng() >> 11) * 0x1p-53 * 2 - 1) * reach; };
    for (double t = 0; t <= seconds + 2; t += 2) {
        const double x = coordinate(), z = coordinate();
        stops.push_back({x, 0, z});
    }
    return [stops](double t) { return stops[std::min(stops.size() - 1, size_t(t / 2))]; };
}

/// A lying eight: straight legs, then turns that a straight look ahead misses.
Way winding(double speed) {
    return [=](double t) {
        const double reach = 400, angle = speed / reach * t;
        return glm::dvec3(reach * std::sin(angle), 0, reach * std::sin(angle) * std::cos(angle));
    };
}

/// Poses of a case whose eye is where `pose` says at times from 0 to `seconds`.
void play(StressCase& c, double seconds, const std::function<world::Pose(double)>& pose) {
    c.start = size_t(kLead * kStressRate);
    c.end = c.start + size_t(seconds * kStressRate);
    c.poses.clear();
    for (size_t i = 0; i < c.end + size_t(kRest * kStressRate); ++i) {
        const size_t moved = std::clamp(i, c.start, c.end) - c.start;
        c.poses.push_back(pose(double(moved) / kStressRate));
        c.poses.back().time = double(i) / kStressRate;
    }
}

/// Where the ground is dug while the eye moves: upright capsules, as high as an edit may be, through chunks within the
/// far distance.
std::vector<std::pair<size_t, world::TerrainEdit>> shafts(const world::WorldStore& store, const StressCase& c,
                                                          uint64_t seed) {
    std::mt19937_64 rng(seed);
    std::vector<std::pair<size_t, world::TerrainEdit>> edits;
    for (size_t frame = c.start; frame < c.end; frame += size_t(kStressRate) / 2) {
        std::vector<const world::ChunkRecord*> near;
        for (const world::ChunkRecord& r : store.chunks()) {
            const glm::dvec3 from = (r.bounds.min + r.bounds.max) * 0.5 - c.poses[frame].position;
            if (!r.terrain.empty() && glm::length(glm::dvec2(from.x, from.z)) < c.config.farDistance) near.push_back(&r);
        }
        if (near.empty()) continue;
        const world::ChunkRecord& r = *near[rng() % near.size()];
        const double edge = store.header().chunkSize, radius = 4 * store.header().voxel;
        const glm::dvec3 middle((r.key.x + 0.5) * edge, (r.bounds.min.y + r.bounds.max.y) / 2, (r.key.z + 0.5) * edge);
        const glm::dvec3 half(0, edge / 2 - radius, 0);
        edits.push_back({frame, {world::EditKind::kDig, world::Capsule{middle - half, middle + half, radius}}});
    }
    return edits;
}

/// Further cameras: so many more, side by side with the first.
void flank(StressCase& c, int more, double gap) {
    for (int k = 1; k <= more; ++k) {
        c.others.push_back(c.poses);
        const double aside = (k % 2 == 0 ? 1 : -1) * gap * ((k + 1) / 2);
        for (world::Pose& pose : c.others.back()) pose.position.z += aside;
    }
    c.config.cameras = 1 + more;
}

class Cases {
public:
    Cases(const world::WorldStore& store, const StressPlan& plan) : middle_(middleOf(store)), plan_(plan) {}
    StressCase& add(const std::string& name, const std::string& what, const Way& way) {
        StressCase c;
        c.name = name;
        c.what = what;
        fly(c, way);
        c.config = plan_.config;
        c.config.streaming.disk.seed = plan_.seed;
        list_.push_back(std::move(c));
        return list_.back();
    }
    void fly(StressCase& c, const Way& way) const {
        play(c, plan_.seconds, [&](double t) { return world::Pose{t, middle_.at + way(t), {1, 0, 0, 0}}; });
    }
    const Middle& middle() const { return middle_; }
    std::vector<StressCase> take() && {
        return {std::make_move_iterator(list_.begin()), std::make_move_iterator(list_.end())};
    }

private:
    Middle middle_;
    const StressPlan& plan_;
    std::deque<StressCase> list_;  ///< which stay where they are while others are added
};

}  // namespace

std::vector<StressCase> stressCases(const world::WorldStore& store, const StressPlan& plan) {
    Cases cases(store, plan);
    const double seconds = plan.seconds;
    const Way flight = straight(50, seconds);
    for (const int speed : {10, 50, 100, 300})
        cases.add("straight-" + std::to_string(speed), "straight on at " + std::to_string(speed) + " m/s",
                  straight(speed, seconds))
            .mayLack = speed > 100;
    cases.add("orbit", "a circle of 200 m radius at 50 m/s", orbit(200, 50));
    cases.add("ping-pong", "back and forth over a chunk's border, 30 m each way at 20 m/s",
              pingPong(cases.middle().chunk, 30, 20));
    cases.add("teleports", "a random jump every two seconds",
              teleports(plan.seed, 3 * plan.config.farDistance, seconds))
        .mayLack = true;
    StressCase& low = cases.add("low-sun", "the sun 3 degrees high: casters far off count", flight);
    const glm::dvec3 sun = store.header().sun == glm::dvec3(0) ? glm::dvec3(1, -1, 0) : store.header().sun;
    low.config.sun = culling::sunFromAngles(std::atan2(-sun.x, sun.z), glm::radians(3.0));
    for (const auto& [name, share] : {std::pair("memory-half", 0.5), std::pair("memory-eighth", 0.125)}) {
        StressCase& tight = cases.add(name, "a part of the memory that this flight needs", flight);
        tight.memoryShare = share;
        tight.mayLack = true;
    }
    StressCase& slow = cases.add("slow-disk", "80 ms and 5 MB/s", flight);
    slow.config.streaming.disk.latency = 0.08;
    slow.config.streaming.disk.bandwidth = 5e6;
    slow.mayLack = true;
    StressCase& stalls = cases.add("stalling-disk", "one read of twenty takes a second longer", flight);
    stalls.config.streaming.disk.stallShare = 0.05;
    stalls.config.streaming.disk.stallSeconds = 1;
    stalls.mayLack = true;
    StressCase& bad = cases.add("failing-disk", "a tenth of the reads fails, one chunk of twenty is corrupt", flight);
    bad.config.streaming.disk.failShare = 0.1;
    bad.config.streaming.disk.corruptShare = 0.05;
    bad.mayLack = bad.losesChunks = true;
    // Live, a frame does not wait for an edit, and its maps may well be of the moment before.
    if (store.header().voxel > 0 && plan.config.streaming.clock != world::Clock::kLive) {
        StressCase& edits = cases.add("edits", "a shaft is dug twice a second, near the eye and far off, at 50 m/s", flight);
        edits.edits = shafts(store, edits, plan.seed);
    }
    for (const int count : {2, 4, 8}) {
        StressCase& row = cases.add("cameras-" + std::to_string(count),
                                    std::to_string(count) + " cameras two metres apart: they hold little more than one needs",
                                    flight);
        flank(row, count - 1, 2);
        row.mostShare = kRowShare;
    }
    StressCase& apart = cases.add("cameras-apart", "four cameras, each on its own way", flight);
    for (const Way& way : {orbit(200, 50), pingPong(cases.middle().chunk, 30, 20), winding(30)}) {
        StressCase other;
        cases.fly(other, way);
        apart.others.push_back(std::move(other.poses));
    }
    apart.config.cameras = 4;
    StressCase& all = cases.add("all", "jumps, a low sun, half the memory, and a slow disk that stalls and fails",
                                teleports(plan.seed + 1, 3 * plan.config.farDistance, seconds));
    all.config = low.config;
    all.config.streaming.disk = slow.config.streaming.disk;
    all.config.streaming.disk.stallShare = 0.05;
    all.config.streaming.disk.stallSeconds = 1;
    all.config.streaming.disk.failShare = 0.1;
    all.config.streaming.disk.corruptShare = 0.05;
    all.memoryShare = 0.5;
    all.mayLack = all.losesChunks = true;
    if (!plan.path.empty()) {
        const double first = plan.path.front().time, length = plan.path.back().time - first;
        play(cases.add("path", "the recorded path, from its beginning", flight), std::min(seconds, length),
             [&](double t) { return world::poseAt(plan.path, first + t); });
    }
    return std::move(cases).take();
}

std::vector<StressCase> prefetchCases(const world::WorldStore& store, const StressPlan& plan) {
    Cases cases(store, plan);
    for (const int speed : {50, 100, 200}) {
        for (const char* kind : {"none", "speed", "path"}) {
            StressCase& c = cases.add("prefetch-" + std::to_string(speed) + "-" + kind,
                                      "winding flight at " + std::to_string(speed) + " m/s, 40 ms and 20 MB/s",
                                      winding(speed));
            c.config.streaming.disk.latency = 0.04;
            c.config.streaming.disk.bandwidth = 20e6;
            c.config.streaming.prefetch = kind != std::string("none");
            c.foresight = kind == std::string("path");
            c.mayLack = true;
        }
    }
    return std::move(cases).take();
}

}  // namespace tools
