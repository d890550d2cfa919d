// tools/report_command.h — `gnomon report`: what runs in results files cost, as a page, a comparison, a gate or an export.
#pragma once

#include "tools/command.h"

namespace tools {

/// Adds the subcommand. Its status is 1 if a rule of --gate is broken.
Command addReportCommand(CLI::App& app);

}  // namespace tools
