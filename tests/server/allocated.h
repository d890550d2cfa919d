// tests/server/allocated.h — how much memory the test program holds.
#pragma once

#include <cstdint>

namespace tests {

/// Bytes from operator new that were not deleted yet, by all threads.
int64_t allocatedBytes();

}  // namespace tests
