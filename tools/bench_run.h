// tools/bench_run.h — a motion played three ways side by side: by the cache, by drawing everything in
// every frame, and by a bare Vulkan loop that draws what the cache drew.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "gpu/floor.h"
#include "server/shadow_system.h"
#include "tools/bench_motion.h"

namespace tools {

/// Deterministic: static and active part, all cascades.
struct Drawn {
    uint64_t triangles = 0;  ///< sent to the rasteriser
    uint64_t texels = 0;     ///< redrawn or restored
};

/// What a motion cost. Times are wall times [ms] of single frames.
struct MotionCost {
    std::string name;
    std::vector<double> update;  ///< plan, record, submit to fence
    std::vector<double> whole;   ///< all of ShadowSystem::advance: streaming, sets and certificates as well
    std::vector<double> floor;   ///< submit to fence, nothing else; empty if not asked for
    std::vector<double> redraw;  ///< update of a system that draws everything, on some of the frames
    Drawn drawn, redrawn;        ///< over all frames, over those that were redrawn
    server::StageTimes stages;   ///< summed over all frames
    double gpuMs = 0;            ///< submit to fence, summed
    size_t submissions = 0;

    size_t frames() const { return update.size(); }
};

struct BenchConfig {
    server::ShadowConfig shadows;  ///< timestamps are left out, whatever it says
    size_t redraws = 20;           ///< frames of each motion that are drawn whole as well; may be 0
    bool floor = true;
};

/// Systems that stay from motion to motion. One thread at a time.
class BenchRun {
public:
    /// `device` and `store` must outlive it. Errors of ShadowSystem and Floor.
    static world::Result<std::unique_ptr<BenchRun>> create(gpu::Device& device,
                                                           const world::WorldStore& store,
                                                           const BenchConfig& config);
    ~BenchRun();

    /// Plays the motion (without movers in a world that has no mesh for them) after three frames at its first
    /// pose, which fill the maps and are not counted.
    world::Result<MotionCost> play(const Motion& motion);

private:
    struct Impl;
    explicit BenchRun(std::unique_ptr<Impl> impl);
    std::unique_ptr<Impl> impl_;
};

}  // namespace tools
