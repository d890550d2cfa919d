// server/live_settings.h — a configuration as lines to read.
#pragma once

#include <vector>

#include "server/live_board.h"

namespace server {

/// What was asked for, with units.
std::vector<LiveSetting> liveSettings(const ShadowConfig& config);

}  // namespace server
