// server/session_host.h — whoever draws a service's sessions: this process, or a worker that may die.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "server/gnomon.pb.h"
#include "server/shared_maps.h"
#include "world/result.h"

namespace server {

/// A map as it was after a frame.
struct HostedMap {
    std::string depths;  ///< side * side floats, row by row, in stored order
    uint32_t side = 0;   ///< [texels]
    std::optional<gnomon::v1::Cascade> cascade;  ///< the state that belongs to it; none: a spot light's
    uint64_t frame = 0;
};

/// One session where it is drawn. `frame` comes from one thread at a time, questions from any, whenever. Each waits for its
/// turn. Errors are those of `Session`; kDevice, kIo: the session is of no use any more.
class HostedSession {
public:
    virtual ~HostedSession() = default;
    virtual world::Result<gnomon::v1::FrameReply> frame(const gnomon::v1::Frame& request) = 0;
    virtual world::Result<gnomon::v1::QueryShadowReply> query(const gnomon::v1::QueryShadowRequest& request) = 0;
    virtual world::Result<gnomon::v1::ShadowMask> mask(const gnomon::v1::GetShadowMaskRequest& request) = 0;
    virtual world::Result<HostedMap> depthMap(const gnomon::v1::GetDepthMapRequest& request) = 0;
    /// Where frames leave the working maps, if the session shares them; else null. Another after a frame that another
    /// worker drew. From the thread of `frame`.
    virtual std::shared_ptr<SharedMaps> shared() = 0;
};

/// Any thread.
class SessionHost {
public:
    virtual ~SessionHost() = default;
    virtual world::Result<std::vector<std::string>> worlds() = 0;
    virtual world::Result<gnomon::v1::WorldInfo> openWorld(const std::string& name) = 0;
    /// `opened` is filled in but for the session's secret.
    ///   number     of the session, given out once
    ///   recording  file that has each request of the session before it is asked here; empty: none
    virtual world::Result<std::unique_ptr<HostedSession>> open(const gnomon::v1::OpenSession& request, uint64_t number,
                                                               const std::string& recording,
                                                               gnomon::v1::SessionOpened& opened) = 0;
};

}  // namespace server
