// server/messages.h — what requests say as the system takes it, and what it reports as replies say it.
#pragma once

#include <glm/gtc/quaternion.hpp>
#include <string>

#include "server/gnomon.pb.h"
#include "server/session.h"
#include "server/shadow_system.h"
#include "world/movers.h"
#include "world/result.h"

namespace server {

// Errors are kUsage and kLimit, and name the field.

glm::dvec3 vectorOf(const gnomon::v1::Vector& v);
world::Result<world::Placement> placementOf(const gnomon::v1::Placement& p);
world::Result<world::MoverSample> poseOf(const gnomon::v1::Pose& p);
world::Result<world::TerrainEdit> editOf(const gnomon::v1::TerrainEdit& e);
culling::SpotLight spotOf(const gnomon::v1::SpotLight& s);
Budget budgetOf(const gnomon::v1::Budget& b);
Camera cameraOf(const gnomon::v1::Camera& c);
world::Result<ShadowConfig> configOf(const gnomon::v1::OpenSession& r, const SessionLimits& limits);
LookupBias biasOf(const gnomon::v1::QueryShadowRequest& r);

/// A cache map and a working map each [bytes].
uint64_t mapBytes(const ShadowConfig& config);
uint64_t spotBytes(const culling::SpotLight& light);

/// "objects: 11, and a session may have 10".
world::Error limitError(const std::string& what, uint64_t asked, uint64_t most);

gnomon::v1::Code codeOf(world::ErrorCode code);
world::ErrorCode codeOf(gnomon::v1::Code code);

void put(gnomon::v1::Vector* to, glm::dvec3 v);
void put(gnomon::v1::Cost* to, const cache::Cost& cost);
void put(gnomon::v1::Cascade* to, const CascadeView& view);
void put(gnomon::v1::Cascade* to, const cache::CascadeStatistics& s);
void put(gnomon::v1::FrameReply& reply, gnomon::v1::ItemError::Kind kind, uint32_t index, const world::Error& error);
/// All but cascades and spot lights.
void put(gnomon::v1::FrameReply& reply, const FrameReport& r);

}  // namespace server
