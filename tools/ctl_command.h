// tools/ctl_command.h — `gnomon ctl`: looks after a server that runs.
#pragma once

#include "tools/command.h"

namespace tools {

Command addCtlCommand(CLI::App& app);

}  // namespace tools
