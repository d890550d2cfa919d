// tools/mover_feed.h — recorded motion turned into the object updates of each frame.
#pragma once

#include <span>
#include <vector>

#include "server/shadow_system.h"
#include "world/movers.h"

namespace tools {

/// Placement of an object whose world placement is `rest` at a recorded pose. A recording has one
/// scale, the cube root of the object's three factors, so the rest placement's own factors keep
/// their ratios; a mirrored rest placement stays mirrored, along its own x. Total: no failure.
world::Placement moved(const world::Placement& rest, const world::MoverSample& pose);

/// Feeds tracks into a system. An object is only sent when its recorded pose changed, so that one
/// that rests in the recording rests in the system too. One thread at a time.
class MoverFeed {
public:
    /// Adopts every track's object; every track has a sample.
    /// kNotFound names the first track whose object the world does not have.
    static world::Result<MoverFeed> create(server::ShadowSystem& system,
                                           std::vector<world::MoverTrack> tracks);

    /// What moved since the last call, by track in order; valid until the next call.
    std::span<const server::ObjectUpdate> at(double time);

private:
    struct Object {
        world::MoverTrack track;
        server::ObjectId id = 0;
        world::Placement rest;
        world::MoverSample sent;  ///< the pose that the system has
        bool known = false;       ///< `sent` is valid: something was sent, or the rest placement is it
    };
    std::vector<Object> objects_;
    std::vector<server::ObjectUpdate> updates_;
};

}  // namespace tools
