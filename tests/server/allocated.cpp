#include "tests/server/allocated.h"

#include <malloc.h>

#include <atomic>
#include <cstdlib>
#include <new>

namespace {

std::atomic<int64_t> heldBytes = 0;

void release(void* memory) {
    heldBytes -= static_cast<int64_t>(malloc_usable_size(memory));
    std::free(memory);
}

}  // namespace

int64_t tests::allocatedBytes() { return heldBytes; }

/// The library's own would do, but for a sanitizer that has one too.
void* operator new(std::size_t bytes, const std::nothrow_t&) noexcept {
    void* const memory = std::malloc(bytes);
    if (memory != nullptr) heldBytes += static_cast<int64_t>(malloc_usable_size(memory));
    return memory;
}
void* operator new(std::size_t bytes) {
    if (void* const memory = operator new(bytes, std::nothrow)) return memory;
    throw std::bad_alloc();
}
void operator delete(void* memory) noexcept { release(memory); }
void operator delete(void* memory, std::size_t) noexcept { release(memory); }
