// tools/lab_command.h — `gnomon lab NAME.world`: shadow methods judged by ray tracing along a path.
#pragma once

#include <CLI/CLI.hpp>

#include "tools/command.h"

namespace tools {

Command addLabCommand(CLI::App& app);

}  // namespace tools
