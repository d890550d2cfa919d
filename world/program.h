// world/program.h — tells results of one build of the program from those of another.
#pragma once

#include <cstdint>

namespace world {

/// Hash of the file that this process runs, starting from `seed`; see world/hash.h.
uint64_t hashProgram(uint64_t seed = 0);

}  // namespace world
