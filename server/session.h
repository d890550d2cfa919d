// server/session.h — a world as one client lives in it: requests in, replies out, without a socket.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "server/live_board.h"
#include "server/shadow_system.h"
#include "server/world_folder.h"
#include "world/result.h"

namespace gnomon::v1 {
class Frame;
class FrameReply;
class OpenSession;
class WorldInfo;
class Cascade;
class ObjectUpdate;
}  // namespace gnomon::v1

namespace server {

/// What one session may hold and ask for. Beyond it: kLimit, naming the limit.
struct SessionLimits {
    size_t objects = 100'000;      ///< adopted or spawned at the same time
    size_t updates = 200'000;      ///< of objects, in one frame
    size_t edits = 256;            ///< of the ground, in one frame
    uint64_t mapBytes = 1ull << 30;       ///< of all cascades' maps
    uint64_t residentBytes = 1ull << 30;  ///< decoded chunks and meshes
    uint64_t geometryBytes = 256ull << 20;
};

/// The frames of one client, and nothing of how they come: the network, a recording and tests drive the same calls, so a
/// recording replays to the same counters and hashes. One thread at a time; two sessions on one device likewise.
class Session {
public:
    /// `device` and `store` must outlive it. kUsage and kLimit name the field of the request and what it may be.
    static world::Result<std::unique_ptr<Session>> open(gpu::Device& device, const world::WorldStore& store,
                                                        const gnomon::v1::OpenSession& request, const SessionLimits& limits);
    ~Session();

    /// Draws one frame. An update or edit that cannot be done is an error of the reply; the rest of the frame goes on.
    /// A frame that makes no sense, of a camera that is nowhere, is answered by its error and without cascades; what it
    /// asked of objects and the ground is done all the same, by the next frame at the latest. kLimit for more updates or
    /// edits than a frame may have: nothing happened. kDevice, kIo: the session is of no use any more.
    world::Result<gnomon::v1::FrameReply> frame(const gnomon::v1::Frame& request);

    /// Each further frame is published there.
    void show(LiveSession live) { live_.emplace(std::move(live)); }

    /// One cascade's committed state, as in a reply, without counts. CHECKs that a frame was drawn and the number exists.
    gnomon::v1::Cascade cascade(int number) const;

    uint64_t frames() const { return frames_; }  ///< drawn so far
    size_t objects() const { return objects_.size(); }
    ShadowSystem& system() { return *system_; }
    const FrameReport& report() const { return report_; }  ///< of the last frame

private:
    explicit Session(std::unique_ptr<ShadowSystem> system, const SessionLimits& limits);
    world::Result<world::Done> update(const gnomon::v1::ObjectUpdate& update);

    std::unique_ptr<ShadowSystem> system_;
    SessionLimits limits_;
    std::unordered_map<uint64_t, ObjectId> objects_;  ///< by the client's number
    std::vector<ObjectUpdate> moves_;                 ///< of the frame that is being made
    FrameReport report_;
    std::optional<LiveSession> live_;
    uint64_t frames_ = 0;
};

/// What a client is told of a world.
gnomon::v1::WorldInfo describe(const OpenedWorld& opened);

/// Gives what the request leaves to the server, as `defaults` has it: settings of the maps, format, occlusion and its rays.
void fillDefaults(gnomon::v1::OpenSession& request, const ShadowConfig& defaults);

/// Adds a frame that came after `into` to it: poses, sun and time are the later ones, updates and edits of both stay, in
/// order.
void mergeFrames(gnomon::v1::Frame& into, gnomon::v1::Frame&& later);

}  // namespace server
