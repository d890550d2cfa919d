// world/procedural.cpp — see procedural.h.
#include "world/procedural.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <span>

#include "world/hash.h"
#include "world/noise.h"
#include "world/procedural_field.h"
#include "world/procedural_meshes.h"
#include "world/procedural_path.h"
#include "world/procedural_scatter.h"
#include "world/terrain.h"

namespace world {
namespace {

constexpr uint32_t kVillageSeed = 104;

/// Places what the road has: movers, and villages with their walls, poles and fences.
class Settler {
public:
    ///   edge  of a chunk [m]
    Settler(const Landscape& land, uint32_t seed, double edge) : land_(land), seed_(seed), edge_(edge) {
        moveIn();
        build();
    }
    size_t count() const { return count_; }
    const std::vector<glm::dvec2>& buildings() const { return buildings_; }  ///< (x, z) [m]

    /// What stands in a chunk, in the order of placing.
    SourceChunk inside(ChunkKey key) const {
        const auto found = chunks_.find(key);
        return found == chunks_.end() ? SourceChunk{} : found->second;
    }

private:
    void place(const Instance& instance, const std::string& name) {
        const glm::dvec3 t = instance.placement.translation;
        SourceChunk& chunk = chunks_[{static_cast<int32_t>(std::floor(t.x / edge_)), 0,
                                      static_cast<int32_t>(std::floor(t.z / edge_))}];
        chunk.instances.push_back(instance);
        chunk.names.push_back(name);
        ++count_;
    }

    void moveIn() {
        const std::vector<MoverTrack> tracks = moversOn(land_);
        for (size_t m = 0; m < tracks.size(); ++m) {
            const MoverSample& s = tracks[m].samples.front();
            place({proceduralMoverMesh(m), {glm::mat3(glm::mat3_cast(s.orientation) * s.scale), s.position}},
                  tracks[m].name);
        }
    }

    /// A mesh beside the road whose -z side looks at it, or along it for `along`.
    void beside(uint32_t mesh, double distance, double right, bool along) {
        const RoadPoint road = land_.road(distance);
        const glm::dvec2 p = road.position + road.right() * right;
        // -z towards the road's middle: what is along x is then along the road.
        const glm::dvec2 look = along ? road.right() : road.right() * (right > 0 ? -1.0 : 1.0);
        place({mesh, {turned(std::atan2(-look.x, -look.y), 0, 1), {p.x, land_.groundHeight(p.x, p.y), p.y}}},
              "");
        if (mesh == kHouse || mesh == kCottage || mesh == kShed) buildings_.push_back(p);
    }

    /// Villages: two rows of houses with walls towards the road; poles all along it, fences here and there.
    void build() {
        int n = 0;
        for (const double middle : land_.villages()) {
            for (double s = -84; s <= 84; s += 24) {
                for (const double side : {-1.0, 1.0}) {
                    const double pick = hashUnit(n++, 0, 0, seed_ + kVillageSeed);
                    if (pick < 0.1) continue;  // an empty plot
                    beside(pick < 0.55 ? kHouse : kCottage, middle + s, side * (19 + 3 * pick), false);
                    if (pick > 0.4) beside(kShed, middle + s + 9, side * 33, false);
                    for (const double w : {-8.0, -4.0, 4.0, 8.0})
                        beside(kWall, middle + s + w, side * 11, true);
                }
            }
        }
        for (double s = 0; s < land_.roadLength() - 20; s += 40) beside(kPole, s, 8.5, false);
        for (double s = 0; s < land_.roadLength() - 4; s += 4) {
            double nearest = 1e9;
            for (const double v : land_.villages()) {
                nearest = std::min(nearest, std::abs(std::remainder(s - v, land_.roadLength())));
            }
            if (nearest > 110 && noise2(s / 70, 0.5, seed_ + kVillageSeed) > 0.25)
                beside(kFence, s, -9.5, true);
        }
    }

    const Landscape& land_;
    uint32_t seed_;
    double edge_;
    size_t count_ = 0;
    std::vector<glm::dvec2> buildings_;
    std::map<ChunkKey, SourceChunk> chunks_;
};

/// Cells along each side of the grid that `wanted` instances grow in: eight an instance leave room for
/// clearings; in 4096 m and 50,000 they are 6.5 m wide.
uint32_t cellsAside(uint32_t wanted) {
    return static_cast<uint32_t>(std::ceil(std::sqrt(8.0 * std::max(wanted, 1u))));
}

/// What `make` needs, shared by all calls. Only what the road has is kept.
struct World {
    World(uint64_t seed, uint32_t placing, const ProceduralOptions& options)
        : land(seed, proceduralSize(options)),
          settled(land, placing, options.chunkSize),
          scattered(land, placing, cellsAside(options.instances),
                    options.instances - std::min<size_t>(settled.count(), options.instances),
                    settled.buildings()) {}
    World(const World&) = delete;
    World& operator=(const World&) = delete;

    Landscape land;
    Settler settled;
    Scatter scattered;
};

}  // namespace

Result<BakeSource> openProcedural(uint64_t seed, const ProceduralOptions& options) {
    const auto usage = [](const std::string& what) {
        return Error{ErrorCode::kUsage, "procedural world: " + what};
    };
    const auto positive = [](double v) { return std::isfinite(v) && v > 0; };
    if (!positive(options.voxel) || !positive(options.chunkSize) || !positive(options.size)) {
        return usage("size, chunk and voxel must be positive numbers of metres");
    }
    const double voxels = options.chunkSize / options.voxel;
    if (voxels != std::round(voxels) || voxels < 8 || voxels > 256) {
        return usage("the chunk must be 8 to 256 whole voxels wide, not " + std::to_string(voxels) +
                     "; choose another chunk or voxel");
    }
    if (options.size < 1024 || options.size > 65536) {
        return usage("the size must be 1024 to 65536 m: less has no room for the road, more was never tried");
    }
    if (options.instances > 10'000'000) return usage("more than 10,000,000 instances");

    const auto world = std::make_shared<const World>(seed, static_cast<uint32_t>(seed) * 977u, options);
    const double size = world->land.size(), edge = options.chunkSize;
    const auto half = static_cast<int32_t>(std::lround(size / 2 / edge));
    BakeSource source;
    for (int32_t x = -half; x < half; ++x) {
        for (int32_t z = -half; z < half; ++z) source.chunks.push_back({x, 0, z});
    }
    source.header.chunkSize = edge;
    source.header.voxel = options.voxel;
    source.header.source = "procedural:" + std::to_string(seed);
    // Azimuth 120 degrees from north (-z) over east (+x), elevation 35: cos 35 * (sin 120, cos 120).
    source.header.sun = glm::normalize(options.sun.value_or(glm::dvec3(-0.709406, -0.573576, -0.409576)));
    source.meshes = proceduralMeshes();
    const double made[] = {size, edge, options.voxel, double(options.instances)};
    source.contents = hashValues(std::span<const double>(made), seed);
    source.make = [world, edge, side = static_cast<int32_t>(voxels),
                   voxel = options.voxel](ChunkKey key) -> Result<SourceChunk> {
        SourceChunk chunk = world->settled.inside(key);
        const std::vector<Instance> grown = world->scattered.inside(key, edge);
        chunk.instances.insert(chunk.instances.end(), grown.begin(), grown.end());
        chunk.names.resize(chunk.instances.size());
        Result<std::optional<TerrainChunk>> terrain =
            makeTerrain([&](const LatticeRect& rect) { return world->land.sample(rect); }, key, side, voxel);
        if (!terrain) return terrain.error();
        chunk.terrain = std::move(terrain.value());
        return chunk;
    };
    return source;
}

}  // namespace world
