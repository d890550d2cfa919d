// tools/info_command.h — `gnomon info`: what a world file holds, and whether it is sound.
#pragma once

#include "tools/command.h"

namespace tools {

/// Adds the subcommand. With --check, findings are printed and become an error of kBadData.
Command addInfoCommand(CLI::App& app);

}  // namespace tools
