// tools/lab/picture.h — a judged frame as a picture: what the camera sees, and where a method is wrong.
// Source: Okabe & Ito, "Color Universal Design", 2008 (colours that colour-blind readers tell apart).
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "culling/truth.h"
#include "server/shading.h"
#include "tools/image.h"
#include "tools/lab/measures.h"

namespace tools::lab {

using Rgb = std::array<uint8_t, 3>;
constexpr Rgb kFalseLit{230, 159, 0};     ///< orange: sunlight where there is shadow
constexpr Rgb kFalseShadow{0, 130, 240};  ///< blue, brighter than theirs to read on dark gray: shadow where there is sunlight
constexpr Rgb kSkyColor{238, 240, 243};   ///< lighter than any surface

/// The truth in gray, the brighter the more a surface faces the sun, at most 205; wrong pixels in the colours above.
///   answers  for `asked`, in its order
RgbImage wrongPicture(const culling::TruthFrame& truth, const Asked& asked,
                      std::span<const server::ReceiverLight> answers);

}  // namespace tools::lab
