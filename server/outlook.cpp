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

/// A leg of an eye's way, in one sun's light space.
struct Leg {
    world::Box box;
    double due = 0;  ///< [s]
};

/// An eye's way as one sun sees it.
struct Way {
    const culling::LightSpace* space = nullptr;
    double speed = 0;  ///< at which the eye may come to its margin [m/s]
    std::vector<Leg> legs;
};

}  // namespace

double Outlook::margin(double reach) const { return kSlack * reach * (waits_ ? 1 : kOften); }

bool Outlook::observe(double time, std::span<const Eye> eyes, double reach) {
    if (seen_.size() != eyes.size()) {
        looked_ = false;
        const size_t known = std::min(seen_.size(), eyes.size());
        seen_.resize(eyes.size());
        for (size_t k = known; k < eyes.size(); ++k) seen_[k].eye = eyes[k].position;
    }
    bool leaves = !looked_;
    const double dt = time - time_;
    for (size_t k = 0; k < eyes.size(); ++k) {
        Seen& s = seen_[k];
        if (dt > 0) {
            const glm::dvec3 now = (eyes[k].position - s.eye) / dt;
            if (glm::length(now) > kFastest) s.velocity = {};
            else s.velocity += (now - s.velocity) * std::min(1.0, dt / kSteady);
        }
        s.eye = eyes[k].position;
        const double turned = glm::length(s.velocity - s.lookedWith);
        leaves |= !waits_ && prefetch_ && turned > kTurn && turned > 0.25 * glm::length(s.lookedWith);
        leaves |= glm::length(s.eye - s.lookedAt) > margin(reach) / 2;
    }
    time_ = time;
    if (!leaves) return false;
    looked_ = true;
    for (Seen& s : seen_) {
        s.lookedAt = s.eye;
        s.lookedWith = s.velocity;
    }
    return true;
}

world::Wants Outlook::wants(std::span<const culling::LightSpace* const> suns, const Maps& maps, double reach,
                            std::span<const Eye> eyes) const {
    std::vector<Way> ways;
    for (size_t k = 0; k < eyes.size(); ++k) {
        const Seen& s = seen_[k];
        std::vector<AheadEye> stops{{0, s.eye}};
        if (!waits_ && prefetch_) {
            stops.insert(stops.end(), eyes[k].ahead.begin(), eyes[k].ahead.end());
            if (eyes[k].ahead.empty() && glm::length(s.velocity) > kStroll)
                for (const double seconds : kLegs) stops.push_back({seconds, s.eye + s.velocity * seconds});
        }
        for (const culling::LightSpace* space : suns) {
            Way way{space, std::max(kStroll, glm::length(s.velocity)), {}};
            for (size_t i = 0; i < stops.size(); ++i) {
                Leg leg{.box = {}, .due = stops[i].seconds};
                leg.box.add(space->toLight(stops[i].position));
                if (i > 0) leg.box.add(space->toLight(stops[i - 1].position));
                if (i > 0) leg.due = stops[i - 1].seconds;
                way.legs.push_back(leg);
            }
            ways.push_back(std::move(way));
        }
    }
    std::vector<double> windows, errors;
    for (const culling::Cascade& c : maps.cascades) {
        windows.push_back(c.texel * (maps.side / 2.0 + maps.guardBand));
        errors.push_back(c.texel * maps.levelError);
    }
    const double near = margin(reach), ring = prefetch_ && !waits_ ? kSlack * reach : near, room = 2 * kSlack * reach;
    return [ways = std::move(ways), windows = std::move(windows), errors = std::move(errors), near, ring,
            room](const world::Box& bounds) -> std::optional<world::Want> {
        std::optional<world::Want> want;
        for (const Way& way : ways) {
            const world::Box b = way.space->toLight(bounds);
            for (const Leg& leg : way.legs) {
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
                else if (&leg == way.legs.data() && beyond <= ring) w.due = (beyond - near) / way.speed;
                else if (&leg != way.legs.data()) continue;  // what may stay is near now
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
