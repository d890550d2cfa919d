// tools/difference_text.h — a texel that differs from its redraw, for people.
#pragma once

#include <string>

#include "server/shadow_system.h"

namespace tools {

/// One line: cascade or spot light, map, texel, both depths and the casters there.
std::string toText(const server::Difference& difference);

}  // namespace tools
