// server/outlook.h — which parts of the world the maps of eyes need, and will need soon.
// Source: our own.
#pragma once

#include <glm/glm.hpp>
#include <optional>
#include <span>
#include <vector>

#include "culling/cascades.h"
#include "culling/light_space.h"
#include "world/streamer.h"

namespace server {

/// Where an eye will be.
struct AheadEye {
    double seconds = 0;      ///< from now, ascending, > 0
    glm::dvec3 position{0};  ///< [m]
};

struct Eye {
    glm::dvec3 position{0};             ///< [m]
    std::span<const AheadEye> ahead{};  ///< where it will be, if that is known
};

/// What of the world casts onto maps: everything in the columns of light over the windows, toward the sun without end,
/// away from it as far as receivers can be. Windows are squares around the eye, so turning it asks for nothing. Where
/// reads take time, what the eye's way leads to is wanted ahead: the way that was told, or a straight one at its
/// speed.
class Outlook {
public:
    struct Maps {
        const std::vector<culling::Cascade>& cascades;
        int side = 0, guardBand = 0;  ///< [texels]
        double levelError = 0;        ///< [texels]
    };
    /// `waits`: what is wanted is there in the same frame, so wide margins are looked at seldom. `prefetch`: else only
    /// what windows need now is wanted.
    Outlook(bool waits, bool prefetch) : waits_(waits), prefetch_(prefetch) {}

    /// Notes where the eyes are, always in the same order; true if what is wanted must be looked at anew.
    ///   reach  distance that the last cascade serves [m]
    bool observe(double time, std::span<const Eye> eyes, double reach);
    /// The next `observe` is true: suns or maps have changed.
    void forget() { looked_ = false; }
    /// As of the last `observe`. `maps` and `suns` must outlive the answer.
    world::Wants wants(std::span<const culling::LightSpace* const> suns, const Maps& maps, double reach,
                       std::span<const Eye> eyes) const;

private:
    struct Seen {
        glm::dvec3 eye{0}, velocity{0};            ///< [m], [m/s]
        glm::dvec3 lookedAt{0}, lookedWith{0};     ///< both when wants were last looked at
    };
    double margin(double reach) const;
    bool waits_, prefetch_;
    double time_ = 0;
    std::vector<Seen> seen_;  ///< per eye
    bool looked_ = false;     ///< wants were asked for, and hold but for how the eyes have moved
};

}  // namespace server
