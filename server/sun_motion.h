// server/sun_motion.h — when the sun's next direction gets maps of its own, and when it is shown.
// Source: our own.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <optional>

namespace server {

struct SunMotionConfig {
    double step = 0.00872664625997165;  ///< between directions [rad], (0, 0.2]; half a degree
    double blendSeconds = 0.25;         ///< for which old and new maps are blended, 0 or more
};

/// What a frame says of the sun.
struct SunReport {
    glm::dvec3 shown{0};  ///< direction of the maps that are shown, unit
    glm::dvec3 next{0};   ///< of those that are being filled or blended in; zero: none
    double weight = 0;    ///< of the next maps, [0, 1]; above 0 they are complete
    double lag = 0;       ///< angle between the sun and the direction shown [rad]
    bool redrawn = false; ///< the sun outran the cache: all maps were drawn anew, whatever the budget
};

/// Decides from time and direction alone; holds no map. One direction is shown. When the sun has left it
/// by a step, a second one is opened and filled while the first is shown, fast enough to be ready when the
/// sun has gone another half step; then the two are blended. A sun that crosses half a step in one frame,
/// or gets kMostLag steps away, cannot be followed: the shown maps are redrawn in its direction.
class SunMotion {
public:
    /// `shown` is the first direction, unit. `fills`: false where nothing is cached, and every step redraws.
    SunMotion(const SunMotionConfig& config, glm::dvec3 shown, bool fills) : config_(config), fills_(fills) {
        report_.shown = shown;
    }

    enum class Action { kNone, kOpen, kRedraw };
    struct Decision {
        Action action = Action::kNone;
        glm::dvec3 direction{0};  ///< to open or redraw
        bool dropNext = false;    ///< what was being filled is of no use any more
        double share = 0;         ///< of all texels: how much of the next maps to fill in this frame
    };
    /// A frame's sun at `time` [s, ascending]: unit, a direction that light spaces accept.
    Decision decide(double time, glm::dvec3 sun);
    /// After the frame's plan: whether the next maps are complete. True: they are to be shown from now on,
    /// and the old ones dropped.
    bool showNext(double time, bool complete);

    /// The maps of the next direction are gone.
    void dropNext();

    const SunReport& report() const { return report_; }

    static constexpr double kMostLag = 6;      ///< steps
    static constexpr double kMostFrames = 60;  ///< that a fill is spread over

private:
    SunMotionConfig config_;
    bool fills_;
    SunReport report_;
    std::optional<double> lastTime_, blendFrom_;
    glm::dvec3 lastSun_{0};
};

}  // namespace server
