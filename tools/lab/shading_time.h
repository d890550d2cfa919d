// tools/lab/shading_time.h — what it takes the GPU to shade a screen from a method's maps: the cost of a filter.
#pragma once

#include <memory>
#include <vector>

#include "gpu/shadow_pass.h"
#include "tools/lab/engine.h"
#include "tools/lab/measures.h"

namespace tools::lab {

/// The screen [pixels].
constexpr int kScreenWidth = 1280, kScreenHeight = 720;

/// Of one method.
class ShadingTime {
public:
    /// `setting` and `method` must outlive it.
    ShadingTime(const Setting& setting, const culling::ShadowMethod& method) : setting_(setting), method_(method) {}

    /// Time of the deferred pass alone, in which each pixel of the screen that lies in one of the judged pixels asks for
    /// its point: the least of three [ms]. The maps have come to the GPU before. Errors of the GPU.
    ///   truth   the judged pixels; `asked` are those of them that ask
    world::Result<double> measure(const Engine& engine, const culling::View& camera,
                                  std::span<const std::span<const float>> images, const culling::TruthFrame& truth,
                                  const Asked& asked);

private:
    const Setting& setting_;
    const culling::ShadowMethod& method_;
    std::unique_ptr<gpu::ShadowPass> pass_;  ///< made when it is first asked for
};

}  // namespace tools::lab
