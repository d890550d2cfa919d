// tools/stress_command.h — `gnomon stress NAME.world`: the streamer put through named cases, with verdicts.
#pragma once

#include <CLI/CLI.hpp>

#include "tools/command.h"

namespace tools {

Command addStressCommand(CLI::App& app);

}  // namespace tools
