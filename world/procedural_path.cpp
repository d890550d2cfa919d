// world/procedural_path.cpp — see procedural_path.h.
#include "world/procedural_path.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "world/noise.h"
#include "world/procedural_meshes.h"

namespace world {
namespace {

constexpr int kRate = 30;  // samples a second
constexpr int kSeconds = 66;
constexpr double kEye = 1.7;                // [m] over the ground
constexpr double kWalk = 1.5, kDrive = 15;  // [m/s]
constexpr double kSidewalk = 5.5;           // [m] to the right of the road's middle
constexpr double kTurnRate = 210;           // [degrees/s]
constexpr size_t kMovers = 24;

glm::dvec3 onGround(const Landscape& land, const RoadPoint& road, double right) {
    const glm::dvec2 p = road.position + road.right() * right;
    return {p.x, land.groundHeight(p.x, p.y), p.y};
}

/// Rotation about y that turns -z into `forward` (x, z).
double yawOf(glm::dvec2 forward) { return std::atan2(-forward.x, -forward.y); }

/// Two villages across from each other: distances along the road.
std::pair<double, double> villagesOf(const Landscape& land) {
    return {land.villages().front(), land.villages()[land.villages().size() / 2]};
}

/// How far [m] a mover has come after `time`: at `speed`, but every third stands from 16 to 30 s with
/// two seconds of braking before and of starting after.
double progress(size_t mover, double speed, double time) {
    if (mover % 3 != 0) return speed * time;
    constexpr double kBrake = 14, kStop = 16, kStart = 30, kGo = 32;
    const auto half = [&](double t) { return speed * t * t / 4; };  // distance of a ramp of 2 s
    if (time <= kBrake) return speed * time;
    if (time <= kStop) return speed * kBrake + speed - half(kStop - time);
    if (time <= kStart) return speed * (kBrake + 1);
    if (time <= kGo) return speed * (kBrake + 1) + half(time - kStart);
    return speed * (kBrake + 2) + speed * (time - kGo);
}

}  // namespace

double proceduralSize(const ProceduralOptions& options) {
    return 2 * std::ceil(options.size / 2 / options.chunkSize) * options.chunkSize;
}

std::vector<Pose> proceduralPath(uint64_t seed, const ProceduralOptions& options) {
    const Landscape land(seed, proceduralSize(options));
    const auto [first, second] = villagesOf(land);
    std::vector<Pose> path;
    for (int i = 0; i <= kRate * kSeconds; ++i) {
        const double t = double(i) / kRate;
        double along = 0, right = kSidewalk, turn = 0;
        if (t < 48) {
            along = first + kWalk * std::min(t, 12.0) - kDrive * std::max(t - 18, 0.0);
            turn = glm::radians(kTurnRate * glm::clamp(t - 12, 0.0, 6.0));
            right = kSidewalk * (1 - smoothStep(18, 22, t));
        } else {
            along = second + kWalk * std::min(t - 48, 12.0);
        }
        const RoadPoint road = land.road(along);
        const double yaw = yawOf(road.forward) + turn;
        path.push_back({.time = t,
                        .position = onGround(land, road, right) + glm::dvec3(0, kEye, 0),
                        .orientation = glm::angleAxis(yaw, glm::dvec3(0, 1, 0))});
    }
    return path;
}

uint32_t proceduralMoverMesh(size_t mover) { return mover % 5 == 4 ? kTruck : mover % 4 == 1 ? kVan : kCar; }

std::vector<MoverTrack> moversOn(const Landscape& land) {
    const auto [first, second] = villagesOf(land);
    std::vector<MoverTrack> tracks;
    for (size_t m = 0; m < kMovers; ++m) {
        // A third in each of: the right lane, the left lane (the other way), and the left lane's verge,
        // where those are that stop. Along the first drive, then around the second village.
        const size_t row = m / 3;
        const size_t lane = m % 3;
        const double way = lane == 1 ? 1 : -1, speed = lane == 1 ? 12 : lane == 2 ? 10 : 8;
        const double right = lane == 1 ? 2.7 : lane == 2 ? -2.7 : -5.6;
        const double from = row < 5 ? first + 60 - 75 * double(row) - 20 * double(lane)
                                    : second + 110 - 75 * double(row - 5) - 20 * double(lane);
        MoverTrack track{.name = "mover/" + std::to_string(m), .samples = {}};
        for (int i = 0; i <= kRate * kSeconds; ++i) {
            const double t = double(i) / kRate, along = from + way * progress(m, speed, t);
            if (!track.samples.empty() && i < kRate * kSeconds &&
                progress(m, speed, t) == progress(m, speed, t - 1.0 / kRate)) {
                continue;
            }
            const glm::dvec3 here = onGround(land, land.road(along), right);
            const glm::dvec3 ahead = onGround(land, land.road(along + way * 1.5), right);
            const glm::dvec3 back = -glm::normalize(ahead - here);
            const glm::dvec3 side = glm::normalize(glm::cross(glm::dvec3(0, 1, 0), back));
            track.samples.push_back({.time = t,
                                     .position = here,
                                     .orientation = glm::normalize(
                                         glm::quat_cast(glm::dmat3(side, glm::cross(back, side), back))),
                                     .scale = 1});
        }
        tracks.push_back(std::move(track));
    }
    return tracks;
}

std::vector<MoverTrack> proceduralMovers(uint64_t seed, const ProceduralOptions& options) {
    std::vector<MoverTrack> tracks = moversOn(Landscape(seed, proceduralSize(options)));
    std::sort(tracks.begin(), tracks.end(), [](const auto& a, const auto& b) { return a.name < b.name; });
    return tracks;
}

}  // namespace world
