// server/shadow_mask.h — rays against what a system has in memory, and a picture of the light that its maps give.
// Source: our own.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "culling/truth.h"
#include "server/shadow_system.h"
#include "world/result.h"

namespace server {

/// All casters of a table for rays, each in the finest level that is in memory. A copy: it stays as it was made. kDevice.
world::Result<std::unique_ptr<culling::Truth>> traceable(const world::CasterTable& casters);

/// Light on a picture's pixels, from 0 to 1: what the camera's maps say, with the filter and the bias of method `gnomon`,
/// of those that face the sun; 0 of those turned away, 1 of the sky.
///   seen   what the camera sees, under the shown sun
///   known  replaced: false for pixels that face the sun and that no map knows
/// kDevice where maps cannot be read.
world::Result<std::vector<float>> lightByMaps(ShadowSystem& system, int camera, const culling::TruthFrame& seen,
                                              std::vector<bool>& known);

}  // namespace server
