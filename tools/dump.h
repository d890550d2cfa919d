// tools/dump.h — pictures of what a scroll kept and what it drew, to see a cascade's cache at work.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "server/shadow_system.h"
#include "tools/image.h"
#include "tools/output_folder.h"

namespace tools {

struct ReplayFrame;

/// One cascade's cache map around one frame; all maps in stored order, side * side values.
struct ScrollMaps {
    int side = 0;                               ///< [texels]
    cache::Texel window{0}, move{0};            ///< after the frame, and by how much it moved [texels]
    std::span<const float> before, after;       ///< cache map around the frame
    std::span<const float> redrawn;             ///< drawn from scratch after the frame
    std::span<const cache::StoreRect> cleared;  ///< regions that the frame redrew from nothing
};

/// Three views in window order, each side x side, one under the other: the map drawn from scratch;
/// what the frame kept, exposed slabs tinted orange and other cleared regions magenta; what the frame
/// drew, which is every texel that is cleared or differs from before, the rest dark. Gray is
/// height toward the sun over the map's own trend, white the nearest; empty texels are blue.
RgbImage scrollPicture(const ScrollMaps& maps);

/// The same three views side by side, each shrunk by a whole factor to at most kSmallView pixels a side.
constexpr int kSmallView = 352;
RgbImage smallPicture(const RgbImage& picture);

/// A small picture of a frame's cascade, PNG.
struct DumpedPicture {
    uint64_t frame = 0;
    int cascade = 0;
    std::vector<std::byte> png;
};

/// Dumps frames of a replay, by default 8 spread evenly, per cascade `frame_NUMBER_cascade_C.png` (see
/// scrollPicture) and `frame_NUMBER_cascade_C_depth.png`, the working map in window order.
/// One thread at a time.
class Dump {
public:
    static constexpr size_t kFrames = 8;
    /// `folder` must outlive the dump; `frames` is the replay's length.
    Dump(const OutputFolder& folder, size_t frames);
    /// Frames of one's own, counted from the first one played.
    Dump(const OutputFolder& folder, std::vector<size_t> wanted);

    /// Whether the frame at `index`, counted from the first one played, is to be dumped.
    bool wants(size_t index) const;
    /// Keeps the maps as they are ahead of a frame.
    world::Result<world::Done> before(server::ShadowSystem& system);
    /// Writes the pictures of the frame just advanced and verified: the scratch maps hold its redraw.
    world::Result<world::Done> after(server::ShadowSystem& system, const ReplayFrame& frame);
    /// Small ones of all that was dumped, by frame and cascade; hands them out once.
    std::vector<DumpedPicture> takeSmall() { return std::move(small_); }

private:
    const OutputFolder& folder_;
    std::vector<size_t> wanted_;              ///< ascending
    std::vector<DumpedPicture> small_;
    std::vector<std::vector<float>> before_;  ///< cache map per cascade
};

}  // namespace tools
