// Keeps Vulkan drivers and layers loaded until the process ends. The leak sanitizer names the module of
// an allocation when the process ends: once a layer is unloaded its own leaks have no name left for
// tests/lsan.supp to match, and stand as if they were ours.
#include <dlfcn.h>

/// Stands in for the C library's function in the whole process.
extern "C" int dlclose(void*) noexcept { return 0; }
