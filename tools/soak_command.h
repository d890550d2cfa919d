// tools/soak_command.h — `gnomon soak NAME.world`: long seeded life on a small world, verified on the way.
#pragma once

#include <CLI/CLI.hpp>

#include "tools/command.h"

namespace tools {

Command addSoakCommand(CLI::App& app);

}  // namespace tools
