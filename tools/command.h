// tools/command.h — a subcommand of `gnomon`: its options on the parser, and what to run after parsing.
#pragma once

#include <functional>

#include "world/result.h"

namespace CLI {
class App;
}

namespace tools {

struct Command {
    CLI::App* parser = nullptr;  ///< the subcommand, owned by the parser that it was added to
    /// Runs it with the parsed options; gives the exit status, 0 or 1, or an error for stderr.
    std::function<world::Result<int>()> run;
};

}  // namespace tools
