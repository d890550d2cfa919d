#include "tools/bench_motion.h"

#include <algorithm>
#include <cmath>
#include <glm/gtc/constants.hpp>

#include "world/noise.h"

namespace tools {
namespace {

using world::Pose;

constexpr double kSlow = 3, kJump = 100;    // [m/s]
constexpr double kWalk = 1.5, kDrive = 15;  // [m/s]
constexpr double kTurn = 210;               // [degrees/s]
constexpr uint32_t kMovers = 200;
constexpr double kMoverSize = 5;                // [m]
constexpr double kNearest = 6, kFarthest = 60;  // [m] from the eye
constexpr double kCircle = 4, kMoverSpeed = 5;  // [m], [m/s]
constexpr double kEyeHeight = 1.7;              // [m]
constexpr uint32_t kSeed = 7;

size_t framesOf(double seconds, size_t most) {
    return std::min(most, static_cast<size_t>(std::lround(seconds * kBenchFps)));
}

/// The longest run of poses between which the speed is in [slowest, kJump); empty if it has no metre.
std::vector<Pose> longestRun(std::span<const Pose> path, double slowest) {
    size_t begin = 0, bestBegin = 0, bestEnd = 0;
    double length = 0, best = 1;
    for (size_t k = 1; k < path.size(); ++k) {
        const double step = glm::distance(path[k].position, path[k - 1].position);
        const double speed = step / (path[k].time - path[k - 1].time);
        if (speed < slowest || speed >= kJump) {
            begin = k;
            length = 0;
            continue;
        }
        length += step;
        if (length <= best) continue;
        best = length;
        bestBegin = begin;
        bestEnd = k + 1;
    }
    return {path.begin() + std::ptrdiff_t(bestBegin), path.begin() + std::ptrdiff_t(bestEnd)};
}

std::vector<Pose> stand(const Pose& pose, size_t frames, double degreesPerSecond) {
    std::vector<Pose> poses(frames, pose);
    for (size_t k = 0; k < frames; ++k) {
        poses[k].time = double(k) / kBenchFps;
        const double turn = glm::radians(degreesPerSecond * poses[k].time);
        poses[k].orientation = glm::angleAxis(turn, glm::dvec3(0, 1, 0)) * pose.orientation;
    }
    return poses;
}

}  // namespace

world::Result<std::vector<Pose>> travelled(std::span<const Pose> path) {
    for (const double slowest : {kSlow, 0.0})
        if (std::vector<Pose> run = longestRun(path, slowest); !run.empty()) return run;
    return world::Error{world::ErrorCode::kUsage,
                        "the path stays where it is, nothing can be driven along it: give one that travels"};
}

std::vector<Pose> follow(std::span<const Pose> track, double speed, size_t frames) {
    std::vector<Pose> poses{track.front()};
    poses.front().time = 0;
    const double stride = speed / kBenchFps;
    double from = 0;  // distance along the track at which its pose k - 1 stands
    for (size_t k = 1; k < track.size(); ++k) {
        const double step = glm::distance(track[k].position, track[k - 1].position);
        while (poses.size() < frames && step > 0 && double(poses.size()) * stride <= from + step) {
            const double share = (double(poses.size()) * stride - from) / step;
            poses.push_back(
                {.time = double(poses.size()) / kBenchFps,
                 .position = glm::mix(track[k - 1].position, track[k].position, share),
                 .orientation = glm::slerp(track[k - 1].orientation, track[k].orientation, share)});
        }
        from += step;
    }
    return poses;
}

std::vector<Motion> benchMotions(std::span<const Pose> track, size_t frames) {
    const Pose& first = track.front();
    const size_t still = framesOf(10, frames);
    return {{"walking", follow(track, kWalk, framesOf(10, frames))},
            {"driving", follow(track, kDrive, framesOf(30, frames))},
            {"turning", stand(first, framesOf(6, frames), kTurn)},
            {"standing", stand(first, still, 0)},
            {std::to_string(kMovers) + " movers", stand(first, still, 0), kMovers}};
}

std::optional<uint32_t> moverMesh(const world::WorldStore& store) {
    std::optional<uint32_t> best;
    const auto mismatch = [&](uint32_t mesh) {
        return std::abs(glm::length(store.meshes()[mesh].bounds.extent()) - kMoverSize);
    };
    for (uint32_t mesh = 0; mesh < store.meshes().size(); ++mesh) {
        if (store.meshes()[mesh].bounds.empty()) continue;
        if (!best || mismatch(mesh) < mismatch(*best)) best = mesh;
    }
    return best;
}

world::Placement moverAt(uint32_t mover, glm::dvec3 eye, double time) {
    const auto unit = [mover](int32_t what) { return world::hashUnit(int32_t(mover), what, 0, kSeed); };
    const double where = glm::two_pi<double>() * unit(0), far = glm::mix(kNearest, kFarthest, unit(1));
    const double angle = glm::two_pi<double>() * unit(2) + kMoverSpeed / kCircle * time;
    world::Placement placement;
    // Local -z looks along the circle.
    placement.linear =
        glm::mat3(glm::mat3_cast(glm::angleAxis(-angle + glm::pi<double>(), glm::dvec3(0, 1, 0))));
    placement.translation = eye + glm::dvec3(far * std::cos(where) + kCircle * std::cos(angle), -kEyeHeight,
                                             far * std::sin(where) + kCircle * std::sin(angle));
    return placement;
}

}  // namespace tools
