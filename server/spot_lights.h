// server/spot_lights.h — the spot lights of a system: what they hold, what a frame did for them, and their
// answers.
#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "cache/spot_cache.h"
#include "gpu/shadow_maps.h"
#include "server/lookup.h"
#include "server/resident_scene.h"
#include "server/verification.h"

namespace server {

/// A spot light; given out by `addSpot`, never twice.
using SpotId = uint32_t;

constexpr size_t kMostSpots = 64;  ///< at once

/// One light's share of a frame.
struct SpotReport {
    SpotId id = 0;
    cache::SpotStatistics cost;
};

/// One light's committed state, to be used with its maps and nothing else. Texel (i, j) of a map is at
/// j * side + i, and cache::distanceOf turns a stored depth into metres along the axis.
struct SpotView {
    culling::SpotSpace space;
    bool drawn = false;  ///< false: the maps hold nothing yet
};

enum class SpotAnswer : uint8_t {
    kLit,
    kShadowed,
    kOutside,  ///< of the cone, or beyond its range
    kUnknown,  ///< nothing was drawn for the light yet
};

/// Lights in the order of their ids. A ShadowSystem forwards to it. One thread at a time.
class SpotLights {
public:
    /// `maps` must outlive it, and get its lights from nobody else.
    SpotLights(gpu::ShadowMaps& maps, cache::Sabotage sabotage) : maps_(maps), sabotage_(sabotage) {}

    /// See ShadowSystem.
    world::Result<SpotId> add(const culling::SpotLight& light);
    world::Result<world::Done> move(SpotId id, const culling::SpotLight& light);
    world::Result<world::Done> remove(SpotId id);
    world::Result<SpotView> view(SpotId id) const;
    world::Result<std::vector<SpotAnswer>> lookup(SpotId id, std::span<const glm::dvec3> points, const LookupBias& bias);
    world::Result<std::vector<float>> readMap(SpotId id, gpu::MapKind kind);

    /// Plans all lights' frame before the scene settles. Uploads levels of detail that only lights draw.
    ///   reports  replaced, one per light by id
    world::Result<world::Done> plan(ResidentScene& scene, std::vector<SpotReport>& reports);
    /// To be submitted with that frame.
    const cache::FramePlan& planned() const { return plan_; }
    /// What the maps hold is anybody's guess; the next plan draws them whole.
    void forget();
    /// Draws all maps from scratch, compares each texel and adds to the report.
    world::Result<world::Done> verify(ResidentScene& scene, VerifyReport& report);

    /// `seed` where there are no lights, and otherwise that and the last plan.
    uint64_t planHash(uint64_t seed) const;

private:
    struct Entry {
        SpotId id = 0;
        cache::SpotCache cache;
    };
    world::Result<size_t> find(SpotId id) const;
    world::Result<world::Done> compare(size_t light, gpu::MapKind cached, gpu::MapKind redrawn,
                                       const ResidentScene& scene, VerifyReport& report);

    gpu::ShadowMaps& maps_;
    std::vector<Entry> lights_;  ///< ascending by id, numbered as in `maps_`
    SpotId next_ = 0;
    cache::Sabotage sabotage_;
    cache::FramePlan plan_, redraw_;
};

}  // namespace server
