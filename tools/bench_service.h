// tools/bench_service.h — what a session costs over the wire beside the same session in process, points a second, and
// many sessions at once.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "tools/bench_report.h"
#include "world/path.h"
#include "world/result.h"

namespace tools {

/// A session's frames, one by one [ms].
struct FrameTimes {
    std::vector<double> all;    ///< as the caller waits for them
    std::vector<double> drawn;  ///< as their replies say
    std::vector<double> rest;   ///< all but that
};

struct ServiceCost {
    FrameTimes direct, shown, watched, served;  ///< in process, on a live board, watched there, and by `gnomon serve`
    FrameTimes directWaited, servedWaited;      ///< the same, of frames that ask for the GPU's time and so wait for it
    std::vector<double> refused, refusedRested;  ///< served frames that draw nothing, at once and after a rest [ms]
    std::vector<double> directQuery, servedQuery;  ///< questions of `points` points [ms]
    size_t points = 0;
};

/// Plays the poses, a second each in turns, in process and over the wire, and then asks. The program `gnomon` beside this one
/// serves. kNotFound where it is not there; errors of world, device and service.
///   world  file; its folder is served
world::Result<ServiceCost> measureService(const std::string& world, std::span<const world::Pose> poses, int questions);
std::string serviceText(const ServiceCost& cost);
/// At most 0.5 ms more than in process, a million points a second.
std::vector<Goal> serviceGoals(const ServiceCost& cost);

struct CrowdConfig {
    size_t sessions = 16;  ///< each goes to and fro over a stretch of the path, as fast as it is answered
    size_t idle = 0;       ///< connections beside them that ask nothing
    double seconds = 60;
};

struct CrowdCost {
    std::vector<uint64_t> frames;  ///< by session
    uint64_t errors = 0;
    std::string firstError;
    double seconds = 0;
    double frontThen = 0, frontNow = 0, workerThen = 0, workerNow = 0;  ///< resident [MiB] after a quarter of the time, and at its end
};

world::Result<CrowdCost> measureCrowd(const std::string& world, std::span<const world::Pose> poses, const CrowdConfig& config);
std::string crowdText(const CrowdCost& cost, const CrowdConfig& config);
/// No error, nobody has twice another's frames, memory stays within a twentieth.
std::vector<Goal> crowdGoals(const CrowdCost& cost);

}  // namespace tools
