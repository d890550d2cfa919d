#include "tests/server/allocated.h"

#include <malloc.h>

#include <atomic>
#include <cstdlib>
#include <new>

namespace {

std::atomic<int64_t> held = 0;

void release(void* memory) {
    held -= static_cast<int64_t>(malloc_usable_size(memory));
    std::free(memory);
}

}  // namespace

int64_t tests::allocatedBytes() { return held; }

void* operator new(std::size_t bytes) {
    void* const memory = std::malloc(bytes);
    if (memory == nullptr) throw std::bad_alloc();
    held += static_cast<int64_t>(malloc_usable_size(memory));
    return memory;
}
void operator delete(void* memory) noexcept { release(memory); }
void operator delete(void* memory, std::size_t) noexcept { release(memory); }
