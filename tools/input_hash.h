// tools/input_hash.h — hashes of what a run is given, in parts that are chained: equal input, equal hash.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "world/movers.h"
#include "world/path.h"

namespace tools {

uint64_t hashText(const std::string& text, uint64_t seed);
uint64_t hashPoses(std::span<const world::Pose> poses, uint64_t seed);
uint64_t hashMovers(const std::vector<world::MoverTrack>& tracks, uint64_t seed);

/// 16 hexadecimal digits.
std::string hexOf(uint64_t hash);

}  // namespace tools
