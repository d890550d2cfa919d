// tools/mover_feed.h — recorded motion turned into the object updates of each frame.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "server/shadow_system.h"
#include "world/movers.h"

namespace tools {

/// Feeds tracks into a system, as a session takes a client's poses. An object is only sent when its recorded pose changed,
/// and not before it first leaves the place that the world has it in: what rests in the recording rests in the system too.
/// One thread at a time.
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
        std::optional<world::MoverSample> sent;  ///< the pose that the system has, once it is not `rest`
    };
    std::vector<Object> objects_;
    std::vector<server::ObjectUpdate> updates_;
};

}  // namespace tools
