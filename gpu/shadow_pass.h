// gpu/shadow_pass.h — the deferred pass: how much light each point of a screen gets, from maps in an array or an atlas.
// Source: Engel, "Cascaded Shadow Maps", ShaderX5, 2006 (a pass of its own, into a factor for each pixel; the atlas).
// It is server/shading.h on the GPU; every step of it is described there.
#pragma once

#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <memory>
#include <span>
#include <vector>

#include "gpu/device.h"
#include "world/result.h"

namespace gpu {

constexpr size_t kMostPassViews = 8, kMostPassTaps = 9;

/// The texels that a filter reads.
struct PassTaps {
    std::array<glm::vec2, kMostPassTaps> steps{};  ///< from the point [texels]
    uint32_t count = 1;                            ///< of them
    bool turned = false;                           ///< steps are turned by an angle of each pixel's own
    bool between = false;  ///< steps are whole, from the texel before the point, and weighted by where the point lies
    float reach = 0;       ///< how far from the point texels may lie, along x or y [texels]
};

struct ShadowPassConfig {
    int maps = 4;  ///< at most kMostPassViews
    int side = 1024;  ///< texels a side of each
    DepthFormat format = DepthFormat::kD32;
    bool atlas = false;  ///< all maps in one image, two by two, or three by three if there are more; else a layer each
    uint32_t receivers = 1280 * 720;  ///< most at once, > 0
    PassTaps taps{};
};

/// How light falls on one map; those of one map follow each other. Points are relative to the eye, along the axes of
/// light space [m]: whoever makes these from doubles loses nothing far from the world's origin.
struct PassView {
    glm::mat4 clipFromEye{1}, eyeFromClip{1};
    std::array<glm::vec3, 2> wedge{};  ///< half planes (a, b, c) of clip space, a x + b y + c w >= 0; zeros: everywhere
    glm::vec2 low{0}, high{0};         ///< rectangle of the map plane outside of which it answers for nothing
    float begin = 0, end = 0;          ///< of the interval that it serves, along the view [m]
    int map = 0;
};

/// What is the same for all points of a frame.
struct PassScene {
    std::vector<PassView> views;      ///< 1 to kMostPassViews
    glm::mat3 lightFromWorld{1};      ///< rotation
    glm::vec3 forward{0, 0, -1};      ///< of the camera, world
    bool byInterval = false;          ///< the map is selected by the distance along the view; else the finest is taken
    float receiverBias = 0;           ///< [texels] toward the sun
    float gradientBias = 0, gradientMost = 0;  ///< [texels] by the slope of the point's own plane, and its most
    float mostFall = 0;               ///< [texels] of the point's own plane on the way to a tap, which is compared with that; 0: not
    float normalOffset = 0;           ///< [texels] along the normal, times the sine of its angle to the sun
    float blend = 0;                  ///< share over which a map is blended into the next
    float fade = 0;                   ///< share of `far` over which shadows fade out
    float far = 0;                    ///< [m]
};

/// A pixel that asks.
struct PassReceiver {
    glm::vec3 point{0};   ///< relative to the eye, along the world's axes [m]
    uint32_t pixel = 0;   ///< turns the filters that turn: the same number, the same angle
    glm::vec3 normal{0};  ///< unit, world, on the side that faces the sun
    float unused = 0;     ///< fills it up to what the shader reads
};

struct PassAnswer {
    float light = 1;    ///< from 0, in shadow, to 1
    int32_t view = -1;  ///< that answered, of two that are blended the first; -1: none, and the point counts as lit
};

/// One thread at a time. Every error is kDevice or kLimit.
class ShadowPass {
public:
    /// `device` must outlive it.
    static world::Result<std::unique_ptr<ShadowPass>> create(Device& device, const ShadowPassConfig& config);
    ~ShadowPass();

    /// What the maps hold in the next passes: side * side depths each, row by row, as cache/frame_plan.h has them. They
    /// come to the GPU with the next pass. CHECKs their number and size.
    void load(std::span<const std::span<const float>> images);
    /// Answers for each receiver, in their order, in one submission; waits for it. CHECKs that maps were loaded, and that
    /// there are not too many receivers.
    ///   Returns the time from vkQueueSubmit to its fence [ms], noisy on software drivers
    world::Result<double> shade(const PassScene& scene, std::span<const PassReceiver> receivers);
    /// Of the last `shade`; until the next.
    std::span<const PassAnswer> answers() const;

private:
    struct Impl;
    explicit ShadowPass(std::unique_ptr<Impl> impl);
    std::unique_ptr<Impl> impl_;
};

}  // namespace gpu
