// tools/lab/scroll_engine.h — keeps a map of the static casters of each view, and scrolls it as the view moves.
// Source: Day, "CSM Scrolling", 2012.
#pragma once

#include <memory>
#include <optional>

#include "tools/lab/engine.h"

namespace tools::lab {

/// How far a view went.
struct ViewStep {
    glm::ivec2 texels{0};  ///< over the map
    int units = 0;         ///< along the light, of a 16 bit depth
};

/// The step between two views; none where the later map can take nothing from the earlier one: after a step of the
/// map's width or its whole range, or where the views differ by more than whole texels and whole units.
///   side  of the map [texels]
std::optional<ViewStep> stepBetween(const culling::ShadowView& before, const culling::ShadowView& after, int side);

/// For a method that keeps its maps scrolled. What stays of a map is moved; with `mendedScroll` every static caster that
/// meets what the step exposed, strips at the edges and a slab at the far end of the depths, is drawn there, else those
/// that the whole volume did not have before, and nothing of the others. Movers are drawn over a copy. In costs, texels
/// are those that were moved, exposed or copied. The scene's static casters stay the same.
world::Result<std::unique_ptr<Engine>> makeScrollEngine(const Setting& setting, const culling::ShadowMethod& method,
                                                        const world::Pose& first);

}  // namespace tools::lab
