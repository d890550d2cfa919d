// tools/lab/record.h — what is kept of a run of the lab and of its methods: all that tables and pages show.
#pragma once

#include <cstddef>
#include <cstdint>
#include <glm/glm.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "culling/method_settings.h"
#include "tools/lab/run.h"

namespace tools::lab {

/// What all methods of a run share.
struct RunRecord {
    uint64_t key = 0;  ///< of all that results follow from, but for the method; names of files are no part of it
    std::string world, path, movers;  ///< files; no movers: empty
    size_t frames = 0, judged = 0;    ///< of the path; of these, judged
    double begins = 0, ends = 0;      ///< times of the first and the last frame [s]
    double farDistance = 0;           ///< [m]
    double verticalFov = 0;           ///< [rad]
    glm::dvec3 sun{0};                ///< direction of light travel, unit
    int width = 0, height = 0;        ///< pixels judged in a frame
    std::string device, driver;
    int threads = 0;
};

/// Files that a run was given, as the user named them.
struct RunFiles {
    std::string world, path, movers;
};

/// Key and description of a run. The key holds the world's content, poses, movers, sun, camera, judged frames and
/// pixels, device, number of threads, and the program itself. Errors of the store.
world::Result<RunRecord> describe(const Setting& setting, const RunFiles& files, std::span<const world::Pose> poses,
                                  std::span<const size_t> judged, const RunConfig& config);

/// A frame of a method's.
struct FrameRecord {
    struct Judged {
        uint64_t pixels = 0, falseLit = 0, falseShadow = 0;
        uint64_t points = 0, flips = 0;  ///< against the frame before; 0 in the first of two
        friend bool operator==(const Judged&, const Judged&) = default;
    };
    size_t frame = 0;  ///< in the path
    uint64_t triangles = 0;
    double ms = 0;
    std::optional<Judged> judged;  ///< none for a frame that was drawn only
    friend bool operator==(const FrameRecord&, const FrameRecord&) = default;
};

/// What came out for a method. Sums are over `frames` drawn or `judged` ones; see Measures.
struct MethodRecord {
    std::string name;
    std::vector<culling::MethodSetting> fields;
    size_t frames = 0;
    cache::Cost cost;
    double ms = 0;  ///< median over the frames; not deterministic
    double shadingMs = 0;  ///< of the GPU's deferred pass over a screen, median over judged pairs; not deterministic
    size_t judged = 0;
    uint64_t pixels = 0;
    Wrong falseLit, falseShadow;
    double difference = 0, softDifference = 0;
    uint64_t unanswered = 0, points = 0, flips = 0;
    double ratio50 = 0, ratio99 = 0;  ///< quantiles of texels per pixel
    double usedShare = 0;
    size_t worstFrame = 0;  ///< in the path
    uint64_t worstWrong = 0;
    std::vector<std::byte> picture;  ///< of that frame, PNG
    std::vector<FrameRecord> series;  ///< ascending

    double aFrame(uint64_t sum) const { return frames == 0 ? 0 : double(sum) / double(frames); }
    double percent(uint64_t count) const { return pixels == 0 ? 0 : 100 * double(count) / double(pixels); }
    double meanDifference() const { return pixels == 0 ? 0 : difference / double(pixels); }
    double meanSoftDifference() const { return pixels == 0 ? 0 : softDifference / double(pixels); }
    double flipsPerMillion() const { return points == 0 ? 0 : 1e6 * double(flips) / double(points); }
    double usedPercent() const { return judged == 0 ? 0 : 100 * usedShare / double(judged); }
};

/// kLimit where the picture cannot be encoded.
world::Result<MethodRecord> recordOf(const MethodResult& result);

/// A claim of the failure suite, and what came of it.
struct ClaimRecord {
    std::string situation, what;  ///< the case, and a line on it
    std::string method, measure;  ///< who was run there, with deliberate defects; with its unit
    std::string why;              ///< where the limit comes from
    std::string verdict;
    double value = 0, limit = 0;  ///< in the measure's unit
    bool fails = false;  ///< it must reach the limit; else it must not pass it
    bool wrong = false;  ///< the verdict is
    friend bool operator==(const ClaimRecord&, const ClaimRecord&) = default;
};

/// Key of a method in a run. Names are part of it, as are all fields.
uint64_t methodKey(const RunRecord& run, const culling::ShadowMethod& method);

/// The table that is printed: its head, and a line for each method, without line ends.
std::string tableHead();
std::string tableRow(const MethodRecord& record);

}  // namespace tools::lab
