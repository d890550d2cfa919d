#include "world/chunk.h"

namespace world {

std::string toString(ChunkKey key) {
    std::string text = "(";
    text += std::to_string(key.x);
    text += ',';
    text += std::to_string(key.y);
    text += ',';
    text += std::to_string(key.z);
    text += ')';
    return text;
}

}  // namespace world
