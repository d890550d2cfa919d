// tools/lab/occlusion.h — casters left out of maps as hidden, by a few rays each and by proof at every texel: what that
// saves, and what it breaks.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "tools/lab/engine.h"
#include "tools/lab/run.h"

namespace tools::lab {

/// What came out for a way of finding hidden casters. Sums over the judged frames and over all maps of each.
struct OcclusionRecord {
    std::string way;
    size_t judged = 0;          ///< frames
    uint64_t asked = 0;         ///< static casters that cover a texel centre of a map
    uint64_t hidden = 0;        ///< of these, left out
    uint64_t wronglyHidden = 0;  ///< of these, nearest the sun at a texel centre of the map of all static casters
    uint64_t rays = 0;          ///< shot, or texel centres asked about
    uint64_t triangles = 0;     ///< left to draw: statics and movers
    uint64_t texels = 0, texelsWrong = 0;  ///< of the maps; of these, other than with all casters drawn
    double deepest = 0;         ///< most that one of them is too deep [m]; an emptied one lies at the map's far end
    uint64_t pixels = 0, falseLit = 0, falseShadow = 0;  ///< that face the sun, and are wrong
    double prepareMs = 0;       ///< to build the tree of triangles and find where rays start; measured, as `ms`
    double ms = 0;              ///< to ask

    double aFrame(uint64_t sum) const { return judged == 0 ? 0 : double(sum) / double(judged); }
    double aFrame(double sum) const { return judged == 0 ? 0 : sum / double(judged); }
    double percent(uint64_t count) const { return pixels == 0 ? 0 : 100 * double(count) / double(pixels); }
    friend bool operator==(const OcclusionRecord&, const OcclusionRecord&) = default;
};

/// Draws the maps of `method` in all judged frames, whole, whatever it keeps: first with all casters, then without those
/// that 1, 4, 16 and 64 rays of each, and then a proof, call hidden; at last without all clusters that are proven hidden,
/// of whichever caster. One record each, in this order. Movers are always drawn, and
/// hide nothing. All but times is the same for any number of threads.
///   method   one whose maps lie square on a lattice: around the eye, snapped
///   onFrame  after each judged frame: frames done, of how many
/// Errors of the GPU, and as of culling::CasterRays.
world::Result<std::vector<OcclusionRecord>> studyOcclusion(const Setting& setting, std::span<const world::Pose> poses,
                                                           std::span<const TruthPair> truth,
                                                           const culling::ShadowMethod& method,
                                                           const std::function<void(size_t, size_t)>& onFrame);

/// The table that is printed, all ways of a run, with line ends.
std::string occlusionTable(std::span<const OcclusionRecord> records);

}  // namespace tools::lab
