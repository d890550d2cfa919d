#include "tools/mover_feed.h"

#include <utility>

namespace tools {
namespace {

bool samePose(const world::MoverSample& a, const world::MoverSample& b) {
    return a.position == b.position && a.orientation == b.orientation && a.scale == b.scale;
}

}  // namespace

world::Result<MoverFeed> MoverFeed::create(server::ShadowSystem& system,
                                           std::vector<world::MoverTrack> tracks) {
    MoverFeed feed;
    for (world::MoverTrack& track : tracks) {
        const auto id = system.adopt(track.name);
        if (!id) return id.error();
        feed.objects_.push_back({std::move(track), id.value(), system.restPlacement(id.value()), {}});
    }
    return feed;
}

std::span<const server::ObjectUpdate> MoverFeed::at(double time) {
    updates_.clear();
    for (Object& object : objects_) {
        const world::MoverSample& sample = world::sampleAt(object.track, time);
        if (object.sent && samePose(sample, *object.sent)) continue;
        const world::Placement placement = world::moved(object.rest, sample);
        if (!object.sent && world::standsAt(placement, object.rest)) continue;
        object.sent = sample;
        updates_.push_back({object.id, placement});
    }
    return updates_;
}

}  // namespace tools
