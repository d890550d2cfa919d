// tools/lab/engine.h — a method at work along a path: draws its maps frame by frame and hands them out.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "cache/statistics.h"
#include "culling/shadow_views.h"
#include "gpu/device.h"
#include "server/shadow_system.h"
#include "tools/lab/scene.h"
#include "world/path.h"
#include "world/result.h"
#include "world/store.h"

namespace tools::lab {

/// An object that leaves the world for good. The scene's tracks say so to everybody but the cache.
struct Removal {
    std::string name;
    double time = 0;  ///< of the first frame without it [s]
};

/// Deliberate defects of methods that keep nothing, each of which a comparison with the truth must catch.
enum class Defect : uint8_t {
    kNone,
    kFromOrigin,   ///< light space is counted from the world's origin in single precision
    kSeenCasters,  ///< what the camera does not see is not drawn
};

/// What all methods of a run share.
struct Setting {
    gpu::Device& device;
    const world::WorldStore& store;
    Scene& scene;
    const std::vector<world::MoverTrack>& movers;
    culling::LightSpace light;  ///< of a sun that stands still
    double farDistance = 600;   ///< [m]
    double verticalFov = 0;     ///< [rad], where it does not change
    std::function<glm::dvec3(double)> sunAt{};  ///< direction of the light's travel by time [s]; empty: stands still
    std::function<double(double)> fovAt{};      ///< vertical field of view [rad] by time [s]; empty: does not change
    std::vector<Removal> removals{};  ///< ascending in time
    server::ShadowConfig cache{};     ///< of the cache, where neither method nor setting say otherwise
    Defect defect = Defect::kNone;
    bool shadingTimed = false;  ///< the GPU shades a screen, too, for the time that it takes
};

/// Nearer than this to the eye [m] nothing is shadowed by methods that slice the view.
constexpr double kNearDistance = 0.5;

double msSince(std::chrono::steady_clock::time_point start);
culling::View viewAt(const Setting& setting, const world::Pose& pose);
/// CHECKs that a light space accepts the sun.
culling::LightSpace lightAt(const Setting& setting, double time);

/// What a frame cost: all that was sent to the rasteriser, statics and movers.
struct FrameCost {
    cache::Cost cost;
    double ms = 0;  ///< wall time, without reading the world; 0 where the frame was not drawn
};

/// One thread at a time. Errors of the GPU and the store pass through.
class Engine {
public:
    virtual ~Engine() = default;
    /// Brings the maps to the pose, which is later than the one before. Moves the setting's movers.
    virtual world::Result<FrameCost> advance(const world::Pose& pose) = 0;
    /// Whether a frame depends on those before it: then none may be left out.
    virtual bool remembers() const = 0;
    /// Of the last frame: views, and their maps, row by row in the views' own order.
    virtual std::span<const culling::ShadowView> views() const = 0;
    virtual world::Result<std::vector<std::vector<float>>> images() = 0;
    /// Of these maps: a cache follows a moving sun in steps.
    virtual const culling::LightSpace& light() const = 0;
};

/// kUsage, with the most cascades that would do, for a method of which one serves nothing: the finest would end nearer than
/// kNearDistance, or the coarsest begin farther off than the scene is wide.
world::Result<world::Done> requireRoom(const Setting& setting, const culling::ShadowMethod& method);

/// kUsage for a method that cannot work.
world::Result<std::unique_ptr<Engine>> makeEngine(const Setting& setting, const culling::ShadowMethod& method,
                                                  const world::Pose& first);

}  // namespace tools::lab
