#include "world/check.h"

#include <cstdio>
#include <cstdlib>

namespace world {

void checkFailed(const char* file, int line, const char* condition) {
    std::fprintf(stderr, "%s:%d: broken invariant: %s\n", file, line, condition);
    std::abort();
}

}  // namespace world
