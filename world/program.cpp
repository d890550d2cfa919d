#include "world/program.h"

#include <fstream>
#include <span>
#include <vector>

#include "world/hash.h"

namespace world {

uint64_t hashProgram(uint64_t seed) {
    std::ifstream program("/proc/self/exe", std::ios::binary);
    std::vector<char> part(size_t{1} << 20);
    uint64_t hash = seed;
    while (program.read(part.data(), static_cast<std::streamsize>(part.size())) || program.gcount() > 0)
        hash = hashValues(std::span<const char>(part.data(), static_cast<size_t>(program.gcount())), hash);
    return hash;
}

}  // namespace world
