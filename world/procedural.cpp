// world/procedural.cpp — see procedural.h.
#include "world/procedural.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <numbers>

#include "world/noise.h"
#include "world/procedural_field.h"
#include "world/procedural_meshes.h"
#include "world/procedural_path.h"
#include "world/terrain.h"

namespace world {
namespace {

enum : uint32_t { kScatter = 101, kForest = 102, kGrove = 103, kVillage = 104 };

/// An instance and the name it has, if any.
struct Placed {
    Instance instance;
    std::string name;
};

/// Turned by `yaw` about y, then tilted by up to `tilt` radians about a horizontal axis.
glm::mat3 turned(double yaw, double tilt, double scale) {
    const glm::dquat turn = glm::angleAxis(yaw, glm::dvec3(0, 1, 0));
    const glm::dquat lean = glm::angleAxis(tilt, glm::dvec3(std::cos(3 * yaw), 0, std::sin(3 * yaw)));
    return glm::mat3(glm::mat3_cast(lean * turn) * scale);
}

class Settler {
public:
    Settler(const Landscape& land, uint64_t seed, uint32_t wanted)
        : land_(land), seed_(static_cast<uint32_t>(seed) * 977u), wanted_(wanted) {}

    std::vector<Placed> settle() {
        moveIn();
        build();
        scatter();
        return std::move(placed_);
    }

private:
    void moveIn() {
        const std::vector<MoverTrack> tracks = moversOn(land_);
        for (size_t m = 0; m < tracks.size(); ++m) {
            const MoverSample& s = tracks[m].samples.front();
            placed_.push_back(
                {{proceduralMoverMesh(m), {glm::mat3(glm::mat3_cast(s.orientation) * s.scale), s.position}},
                 tracks[m].name});
        }
    }

    /// A mesh beside the road whose -z side looks at it, or along it for `along`.
    void beside(uint32_t mesh, double distance, double right, bool along) {
        const RoadPoint road = land_.road(distance);
        const glm::dvec2 p = road.position + road.right() * right;
        // -z towards the road's middle: what is along x is then along the road.
        const glm::dvec2 look = along ? road.right() : road.right() * (right > 0 ? -1.0 : 1.0);
        placed_.push_back(
            {{mesh, {turned(std::atan2(-look.x, -look.y), 0, 1), {p.x, land_.groundHeight(p.x, p.y), p.y}}},
             ""});
        if (mesh == kHouse || mesh == kCottage || mesh == kShed) buildings_.push_back(p);
    }

    /// Villages: two rows of houses with walls towards the road; poles all along it, fences here and there.
    void build() {
        int n = 0;
        for (const double middle : land_.villages()) {
            for (double s = -84; s <= 84; s += 24) {
                for (const double side : {-1.0, 1.0}) {
                    const double pick = hashUnit(n++, 0, 0, seed_ + kVillage);
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
            if (nearest > 110 && noise2(s / 70, 0.5, seed_ + kVillage) > 0.25) beside(kFence, s, -9.5, true);
        }
    }

    struct Candidate {
        double score;
        uint32_t cell;
        uint32_t mesh;
    };

    glm::dvec2 cellPoint(uint32_t cell) const {
        const auto i = static_cast<int32_t>(cell / cells_), k = static_cast<int32_t>(cell % cells_);
        const double edge = (land_.size() - 8) / cells_;
        return {(i + 0.15 + 0.7 * hashUnit(i, 0, k, seed_ + kScatter)) * edge - land_.size() / 2 + 4,
                (k + 0.15 + 0.7 * hashUnit(i, 1, k, seed_ + kScatter)) * edge - land_.size() / 2 + 4};
    }
    double cellUnit(uint32_t cell, int32_t what) const {
        return hashUnit(static_cast<int32_t>(cell / cells_), what, static_cast<int32_t>(cell % cells_),
                        seed_ + kScatter);
    }

    /// What would grow or lie in a cell, and how much it belongs there.
    Candidate candidate(uint32_t cell) const {
        const glm::dvec2 p = cellPoint(cell);
        Candidate c{-10, cell, kBush};
        const double road = land_.roadDistance(p.x, p.y);
        if (road < 10) return c;
        if (road < 60) {
            for (const glm::dvec2& b : buildings_) {
                if (glm::distance(b, p) < 10) return c;
            }
        }
        const double luck = cellUnit(cell, 2), kind = cellUnit(cell, 3);
        const double steep = land_.slope(p.x, p.y);
        const double wood =
            noise2(p.x / 320, p.y / 320, seed_ + kForest) + 0.5 * noise2(p.x / 85, p.y / 85, seed_ + kGrove);
        if (steep > 0.75) {
            c.mesh = kind < 0.6 ? kBoulder : kRockSlab;
            c.score = 0.8 - luck;
        } else {
            const double needles = 0.5 + 1.2 * noise2(p.x / 500, p.y / 500, seed_ + kGrove + 50);
            c.mesh = kind < 0.12                   ? kBush
                     : kind < 0.14                 ? kBoulder
                     : cellUnit(cell, 4) < needles ? kConifer
                                                   : kBroadleaf;
            if (wood < 0.05 && kind > 0.5) c.mesh = kBush;
            c.score = wood - 0.6 * luck - 0.5 * std::max(steep - 0.4, 0.0);
        }
        return c;
    }

    /// The best cells of a jittered grid, as many as are wanted still.
    void scatter() {
        if (placed_.size() >= wanted_) return;
        const size_t missing = wanted_ - placed_.size();
        // Eight cells an instance leave room for clearings; in 4096 m and 50,000 they are 6.5 m wide.
        cells_ = static_cast<uint32_t>(std::ceil(std::sqrt(8.0 * wanted_)));
        std::vector<Candidate> candidates(size_t{cells_} * cells_);
        tbb::parallel_for(size_t{0}, candidates.size(),
                          [&](size_t i) { candidates[i] = candidate(static_cast<uint32_t>(i)); });
        std::sort(candidates.begin(), candidates.end(), [](const Candidate& a, const Candidate& b) {
            return a.score != b.score ? a.score > b.score : a.cell < b.cell;
        });
        candidates.resize(std::min(missing, candidates.size()));
        std::sort(candidates.begin(), candidates.end(),
                  [](const Candidate& a, const Candidate& b) { return a.cell < b.cell; });
        const size_t before = placed_.size();
        placed_.resize(before + candidates.size());
        tbb::parallel_for(size_t{0}, candidates.size(), [&](size_t i) {
            const Candidate& c = candidates[i];
            const glm::dvec2 p = cellPoint(c.cell);
            const bool rock = c.mesh == kBoulder || c.mesh == kRockSlab;
            const double yaw = 2 * std::numbers::pi * cellUnit(c.cell, 5);
            const double tilt = rock ? 0.3 * cellUnit(c.cell, 6) : 0, scale = 0.7 + 0.7 * cellUnit(c.cell, 7);
            placed_[before + i].instance = {
                c.mesh, {turned(yaw, tilt, scale), {p.x, land_.groundHeight(p.x, p.y), p.y}}};
        });
    }

    const Landscape& land_;
    uint32_t seed_;
    uint32_t wanted_;
    uint32_t cells_ = 0;  // along each side of the grid
    std::vector<glm::dvec2> buildings_;
    std::vector<Placed> placed_;
};

/// What `make` needs, shared by all calls.
struct World {
    Landscape land;
    std::map<ChunkKey, std::vector<Placed>> chunks;
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

    const double size = proceduralSize(options), edge = options.chunkSize;
    auto world = std::make_shared<World>(World{Landscape(seed, size), {}});
    const auto half = static_cast<int32_t>(std::lround(size / 2 / edge));
    BakeSource source;
    for (int32_t x = -half; x < half; ++x) {
        for (int32_t z = -half; z < half; ++z) source.chunks.push_back({x, 0, z});
    }
    for (Placed& p : Settler(world->land, seed, options.instances).settle()) {
        const glm::dvec3 t = p.instance.placement.translation;
        world
            ->chunks[{static_cast<int32_t>(std::floor(t.x / edge)), 0,
                      static_cast<int32_t>(std::floor(t.z / edge))}]
            .push_back(std::move(p));
    }
    source.header.chunkSize = edge;
    source.header.voxel = options.voxel;
    source.header.source = "procedural:" + std::to_string(seed);
    // Azimuth 120 degrees from north (-z) over east (+x), elevation 35: cos 35 * (sin 120, cos 120).
    source.header.sun = glm::normalize(options.sun.value_or(glm::dvec3(-0.709406, -0.573576, -0.409576)));
    source.meshes = proceduralMeshes();
    source.make = [world, side = static_cast<int32_t>(voxels),
                   voxel = options.voxel](ChunkKey key) -> Result<SourceChunk> {
        SourceChunk chunk;
        if (const auto found = world->chunks.find(key); found != world->chunks.end()) {
            for (const Placed& p : found->second) {
                chunk.instances.push_back(p.instance);
                chunk.names.push_back(p.name);
            }
        }
        Result<std::optional<TerrainChunk>> terrain =
            makeTerrain([&](const LatticeRect& rect) { return world->land.sample(rect); }, key, side, voxel);
        if (!terrain) return terrain.error();
        chunk.terrain = std::move(terrain.value());
        return chunk;
    };
    return source;
}

}  // namespace world
