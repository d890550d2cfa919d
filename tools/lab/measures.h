// tools/lab/measures.h — how a method's answers differ from the truth, and how they flicker.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "culling/truth.h"
#include "server/shading.h"

namespace tools::lab {

/// A filtered answer counts as lit when most of it is.
inline bool lit(const server::ReceiverLight& answer) { return answer.light > 0.5f; }

/// Pixels whose light is off by more than a half, by where they are.
struct Wrong {
    uint64_t atEdges = 0;   ///< within a texel of a shadow's edge, or as far as 2.17: see culling::TruthFrame::edges
    uint64_t elsewhere = 0;
    uint64_t all() const { return atEdges + elsewhere; }
    Wrong& operator+=(const Wrong& o) {
        atEdges += o.atEdges;
        elsewhere += o.elsewhere;
        return *this;
    }
};

/// Sums over frames.
struct Measures {
    uint64_t frames = 0;
    uint64_t pixels = 0;    ///< that face the sun and are within the far distance
    Wrong falseLit, falseShadow;
    double difference = 0;  ///< summed over pixels: |light - truth|
    double softDifference = 0;  ///< likewise, against the share of the sun's disk that is seen; 0 where nobody traced it
    uint64_t unanswered = 0;  ///< pixels for which no map had an answer
    uint64_t points = 0;    ///< seen in two consecutive frames, with the same truth in both
    uint64_t flips = 0;     ///< of these, with light that differs by more than a half
    double usedShare = 0;   ///< summed over frames: of the maps' texels, what visible receivers cover
    std::vector<float> texelsPerPixel;  ///< edge of the texel that answered over a pixel's, of each answered pixel

    Measures& operator+=(const Measures& o);
    uint64_t wrong() const { return falseLit.all() + falseShadow.all(); }
    double share(uint64_t count) const { return pixels == 0 ? 0 : double(count) / double(pixels); }
    double flipsPerMillion() const { return points == 0 ? 0 : 1e6 * double(flips) / double(points); }
    /// The given share of `texelsPerPixel` is at most this; 0 where there are none.
    double texelRatio(double share) const;
};

/// The pixels of a frame that are asked about, in their order.
struct Asked {
    std::vector<uint32_t> pixels;
    std::vector<server::Receiver> receivers;
    std::vector<float> shares;  ///< of the sun's disk, that each sees; empty: not traced
};
/// Those that face the sun, without shares.
Asked sunwardPixels(const culling::TruthFrame& truth);

/// One frame's, but for flips.
///   answers      for `asked`, in its order
///   verticalFov  of the camera [rad]
///   texels       of all maps together
Measures judge(const culling::TruthFrame& truth, const Asked& asked, std::span<const server::ReceiverLight> answers,
               double verticalFov, uint64_t texels);

/// Points and flips alone: answers for the same points in two frames, where the truth is the same.
///   again  what became of the points in the second frame
Measures judgeFlips(const culling::TruthFrame& truth, const Asked& asked, std::span<const server::ReceiverLight> first,
                    std::span<const server::ReceiverLight> second, std::span<const culling::Sunlight> again);

}  // namespace tools::lab
