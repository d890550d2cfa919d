// world/level_set.cpp — see level_set.h.
#include "world/level_set.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>
#include <tuple>

namespace world {
namespace {

constexpr uint32_t kMagic = 0x31534c47;  // "GLS1" as bytes
constexpr int32_t kMaxHeight = 1 << 24;  // [voxels] either way

/// Layout: this head, then per leaf the origin, then all low bytes, then all high bytes.
struct Head {
    uint32_t magic, leaves;
    double voxel;
    int32_t side, reserved;
};
static_assert(sizeof(Head) == 24);
constexpr size_t kOriginBytes = sizeof(glm::ivec3);
static_assert(kOriginBytes == 12);
constexpr size_t kLeafBytes = kOriginBytes + 2 * kLeafSamples;

auto order(const glm::ivec3& v) { return std::tuple(v.x, v.y, v.z); }

/// What the neighbours before sample (x, y, z) let expect: exact for any trilinear field, in
/// arithmetic modulo 2^16, where every step can be taken back.
uint16_t predicted(const std::array<int16_t, kLeafSamples>& v, int x, int y, int z) {
    const auto at = [&](int dx, int dy, int dz) {
        if (x < dx || y < dy || z < dz) return 0u;
        return static_cast<unsigned>(v[static_cast<size_t>(((x - dx) * 8 + y - dy) * 8 + z - dz)]);
    };
    return static_cast<uint16_t>(at(1, 0, 0) + at(0, 1, 0) + at(0, 0, 1) - at(1, 1, 0) - at(1, 0, 1) -
                                 at(0, 1, 1) + at(1, 1, 1));
}

/// Small errors of either sign become small numbers, so that the high bytes are mostly zero.
uint16_t zigzag(uint16_t v) { return static_cast<uint16_t>((v << 1) ^ (v & 0x8000 ? 0xffff : 0)); }
uint16_t unzigzag(uint16_t v) { return static_cast<uint16_t>((v >> 1) ^ (v & 1 ? 0xffff : 0)); }

Error bad(const std::string& what) {
    return {ErrorCode::kBadData, "terrain level set: " + what + "; bake the world again"};
}

}  // namespace

std::vector<std::byte> encodeLevelSet(const LevelSet& set) {
    const size_t count = set.leaves.size();
    std::vector<std::byte> bytes(sizeof(Head) + count * kLeafBytes);
    const Head head{kMagic, static_cast<uint32_t>(count), set.voxel, set.side, 0};
    std::memcpy(bytes.data(), &head, sizeof head);
    std::byte* origin = bytes.data() + sizeof(Head);
    std::byte* low = origin + count * kOriginBytes;
    std::byte* high = low + count * kLeafSamples;
    for (const LevelSetLeaf& leaf : set.leaves) {
        std::memcpy(origin, &leaf.origin, kOriginBytes);
        origin += kOriginBytes;
        for (int i = 0; i < kLeafSamples; ++i) {
            const auto value = static_cast<uint16_t>(leaf.values[static_cast<size_t>(i)]);
            const uint16_t rest =
                zigzag(static_cast<uint16_t>(value - predicted(leaf.values, i >> 6, (i >> 3) & 7, i & 7)));
            *low++ = static_cast<std::byte>(rest & 0xff);
            *high++ = static_cast<std::byte>(rest >> 8);
        }
    }
    return bytes;
}

Result<LevelSet> decodeLevelSet(std::span<const std::byte> bytes) {
    Head head;
    if (bytes.size() < sizeof head) return bad("shorter than its head");
    std::memcpy(&head, bytes.data(), sizeof head);
    if (head.magic != kMagic || head.reserved != 0) return bad("not a level set of this version");
    if (!std::isfinite(head.voxel) || head.voxel <= 0) return bad("voxel edge is not a positive number");
    if (head.side < 1 || head.side > kMaxBandSide) return bad("chunk edge out of range");
    if ((bytes.size() - sizeof head) % kLeafBytes != 0 ||
        (bytes.size() - sizeof head) / kLeafBytes != head.leaves) {
        return bad("its size does not match its " + std::to_string(head.leaves) + " leaves");
    }

    LevelSet set{.voxel = head.voxel, .side = head.side, .leaves = {}};
    set.leaves.resize(head.leaves);
    const std::byte* origin = bytes.data() + sizeof head;
    const std::byte* low = origin + size_t{head.leaves} * kOriginBytes;
    const std::byte* high = low + size_t{head.leaves} * kLeafSamples;
    const int32_t samples = bandSamples(head.side);
    int32_t lowest = kMaxHeight, highest = -kMaxHeight;
    for (uint32_t n = 0; n < head.leaves; ++n) {
        LevelSetLeaf& leaf = set.leaves[n];
        std::memcpy(&leaf.origin, origin, kOriginBytes);
        origin += kOriginBytes;
        const glm::ivec3 o = leaf.origin;
        const auto inside = [&](int32_t v) {
            return v >= -kBandMargin && v <= samples - kBandMargin - kLeafSide &&
                   (v + kBandMargin) % kLeafSide == 0;
        };
        if (!inside(o.x) || !inside(o.z) || o.y <= -kMaxHeight || o.y >= kMaxHeight || o.y % kLeafSide != 0) {
            return bad("leaf " + std::to_string(n) + " lies outside its chunk or off the lattice");
        }
        if (n > 0 && order(set.leaves[n - 1].origin) >= order(o)) {
            return bad("leaf " + std::to_string(n) + " is out of order");
        }
        lowest = std::min(lowest, o.y);
        highest = std::max(highest, o.y + kLeafSide);
        for (int i = 0; i < kLeafSamples; ++i) {
            const auto rest = static_cast<uint16_t>(std::to_integer<unsigned>(*low++) |
                                                    std::to_integer<unsigned>(*high++) << 8);
            leaf.values[static_cast<size_t>(i)] =
                static_cast<int16_t>(unzigzag(rest) + predicted(leaf.values, i >> 6, (i >> 3) & 7, i & 7));
        }
    }
    if (highest > lowest && int64_t{samples} * samples * (highest - lowest) > kMaxBandSamples) {
        return bad("its leaves lie too far apart");
    }
    return set;
}

}  // namespace world
