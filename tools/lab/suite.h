// tools/lab/suite.h — the failure suite: small worlds and ways through them, each with methods that must be seen to
// fail there, and what must hold. It tests the lab as well: a known bad method that nobody notices is a wrong verdict.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "cache/shadow_cache.h"
#include "gpu/device.h"
#include "tools/lab/record.h"
#include "tools/lab/run.h"
#include "tools/lab/stage.h"

namespace tools::lab {

/// A method, or one with a deliberate defect.
struct Contestant {
    std::string method;  ///< what culling::methodFrom takes
    cache::Sabotage sabotage = cache::Sabotage::kNone;
    Defect defect = Defect::kNone;
};
/// "gnomon:side=512, deaf to departures".
std::string nameOf(const Contestant& contestant);

/// One number of a run.
struct Measure {
    std::string name;  ///< with its unit
    double (*of)(const Measures&);
};

/// What a case says of a contestant.
struct Claim {
    enum class Kind : uint8_t {
        kFails,  ///< the measure is above 0 and at least `limit`
        kHolds,  ///< at most `limit`
    };
    Kind kind = Kind::kHolds;
    Contestant who;
    Measure measure;
    double limit = 0;                ///< in the measure's unit; with `than`: times what that contestant shows
    std::optional<Contestant> than{};
    std::string why;                 ///< where the limit comes from
};

struct SuiteCase {
    std::string name, what;  ///< a word; a line for people
    Stage stage;
    std::vector<world::Pose> poses;
    std::vector<size_t> judged;  ///< first frames of the pairs that are judged
    glm::dvec3 sun{0};           ///< direction of the light's travel; where it moves, at some moment
    double farDistance = 60;     ///< [m]
    double verticalFov = 0;      ///< [rad]
    std::function<glm::dvec3(double)> sunAt{};  ///< as of Setting, like those below
    std::function<double(double)> fovAt{};
    std::vector<world::MoverTrack> movers{};
    std::vector<Removal> removals{};
    server::ShadowConfig cache{};
    std::vector<Claim> claims;
};

enum class Verdict : uint8_t { kFailsAsItMust, kHolds, kFailsToFail, kDoesNotHold };
const char* toString(Verdict verdict);
inline bool wrong(Verdict verdict) { return verdict == Verdict::kFailsToFail || verdict == Verdict::kDoesNotHold; }

struct ClaimResult {
    Claim claim;
    double value = 0, threshold = 0;  ///< in the measure's unit
    Verdict verdict = Verdict::kDoesNotHold;
};

/// All of them, the same every time.
std::vector<SuiteCase> suiteCases();

/// Pixels that a case judges.
constexpr int kSuiteWidth = 160, kSuiteHeight = 90;

/// Runs each contestant of a case once, and holds every claim against what came out. Errors of what it runs, with
/// the case's name.
world::Result<std::vector<ClaimResult>> runCase(gpu::Device& device, const SuiteCase& c);

/// What is kept of them.
std::vector<ClaimRecord> recordsOf(const SuiteCase& c, const std::vector<ClaimResult>& results);

/// Lines of a table, one for each claim; wrong ones say why they were expected.
std::string suiteHead();
std::string suiteRows(const SuiteCase& c, const std::vector<ClaimResult>& results);

}  // namespace tools::lab
