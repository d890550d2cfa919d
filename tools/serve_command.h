// tools/serve_command.h — `gnomon serve`: the service as a process.
#pragma once

#include "tools/command.h"

namespace tools {

Command addServeCommand(CLI::App& app);

}  // namespace tools
