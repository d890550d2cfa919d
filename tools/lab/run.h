// tools/lab/run.h — methods judged one after the other over the same frames of a path.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "tools/image.h"
#include "tools/lab/engine.h"
#include "tools/lab/measures.h"
#include "tools/truth_store.h"

namespace tools::lab {

struct RunConfig {
    std::vector<culling::ShadowMethod> methods;
    uint64_t every = 0;  ///< truth every so many frames, and in the frame after; 0: some sixteen times
    int width = 320, height = 180;  ///< pixels that are judged
    double sunRadius = 0;  ///< of the sun's disk [rad], for Measures::softDifference; 0: the disk is not traced
};

/// What the sun's disk is from the earth [rad].
constexpr double kSunRadius = 0.00465;

/// One judged frame of a method.
struct JudgedFrame {
    size_t frame = 0;  ///< in the path
    FrameCost cost;
    Measures measures;
};

/// The judged frame with the most wrong pixels; of several the first.
struct WorstFrame {
    size_t frame = 0;  ///< in the path
    uint64_t wrong = 0;  ///< pixels
    RgbImage picture;    ///< see `wrongPicture`
};

struct MethodResult {
    culling::ShadowMethod method;
    size_t frames = 0;  ///< drawn: all of the path's, or the judged ones of a method that remembers nothing
    cache::Cost cost;   ///< summed over them
    std::vector<size_t> drawn;        ///< numbers of these frames in the path, ascending
    std::vector<uint64_t> triangles;  ///< by frame, in order
    std::vector<double> ms;           ///< likewise
    std::vector<double> shadingMs;    ///< of the first frame of each judged pair; see ShadingTime; empty if not timed
    Measures measures;                ///< summed over the judged frames
    std::vector<JudgedFrame> judged;
    WorstFrame worst;
};

/// Two frames that follow each other, and what of the first is still to be seen in the second.
struct TruthPair {
    size_t frame = 0;  ///< of the first, in the path; the second is the next
    culling::TruthFrame first, second;
    Asked askedFirst, askedSecond;
    std::vector<culling::Sunlight> again;  ///< per point of `askedFirst`
};

/// Frames in which a truth is asked for: the first of each pair, ascending. Pairs do not overlap: an `every` of 1 is taken
/// for 2, which judges every frame, and there is at least one. `poses` is at least 2.
std::vector<size_t> judgedFrames(size_t poses, uint64_t every);

/// The truth of the frames: what `store` has of it, and the rest traced, and stored. kUsage where no pixel of any of
/// them faces the sun.
///   onFrame  after each pair: pairs done, of how many
world::Result<std::vector<TruthPair>> traceTruth(const Setting& setting, std::span<const world::Pose> poses,
                                                 std::span<const size_t> frames, const RunConfig& config, TruthStore& store,
                                                 const std::function<void(size_t, size_t)>& onFrame);

/// Runs one method over the poses.
///   onFrame  after each frame: frames done, of how many
world::Result<MethodResult> judgeMethod(const Setting& setting, std::span<const world::Pose> poses,
                                        std::span<const TruthPair> truth, const culling::ShadowMethod& method,
                                        const std::function<void(size_t, size_t)>& onFrame);

}  // namespace tools::lab
