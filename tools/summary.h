// tools/summary.h — what a whole replay cost, and what redrawing everything would have: sums over its
// frames, for people (a table) and for programs (summary.json).
#pragma once

#include <array>
#include <string>
#include <vector>

#include "tools/replay.h"

namespace tools {

/// What was replayed, for the head of a report.
struct ReplayHead {
    std::string world, worldHash, source;  ///< file name without folders, content hash, what was baked
    std::string path, movers;              ///< file names without folders; movers may be empty
    server::ShadowConfig config;
    std::vector<culling::SpotLight> spots;
    double verticalFov = 0, daySeconds = 0;  ///< as ReplayInput
    std::vector<double> texels, splits;  ///< per cascade [m]
    std::string device, driver;
    int threads = 0;
};

/// Times of one cascade or of all together, on the frames where both were measured [ms].
struct TimePair {
    std::vector<double> cached, redrawn;
};

struct CascadeSummary {
    std::array<cache::Cost, cache::kCauses> byCause{};
    std::array<uint64_t, cache::kCauses> framesByCause{};  ///< frames with any cost of that cause
    cache::Cost total, active;
    cache::Cost redraw;   ///< the static part drawn whole in each of the frames
    uint64_t frames = 0;  ///< in which the static part was touched
    uint64_t clustersFound = 0, clustersHidden = 0, trianglesHidden = 0;
    uint64_t sleepingFrames = 0;  ///< in which nothing it serves could be seen
    uint64_t owingFrames = 0;     ///< after which it owed texels, awake
    uint64_t mostUnknown = 0, mostStale = 0;  ///< texels after the worst frame each, awake
    uint64_t oldestDebt = 0;      ///< most frames that a texel of it was owed, awake
    double staticMs = 0, activeMs = 0;  ///< timestamps, summed
    TimePair staticTimes;
};

struct SpotSummary {
    std::array<cache::Cost, cache::kCauses> byCause{};     ///< drawn into its cache map
    std::array<uint64_t, cache::kCauses> framesByCause{};  ///< in which it was redrawn for that
    cache::Cost active;         ///< restored and drawn into its working map
    uint64_t activeFrames = 0;  ///< in which that was touched
};

/// Sums of the frames so far. Values only; every time in it is noisy, everything else deterministic.
struct Summary {
    uint64_t frames = 0, firstNumber = 0;
    double firstTime = 0, lastTime = 0;  ///< [s]
    std::vector<CascadeSummary> cascades;
    std::vector<SpotSummary> spots;
    uint64_t idleFrames = 0;  ///< in which nothing was submitted
    uint64_t chunkArrivals = 0, chunkDepartures = 0, arrivalFrames = 0;
    uint64_t refinements = 0, lackingFrames = 0;  ///< frames in which a map lacked a chunk, or had it too coarsely
    uint64_t missingTexels = 0, coarseTexels = 0;  ///< summed over frames
    double longestLack = 0;                        ///< [s]
    uint64_t mostResident = 0, mostGeometry = 0;   ///< bytes
    uint64_t bytesRead = 0, bytesAgain = 0, bytesUploaded = 0, rays = 0, certificates = 0, revocations = 0, errors = 0;
    uint64_t verifiedFrames = 0, verifiedTexels = 0, skippedTexels = 0, differingTexels = 0;
    uint64_t sunSteps = 0, sunRedraws = 0;  ///< directions shown one after the other; of these, redrawn whole
    double mostSunLag = 0;                  ///< [rad]
    glm::dvec3 lastSun{0};                  ///< shown
    uint64_t planHash = 0;  ///< chained over the frames
    std::vector<MapHashes> lastHashes;
    std::vector<double> frameMs;  ///< wall time of each advance
    server::StageTimes cpu;       ///< summed
    double gpuWallMs = 0;         ///< summed
    TimePair update;              ///< record and submit to fence, static and active part, all maps
    TimePair spotTimes;           ///< of these, all spot lights, by timestamp

    void add(const ReplayFrame& frame);
};

/// The value that a share `q` in [0, 1] of `values` does not exceed (nearest rank); 0 for none.
double quantile(std::vector<double> values, double q);
inline double median(const std::vector<double>& values) { return quantile(values, 0.5); }

/// What certificates were worth: a hidden triangle is taken to save the mean time of a drawn one of its
/// cascade.
struct OcclusionValue {
    uint64_t found = 0, hidden = 0;  ///< clusters, over all frames and cascades
    uint64_t trianglesHidden = 0;    ///< likewise
    double msSaved = 0;              ///< estimated and noisy
};
OcclusionValue occlusionValue(const Summary& summary);

/// What the maps were like and how chunks came, as the member "settings" of summary.json has it, in one line.
std::string settingsJson(const ReplayHead& head);

/// summary.json. Everything but the members "times" and "machine" is deterministic.
std::string toJson(const ReplayHead& head, const Summary& summary);

/// The same for people, many lines.
std::string toText(const ReplayHead& head, const Summary& summary);

}  // namespace tools
