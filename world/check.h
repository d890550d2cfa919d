// world/check.h — invariants that stop the process: a failed CHECK is a bug of ours, never bad input.
#pragma once

namespace world {

/// Prints the place and the broken condition to stderr and aborts.
[[noreturn]] void checkFailed(const char* file, int line, const char* condition);

}  // namespace world

#define CHECK(condition) \
    ((condition) ? static_cast<void>(0) : ::world::checkFailed(__FILE__, __LINE__, #condition))

#ifdef NDEBUG
#define DCHECK(condition) static_cast<void>(0)
#else
#define DCHECK(condition) CHECK(condition)
#endif
