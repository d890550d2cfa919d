// tools/sweep_command.h — `gnomon sweep`: worlds x paths x settings, on this machine or on a cluster.
#pragma once

#include "tools/command.h"

namespace tools {

Command addSweepCommand(CLI::App& app);

}  // namespace tools
