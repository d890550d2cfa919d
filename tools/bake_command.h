// tools/bake_command.h — `gnomon bake`: a glTF scene, an elevation model or the built-in world to a world
// file.
#pragma once

#include "tools/command.h"

namespace tools {

/// Adds the subcommand. The options live as long as the command's copies.
Command addBakeCommand(CLI::App& app);

}  // namespace tools
