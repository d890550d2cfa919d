#include "tools/lab/shading_time.h"

#include <algorithm>
#include <limits>

#include "server/screen_pass.h"

namespace tools::lab {
namespace {

/// Passes that are timed. Other work on the machine makes times longer, never shorter.
constexpr int kPasses = 3;

std::vector<gpu::PassReceiver> screenOf(const culling::View& camera, const culling::TruthFrame& truth, const Asked& asked) {
    std::vector<const server::Receiver*> judged(truth.states.size(), nullptr);
    for (size_t i = 0; i < asked.pixels.size(); ++i) judged[asked.pixels[i]] = &asked.receivers[i];
    std::vector<gpu::PassReceiver> screen;
    for (int y = 0; y < kScreenHeight; ++y)
        for (int x = 0; x < kScreenWidth; ++x) {
            const int row = y * truth.height / kScreenHeight, column = x * truth.width / kScreenWidth;
            const server::Receiver* const receiver = judged[size_t(row) * size_t(truth.width) + size_t(column)];
            if (!receiver) continue;
            screen.push_back(server::passReceiver(camera, *receiver));
            screen.back().pixel = uint32_t(y * kScreenWidth + x);
        }
    return screen;
}

}  // namespace

world::Result<double> ShadingTime::measure(const Engine& engine, const culling::View& camera,
                                           std::span<const std::span<const float>> images,
                                           const culling::TruthFrame& truth, const Asked& asked) {
    if (!pass_) {
        auto made = gpu::ShadowPass::create(
            setting_.device, server::passConfig(method_, int(images.size()), size_t(kScreenWidth) * kScreenHeight));
        if (!made) return made.error();
        pass_ = std::move(made.value());
    }
    const gpu::PassScene scene = server::passScene(method_, engine.views(), engine.light(), camera);
    const std::vector<gpu::PassReceiver> screen = screenOf(camera, truth, asked);
    pass_->load(images);
    if (const auto first = pass_->shade(scene, screen); !first) return first.error();
    double least = std::numeric_limits<double>::infinity();
    for (int i = 0; i < kPasses; ++i) {
        const auto ms = pass_->shade(scene, screen);
        if (!ms) return ms.error();
        least = std::min(least, ms.value());
    }
    return least;
}

}  // namespace tools::lab
