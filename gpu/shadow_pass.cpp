#include "gpu/shadow_pass.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>

#include "gpu/compute.h"
#include "gpu/device_impl.h"
#include "gpu/frame.h"
#include "gpu/shaders/shadow_pass.comp.h"
#include "world/check.h"

namespace gpu {
namespace {

using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

// As the shader has them.
struct View {
    glm::mat4 clipFromEye, eyeFromClip;
    glm::vec4 wedge[2];
    glm::vec4 rect;
    glm::vec2 interval;
    float unused[2];
};
struct Map {
    glm::ivec3 corner{0};
    int32_t first = 0, end = 0;
    int32_t unused[3] = {};
};
struct Scene {
    View views[kMostPassViews];
    Map maps[kMostPassViews];
    glm::mat3x4 lightFromWorld;  // columns of three, each filled up to four
    glm::vec4 steps[kMostPassTaps];
    glm::vec3 forward;
    int32_t mapCount;
    glm::vec4 bias;
    float blend, fade, far, reach;
    int32_t side;
    uint32_t byInterval;
    float mostFall;
    int32_t unused;
};
static_assert(sizeof(View) == 192 && sizeof(Map) == 32 && sizeof(Scene) == 2048);
static_assert(sizeof(PassReceiver) == 32 && sizeof(PassAnswer) == 8);

View viewOf(const PassView& view) {
    View made{};
    made.clipFromEye = view.clipFromEye;
    made.eyeFromClip = view.eyeFromClip;
    for (size_t i = 0; i < view.wedge.size(); ++i) made.wedge[i] = glm::vec4(view.wedge[i], 0);
    made.rect = glm::vec4(view.low, view.high);
    made.interval = {view.begin, view.end};
    return made;
}

/// Where maps lie in the image: `columns` of them in each layer's row and column, `layers` of these.
struct Places {
    int columns = 1, layers = 1;

    explicit Places(const ShadowPassConfig& config) {
        if (!config.atlas) layers = config.maps;
        while (config.atlas && columns * columns < config.maps) ++columns;
    }
    /// Corner of a map: texels, and its layer.
    glm::ivec3 cornerOf(int map, int side) const {
        return layers > 1 ? glm::ivec3(0, 0, map) : glm::ivec3(map % columns * side, map / columns * side, 0);
    }
};

Scene sceneOf(const ShadowPassConfig& config, const PassScene& scene) {
    CHECK(!scene.views.empty() && scene.views.size() <= kMostPassViews);
    Scene made{};
    const Places places(config);
    for (size_t v = 0; v < scene.views.size(); ++v) {
        made.views[v] = viewOf(scene.views[v]);
        const bool fresh = v == 0 || scene.views[v].map != scene.views[v - 1].map;
        if (fresh) {
            CHECK(made.mapCount < config.maps);
            made.maps[made.mapCount].corner = places.cornerOf(made.mapCount, config.side);
            made.maps[made.mapCount++].first = int32_t(v);
        }
        made.maps[made.mapCount - 1].end = int32_t(v) + 1;
    }
    made.lightFromWorld = glm::mat3x4(scene.lightFromWorld);
    for (size_t i = 0; i < kMostPassTaps; ++i) made.steps[i] = glm::vec4(config.taps.steps[i], 0, 0);
    made.forward = scene.forward;
    made.bias = {scene.receiverBias, scene.gradientBias, scene.gradientMost, scene.normalOffset};
    made.blend = scene.blend;
    made.fade = scene.fade;
    made.far = scene.far;
    made.reach = config.taps.reach;
    made.side = config.side;
    made.byInterval = scene.byInterval;
    made.mostFall = scene.mostFall;
    return made;
}

}  // namespace

struct ShadowPass::Impl {
    Device::Impl& device;
    ShadowPassConfig config;
    DepthMap depths;  ///< all maps
    Buffer staged, scene, receivers, answers;
    Compute compute;
    bool loaded = false, fresh = false;  ///< maps were given; since the last pass
    size_t answered = 0;
    Frame frame;  ///< last, so that its destructor waits before the rest goes

    uint64_t mapBytes() const { return uint64_t(config.side) * uint64_t(config.side) * texelBytes(config.format); }
    void copyMaps(VkCommandBuffer commands);
};

Result<std::unique_ptr<ShadowPass>> ShadowPass::create(Device& device, const ShadowPassConfig& config) {
    CHECK(config.maps > 0 && size_t(config.maps) <= kMostPassViews && config.side > 0 && config.receivers > 0);
    CHECK(config.taps.count > 0 && config.taps.count <= kMostPassTaps);
    Device::Impl& d = device.impl();
    const Places places(config);
    const auto side = uint32_t(config.side * places.columns);
    if (side > d.maxSide)
        return Error{ErrorCode::kLimit, "maps of " + std::to_string(config.side) + " texels a side, in an image of " +
                                            std::to_string(side) + ": '" + d.name + "' has at most " +
                                            std::to_string(d.maxSide) + "; lower the resolution, or use no atlas"};
    const uint64_t mapBytes = uint64_t(config.maps) * uint64_t(config.side) * uint64_t(config.side) * texelBytes(config.format);
    if (mapBytes > d.maxAllocationBytes)
        return Error{ErrorCode::kLimit, "maps of " + std::to_string(mapBytes) + " bytes: '" + d.name + "' takes at most " +
                                            std::to_string(d.maxAllocationBytes) + " at once; lower the resolution"};
    const uint64_t receiverBytes = uint64_t{config.receivers} * sizeof(PassReceiver);
    if (receiverBytes > d.maxStorageBytes)
        return Error{ErrorCode::kLimit, std::to_string(config.receivers) + " points that ask for light: shaders of '" + d.name +
                                            "' see at most " + std::to_string(d.maxStorageBytes) +
                                            " bytes at once; ask for fewer pixels"};
    auto depths = createDepthArray(d, {side, side}, uint32_t(places.layers), config.format, "shadow pass maps");
    if (!depths) return depths.error();
    auto staged = createBuffer(d, mapBytes, VK_BUFFER_USAGE_TRANSFER_SRC_BIT, Home::kUpload, "shadow pass staging");
    if (!staged) return staged.error();
    auto scene = createBuffer(d, sizeof(Scene), VK_BUFFER_USAGE_UNIFORM_BUFFER_BIT, Home::kUpload, "shadow pass scene");
    if (!scene) return scene.error();
    auto receivers = createBuffer(d, receiverBytes, VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, Home::kUpload, "shadow pass receivers");
    if (!receivers) return receivers.error();
    auto answers = createBuffer(d, uint64_t{config.receivers} * sizeof(PassAnswer), VK_BUFFER_USAGE_STORAGE_BUFFER_BIT,
                                Home::kReadback, "shadow pass answers");
    if (!answers) return answers.error();
    const VkDescriptorType bindings[] = {VK_DESCRIPTOR_TYPE_UNIFORM_BUFFER, VK_DESCRIPTOR_TYPE_SAMPLED_IMAGE,
                                         VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, VK_DESCRIPTOR_TYPE_STORAGE_BUFFER};
    const uint32_t constants[] = {config.taps.count, config.taps.turned, config.taps.between};
    auto compute = Compute::create(d, {.shader = kShadowPassComp,
                                       .bindings = bindings,
                                       .constants = constants,
                                       .pushBytes = sizeof(uint32_t),
                                       .name = "shadow pass"});
    if (!compute) return compute.error();
    auto frame = Frame::create(d, 0, "shadow pass frame");
    if (!frame) return frame.error();
    std::unique_ptr<Impl> impl(new Impl{.device = d,
                                        .config = config,
                                        .depths = {std::move(depths.value())},
                                        .staged = std::move(staged.value()),
                                        .scene = std::move(scene.value()),
                                        .receivers = std::move(receivers.value()),
                                        .answers = std::move(answers.value()),
                                        .compute = std::move(compute.value()),
                                        .frame = std::move(frame.value())});
    impl->compute.bind(0, impl->scene);
    impl->compute.bind(1, impl->depths.image, kSampledLayout);
    impl->compute.bind(2, impl->receivers);
    impl->compute.bind(3, impl->answers);
    return std::unique_ptr<ShadowPass>(new ShadowPass(std::move(impl)));
}

ShadowPass::ShadowPass(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
ShadowPass::~ShadowPass() = default;

void ShadowPass::load(std::span<const std::span<const float>> images) {
    Impl& impl = *impl_;
    CHECK(images.size() == size_t(impl.config.maps));
    for (size_t m = 0; m < images.size(); ++m) {
        CHECK(images[m].size() == size_t(impl.config.side) * size_t(impl.config.side));
        std::byte* const to = impl.staged.mapped + m * impl.mapBytes();
        if (impl.config.format == DepthFormat::kD32) {
            std::memcpy(to, images[m].data(), images[m].size_bytes());
        } else {
            std::transform(images[m].begin(), images[m].end(), reinterpret_cast<uint16_t*>(to),
                           [](float depth) { return uint16_t(std::lround(depth * 65535)); });
        }
    }
    impl.loaded = impl.fresh = true;
}

void ShadowPass::Impl::copyMaps(VkCommandBuffer commands) {
    frame.need(depths, Use::kCopyTarget);
    frame.barrier();
    const Places places(config);
    std::vector<VkBufferImageCopy> copies(size_t(config.maps));
    for (size_t m = 0; m < copies.size(); ++m) {
        const glm::ivec3 corner = places.cornerOf(int(m), config.side);
        copies[m].bufferOffset = m * mapBytes();
        copies[m].imageSubresource = {VK_IMAGE_ASPECT_DEPTH_BIT, 0, uint32_t(corner.z), 1};
        copies[m].imageOffset = {corner.x, corner.y, 0};
        copies[m].imageExtent = {uint32_t(config.side), uint32_t(config.side), 1};
    }
    vkCmdCopyBufferToImage(commands, staged.raw(), depths.image.handle.raw(), kCopyTargetLayout, uint32_t(copies.size()),
                           copies.data());
}

Result<double> ShadowPass::shade(const PassScene& scene, std::span<const PassReceiver> receivers) {
    Impl& impl = *impl_;
    CHECK(impl.loaded && receivers.size() <= impl.config.receivers);
    impl.answered = 0;
    const Scene given = sceneOf(impl.config, scene);
    std::memcpy(impl.scene.mapped, &given, sizeof given);
    if (!receivers.empty()) std::memcpy(impl.receivers.mapped, receivers.data(), receivers.size_bytes());
    const auto commands = impl.frame.begin();
    if (!commands) return commands.error();
    if (impl.fresh) impl.copyMaps(commands.value());
    impl.frame.need(impl.depths, Use::kSampled);
    impl.frame.barrier();
    const auto count = uint32_t(receivers.size());
    impl.compute.record(commands.value(), count, &count);
    impl.frame.toHost(impl.answers);
    if (const auto submitted = impl.frame.submit(); !submitted) return submitted.error();
    if (const auto settled = impl.frame.settle(); !settled) return settled.error();
    impl.fresh = false;
    impl.answered = receivers.size();
    return impl.frame.wallMs();
}

std::span<const PassAnswer> ShadowPass::answers() const {
    return {reinterpret_cast<const PassAnswer*>(impl_->answers.mapped), impl_->answered};
}

}  // namespace gpu
