// tools/lab/tune.h — the cheapest settings of Gnomon's maps that a scene asks for: on the path at hand, and on others like it.
#pragma once

#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "culling/shadow_method.h"
#include "tools/lab/run.h"
#include "world/result.h"

namespace tools::lab {

/// Texels redrawn that take as long as a triangle: lavapipe took 10 ms for 40,600 triangles and 142,000 texels, and 19 for
/// 52,900 and 530,000, on the built-in path's drive.
constexpr double kTexelsPerTriangle = 11;

/// What the judged pairs of frames have in the mean, and what the mean of as many others stays below in 9 of 10 cases if
/// they vary as these do: two standard deviations of the difference of two such means above. One pair tells of no others.
struct Figure {
    double here = 0, elsewhere = 0;
};

/// What a configuration came to.
struct Trial {
    culling::ShadowMethod method;
    Figure error;        ///< false lit and false shadow [% of the pixels that face the sun]
    Figure instability;  ///< flips per million points
    double cost = 0;     ///< triangles a frame, kTexelsPerTriangle texels counted as one
};
Trial trialOf(const MethodResult& result);

/// What must not be exceeded, errors and flips not elsewhere either; infinite: anything goes.
struct TuneLimits {
    double error = std::numeric_limits<double>::infinity();
    double instability = std::numeric_limits<double>::infinity();
    double cost = std::numeric_limits<double>::infinity();
};

struct Tuned {
    std::vector<Trial> trials;  ///< in order; the first is the start
    size_t best = 0;            ///< of those
    bool met = false;           ///< the best keeps all limits
};

/// Goes from a method, setting by setting, to neighbours that are better: nearer to the limits or, within them, cheaper;
/// of less error where the cost is what is limited. Until none is, or so many were tried. Deterministic if `judge`
/// is; its errors pass through.
world::Result<Tuned> tune(const culling::ShadowMethod& start, const TuneLimits& limits, size_t mostTrials,
                          const std::function<world::Result<Trial>(const culling::ShadowMethod&)>& judge);

/// For people: the best beside the start, what each limit costs, and where the limits are not met, which is nearest and
/// by how much.
std::string tuneText(const Tuned& tuned, const TuneLimits& limits);

}  // namespace tools::lab
