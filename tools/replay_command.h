// tools/replay_command.h — `gnomon replay`: plays a recorded path through a world and reports what it cost.
#pragma once

#include "tools/command.h"

namespace tools {

/// Adds the subcommand. Its status is 1 if a verified map differs from its redraw.
Command addReplayCommand(CLI::App& app);

}  // namespace tools
