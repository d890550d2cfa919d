#include "server/outlook.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace server {
namespace {

/// Chunks are wanted this share of the far distance beyond what the windows need, and kept twice as far.
constexpr double kSlack = 0.25;
/// Where reads take time, wants are looked at again after an eighth of that way.
constexpr double kOften = 0.125;

/// The eye's way is followed so far ahead [s], in legs that grow.
constexpr double kLegs[] = {0.5, 1, 2, 4};
/// Faster eyes jump, and tell nothing of where they will be [m/s].
constexpr double kFastest = 2000;
/// The speed follows the eye's within about this time [s].
constexpr double kSteady = 0.25;
/// What lies in the margin is due as if the eye came to it at least this fast [m/s].
constexpr double kStroll = 5;
/// A change of velocity by this much [m/s], and by a quarter, is a new way.
constexpr double kTurn = 5;

/// A leg of the eye's way, in one sun's light space.
struct Leg {
    world::Box box;
    double due = 0;  ///< [s]
};

}  // namespace

double Outlook::margin(double reach) const { return kSlack * reach * (waits_ ? 1 : kOften); }

bool Outlook::observe(double time, glm::dvec3 eye, double reach) {
    if (const double dt = time - time_; seen_ && dt > 0) {
        const glm::dvec3 now = (eye - eye_) / dt;
        if (glm::length(now) > kFastest) velocity_ = {};
        else velocity_ += (now - velocity_) * std::min(1.0, dt / kSteady);
    }
    seen_ = true;
    time_ = time;
    eye_ = eye;
    const double turned = glm::length(velocity_ - lookedWith_);
    const bool turns = !waits_ && prefetch_ && turned > kTurn && turned > 0.25 * glm::length(lookedWith_);
    if (lookedAt_ && !turns && glm::length(eye - *lookedAt_) <= margin(reach) / 2) return false;
    lookedAt_ = eye;
    lookedWith_ = velocity_;
    return true;
}

world::Wants Outlook::wants(std::span<const culling::LightSpace* const> suns, const Maps& maps, double reach,
                            std::span<const AheadEye> ahead) const {
    std::vector<AheadEye> way{{0, eye_}};
    if (!waits_ && prefetch_) {
        way.insert(way.end(), ahead.begin(), ahead.end());
        if (ahead.empty() && glm::length(velocity_) > kStroll)
            for (const double seconds : kLegs) way.push_back({seconds, eye_ + velocity_ * seconds});
    }
    struct Sun {
        const culling::LightSpace* space;
        std::vector<Leg> legs;
    };
    std::vector<Sun> lit;
    for (const culling::LightSpace* space : suns) {
        lit.push_back({space, {}});
        for (size_t i = 0; i < way.size(); ++i) {
            Leg leg{.box = {}, .due = way[i].seconds};
            leg.box.add(space->toLight(way[i].position));
            if (i > 0) leg.box.add(space->toLight(way[i - 1].position));
            if (i > 0) leg.due = way[i - 1].seconds;
            lit.back().legs.push_back(leg);
        }
    }
    std::vector<double> windows, errors;
    for (const culling::Cascade& c : maps.cascades) {
        windows.push_back(c.texel * (maps.side / 2.0 + maps.guardBand));
        errors.push_back(c.texel * maps.levelError);
    }
    const double near = margin(reach), ring = prefetch_ && !waits_ ? kSlack * reach : near, room = 2 * kSlack * reach;
    const double speed = std::max(kStroll, glm::length(velocity_));
    return [lit = std::move(lit), windows = std::move(windows), errors = std::move(errors), near, ring, room,
            speed](const world::Box& bounds) -> std::optional<world::Want> {
        std::optional<world::Want> want;
        for (const Sun& sun : lit) {
            const world::Box b = sun.space->toLight(bounds);
            for (const Leg& leg : sun.legs) {
                const glm::dvec2 gap = glm::max(glm::max(glm::dvec2(b.min) - glm::dvec2(leg.box.max),
                                                         glm::dvec2(leg.box.min) - glm::dvec2(b.max)),
                                                glm::dvec2(0));
                // A map answers for all depths: which levels it draws does not depend on them.
                const double away = std::max(gap.x, gap.y);
                const double beyond = std::max(away, b.min.z - leg.box.max.z) - windows.back();
                if (beyond > room) continue;
                world::Want w{.due = std::numeric_limits<double>::infinity(), .distance = glm::length(gap),
                              .error = static_cast<float>(errors.back())};
                if (beyond <= near) w.due = leg.due;
                else if (&leg == sun.legs.data() && beyond <= ring) w.due = (beyond - near) / speed;
                else if (&leg != sun.legs.data()) continue;  // what may stay is near now
                for (size_t c = windows.size(); c-- > 0 && away <= windows[c] + near;)
                    w.error = static_cast<float>(errors[c]);
                if (!want) want = w;
                want->due = std::min(want->due, w.due);
                want->distance = std::min(want->distance, w.distance);
                want->error = std::min(want->error, w.error);
            }
        }
        return want;
    };
}

}  // namespace server
