// tests/cache/allocations.h — counts what the test program allocates.
#pragma once

#include <cstdint>

namespace tests {

/// Calls of operator new by this thread so far.
uint64_t allocations();

}  // namespace tests
