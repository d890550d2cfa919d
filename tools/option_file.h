// tools/option_file.h — a command's options from a file: each is a key of the same name, in TOML.
#pragma once

#include <string>

#include "world/result.h"

namespace CLI {
class App;
}

namespace tools {

/// Gives `parser` what a file has for options that the command line left out. Keys are long names without dashes; a list
/// is given as an array. kNotFound; kUsage names file and line: no TOML, a key that is no option (and the nearest that
/// is), a value that its option does not take.
world::Result<world::Done> readOptionFile(CLI::App& parser, const std::string& path);

}  // namespace tools
