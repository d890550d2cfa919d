// tools/tune_command.h — `gnomon tune NAME.world`: the cheapest settings that keep stated limits on a path.
#pragma once

#include <CLI/CLI.hpp>

#include "tools/command.h"

namespace tools {

Command addTuneCommand(CLI::App& app);

}  // namespace tools
