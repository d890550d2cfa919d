// tools/report/run_file.h — a run in a results file: what was run, and its frames one after the other.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "cache/statistics.h"
#include "tools/dump.h"
#include "tools/results_columns.h"
#include "tools/run_record.h"
#include "world/database.h"

namespace tools::report {

/// A chunk or mesh that was read; measured but for what and how much.
struct ReadRow {
    std::string name;
    uint64_t bytes = 0;  ///< decoded
    uint64_t thread = 0;
    double beginMs = 0, ms = 0;  ///< by the clock of t_frame_begin_ms
};

/// All that is kept of a frame. Numbers stand in the order of ResultColumns, NaN where there is none, or a text.
struct FrameRow {
    struct Cascade {
        std::vector<double> values;
        std::vector<std::string> texts;  ///< of the text columns, in their order
        std::array<cache::Cost, cache::kCauses> byCause{};
    };
    uint64_t number = 0;
    glm::dvec3 eye{0};  ///< [m]
    std::vector<double> values;
    std::vector<std::string> texts;
    std::vector<Cascade> cascades;
    std::vector<server::CasterCost> dearest;
    std::vector<ReadRow> reads;  ///< that ended since the last frame
};

class RunFile;

/// Frames of a run, ascending. Must not outlive its file.
class FrameCursor {
public:
    /// False at the end. Errors name the file. `row` is overwritten and keeps its memory.
    world::Result<bool> next(FrameRow& row);

private:
    friend class RunFile;
    struct Rows {
        world::Statement statement;
        bool there = false;  ///< on a row that was not taken yet
    };
    FrameCursor(const RunFile& file, Rows frames, Rows cascades, Rows causes, Rows casters, Rows reads)
        : file_(file), frames_(std::move(frames)), cascades_(std::move(cascades)), causes_(std::move(causes)), casters_(std::move(casters)), reads_(std::move(reads)) {}
    void takeCells(world::Statement& statement, int at, const std::vector<ResultColumn>& columns, std::vector<double>& values,
                   std::vector<std::string>& texts);
    const RunFile& file_;
    Rows frames_, cascades_, causes_, casters_, reads_;
};

/// What the lab found of a method: shares in percent of the pixels that face the sun, costs as means of a frame.
struct MethodFigures {
    std::string name;
    uint64_t frames = 0, judged = 0;
    double triangles = 0, texels = 0, draws = 0;
    double falseLit = 0, falseShadow = 0;  ///< [%]
    double flips = 0;                      ///< per million point-frames
    double ms = 0, shadingMs = 0;          ///< medians; measured
};

/// One thread at a time.
class RunFile {
public:
    /// "FILE" for its newest run, "FILE#NUMBER" for another. kNotFound for a run that is not there, naming those that are;
    /// else as openResults.
    static world::Result<RunFile> open(const std::string& word);

    const std::string& name() const { return name_; }  ///< "FILE#NUMBER"
    const RunRecord& record() const { return record_; }
    const ResultColumns& columns() const { return columns_; }
    world::Result<FrameCursor> frames();
    world::Result<std::vector<DumpedPicture>> pictures();
    world::Result<std::vector<MethodFigures>> methods();
    /// What each static caster cost over all frames, by name and place.
    world::Result<std::vector<server::CasterCost>> casterSums();
    /// The runs of the file that repeat this one, itself among them, as words for `open`.
    world::Result<std::vector<std::string>> repetitions();

private:
    friend class FrameCursor;
    RunFile(std::string file, int64_t number, world::Database database)
        : file_(std::move(file)), number_(number), name_(file_ + "#" + std::to_string(number)), database_(std::move(database)),
          columns_(resultColumns()) {}
    world::Result<world::Done> readRecord();
    world::Result<FrameCursor::Rows> rowsOf(const std::string& columns, const std::string& table, const std::string& order);
    world::Error told(world::Error error) const;
    std::string file_;
    int64_t number_;
    std::string name_;
    world::Database database_;
    ResultColumns columns_;
    RunRecord record_;
};

}  // namespace tools::report
