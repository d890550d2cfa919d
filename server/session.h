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

#include "culling/truth.h"
#include "server/live_board.h"
#include "server/shadow_system.h"
#include "server/shared_maps.h"
#include "server/world_folder.h"
#include "world/result.h"

namespace gnomon::v1 {
class Cascade;
class Frame;
class FrameReply;
class GetDepthMapRequest;
class GetShadowMaskRequest;
class ObjectUpdate;
class OpenSession;
class QueryShadowReply;
class QueryShadowRequest;
class ShadowMask;
class SpotUpdate;
class WorldInfo;
}  // namespace gnomon::v1

namespace server {

/// What one session may hold and ask for. Beyond it: kLimit, naming the limit.
struct SessionLimits {
    size_t objects = 100'000;      ///< adopted or spawned at the same time
    size_t updates = 200'000;      ///< of objects, in one frame
    size_t edits = 256;            ///< of the ground, in one frame
    size_t spots = 256;            ///< updates of spot lights, in one frame
    size_t queryPoints = 1'000'000;  ///< of one question
    uint64_t mapBytes = 1ull << 30;       ///< of all maps, those of spot lights too
    uint64_t residentBytes = 1ull << 30;  ///< decoded chunks and meshes
    uint64_t geometryBytes = 256ull << 20;
};

/// The frames of one client, and nothing of how they come: the network, a recording and tests drive the same calls, so a
/// recording replays to the same counters and hashes. A frame is answered once the GPU has its drawing, and does not wait
/// for it unless the reply is to tell what only then is known. One thread at a time; two sessions on one device likewise.
class Session {
public:
    /// `device` and `store` must outlive it. kUsage and kLimit name the field of the request and what it may be.
    static world::Result<std::unique_ptr<Session>> open(gpu::Device& device, const world::WorldStore& store,
                                                        const gnomon::v1::OpenSession& request, const SessionLimits& limits);
    ~Session();

    /// Draws one frame. An update or edit that cannot be done is an error of the reply; the rest of the frame goes on.
    /// A frame that makes no sense, of a camera that is nowhere, is answered by its error and without cascades; what it
    /// asked of objects and the ground is done all the same, by the next frame at the latest. kLimit for more updates or
    /// edits than a frame may have: nothing happened. kDevice, which may be of the frame before, and kIo: the session is of
    /// no use any more.
    world::Result<gnomon::v1::FrameReply> frame(const gnomon::v1::Frame& request);

    /// Each further frame is published there.
    void show(LiveSession live) { live_.emplace(std::move(live)); }

    /// Questions about the last frame. kUsage where there was none and for fields that cannot be, kLimit for more points
    /// or pixels than are answered at once, kNotFound for spot lights, kDevice.
    world::Result<gnomon::v1::QueryShadowReply> query(const gnomon::v1::QueryShadowRequest& request);
    world::Result<gnomon::v1::ShadowMask> mask(const gnomon::v1::GetShadowMaskRequest& request);
    /// A map, to be cut into tiles.
    struct DepthMap {
        std::vector<float> depths;  ///< row by row, in stored order
        int side = 0;
        int cascade = -1;  ///< or -1: a spot light's
    };
    world::Result<DepthMap> depthMap(const gnomon::v1::GetDepthMapRequest& request);

    /// One cascade's committed state, as in a reply, without counts. CHECKs that a frame was drawn and the number exists.
    gnomon::v1::Cascade cascade(int number) const;

    /// Where frames leave the working maps; null where the session does not share them.
    const std::shared_ptr<SharedMaps>& shared() const { return shared_; }
    uint64_t frames() const { return frames_; }  ///< drawn so far
    size_t objects() const { return objects_.size(); }
    ShadowSystem& system() { return *system_; }
    const FrameReport& report() const { return report_; }  ///< of the last frame

private:
    explicit Session(std::unique_ptr<ShadowSystem> system, const SessionLimits& limits);
    world::Result<world::Done> update(const gnomon::v1::ObjectUpdate& update);
    world::Result<world::Done> update(const gnomon::v1::SpotUpdate& update);
    world::Result<SpotId> spotOf(uint64_t number) const;
    /// What the request wants and reports do not tell.
    world::Result<world::Done> tellWanted(const gnomon::v1::Frame& request, gnomon::v1::FrameReply& reply);
    world::Result<world::Done> startSharing();
    world::Result<world::Done> shareMaps();
    world::Result<world::Done> requireFrame() const;
    /// The casters of the last frame, for rays.
    world::Result<culling::Truth*> rays();

    struct Spot {
        uint64_t number = 0;  ///< the client's
        SpotId id = 0;
        uint64_t bytes = 0;
    };

    std::shared_ptr<SharedMaps> shared_;  ///< outlives the system, which writes there
    std::unique_ptr<ShadowSystem> system_;
    SessionLimits limits_;
    struct Object {
        ObjectId id = 0;
        bool moved = false;  ///< from where it was adopted or spawned
    };
    world::Result<world::Done> move(uint64_t number, Object& object, const world::Placement& placement);

    std::unordered_map<uint64_t, Object> objects_;  ///< by the client's number
    std::vector<Spot> spots_;  ///< ascending by id
    uint64_t mapBytes_ = 0;    ///< of all maps
    std::vector<ObjectUpdate> moves_;                 ///< of the frame that is being made
    FrameReport report_;
    std::vector<Camera> cameras_;  ///< of the last frame
    std::unique_ptr<culling::Truth> rays_;  ///< of its casters; null until it is asked for
    std::vector<CascadeView> sharedViews_;  ///< of what lies there, by cascade
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
