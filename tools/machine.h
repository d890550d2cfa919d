// tools/machine.h — on what a program runs, for people who compare times.
#pragma once

#include <string>

namespace tools {

/// The processor's name as Linux tells it.
std::string processor();

}  // namespace tools
