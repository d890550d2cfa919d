// tools/edit_command.h — `gnomon edit`: digs and fills the ground of a world file.
#pragma once

#include "tools/command.h"

namespace tools {

Command addEditCommand(CLI::App& app);

}  // namespace tools
