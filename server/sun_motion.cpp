#include "server/sun_motion.h"

#include <algorithm>
#include <limits>

#include "culling/sun_steps.h"

namespace server {

namespace {

/// A quantised direction is off by less than this [steps]: nearer than it the sun is served.
constexpr double kServed = 0.75;

}  // namespace

SunMotion::Decision SunMotion::decide(double time, glm::dvec3 sun) {
    Decision decision;
    const double moved = lastTime_ ? culling::angleBetween(sun, lastSun_) : 0;
    lastTime_ = time;
    lastSun_ = sun;
    report_.redrawn = false;
    report_.lag = culling::angleBetween(sun, report_.shown);
    const double framesPerStep = moved > 0 ? config_.step / moved : std::numeric_limits<double>::infinity();
    const bool open = report_.next != glm::dvec3(0);
    if (report_.lag <= kServed * config_.step && !open) return decision;

    const glm::dvec3 direction = culling::quantisedSun(sun, config_.step);
    if (!fills_ || framesPerStep < 2 || report_.lag > kMostLag * config_.step) {
        decision = {Action::kRedraw, direction, open, 0};
        dropNext();
        report_.shown = direction;
        report_.redrawn = true;
        report_.lag = culling::angleBetween(sun, direction);
        return decision;
    }
    if (!open) {
        decision.action = Action::kOpen;
        decision.direction = report_.next = direction;
    }
    decision.share = 1 / std::clamp(framesPerStep / 2, 1.0, kMostFrames);
    return decision;
}

void SunMotion::dropNext() {
    report_.next = glm::dvec3(0);
    report_.weight = 0;
    blendFrom_.reset();
}

bool SunMotion::showNext(double time, bool complete) {
    if (report_.next == glm::dvec3(0)) return false;
    // Owed again while it is blended in, for lack of budget: the old maps hold the fort.
    if (!complete) blendFrom_.reset();
    else if (!blendFrom_) blendFrom_ = time;
    if (!blendFrom_) {
        report_.weight = 0;
        return false;
    }
    report_.weight = config_.blendSeconds > 0 ? std::min(1.0, (time - *blendFrom_) / config_.blendSeconds) : 1;
    // A sun that is a step past the next direction already waits for no blend.
    if (culling::angleBetween(lastSun_, report_.next) > config_.step) report_.weight = 1;
    if (report_.weight < 1) return false;
    report_.shown = report_.next;
    report_.lag = culling::angleBetween(lastSun_, report_.shown);
    dropNext();
    return true;
}

}  // namespace server
