#include "tools/lab/picture.h"

#include <algorithm>
#include <cmath>

#include "world/check.h"

namespace tools::lab {
namespace {

using culling::Sunlight;

/// Gray of surfaces in shadow: some of it by how they are turned, or walls in shadow would be flat.
constexpr double kShade = 52, kShadeTurned = 24;
/// What the sun adds to a surface that faces it, from a grazing sun to one overhead.
constexpr double kGrazing = 44, kFacing = 85;

Rgb shaded(const culling::TruthFrame& truth, size_t pixel) {
    if (truth.states[pixel] == Sunlight::kSky) return kSkyColor;
    const glm::dvec3 normal(truth.normals[pixel]);
    double value = kShade + kShadeTurned * (0.5 + 0.5 * normal.y);
    if (truth.states[pixel] == Sunlight::kLit) value += kGrazing + kFacing * std::abs(glm::dot(normal, truth.sun));
    const auto gray = static_cast<uint8_t>(std::lround(value));
    return {gray, gray, gray};
}

}  // namespace

RgbImage wrongPicture(const culling::TruthFrame& truth, const Asked& asked,
                      std::span<const server::ReceiverLight> answers) {
    CHECK(answers.size() == asked.pixels.size());
    RgbImage image{truth.width, truth.height, std::vector<uint8_t>(3 * truth.states.size())};
    const auto put = [&](size_t pixel, Rgb color) {
        std::copy(color.begin(), color.end(), image.pixels.begin() + std::ptrdiff_t(3 * pixel));
    };
    for (size_t pixel = 0; pixel < truth.states.size(); ++pixel) put(pixel, shaded(truth, pixel));
    for (size_t i = 0; i < answers.size(); ++i) {
        const bool truly = truth.states[asked.pixels[i]] == Sunlight::kLit;
        if (lit(answers[i]) != truly) put(asked.pixels[i], truly ? kFalseShadow : kFalseLit);
    }
    return image;
}

}  // namespace tools::lab
