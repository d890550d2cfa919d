// tools/results_store.h — one SQLite file that runs are added to: what was run, and a row for each frame, cascade, cause,
// dear caster and read. docs/results.md has every table and column.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "tools/dump.h"
#include "tools/lab/record.h"
#include "tools/replay.h"
#include "tools/results_columns.h"
#include "tools/run_record.h"
#include "world/database.h"
#include "world/result.h"

namespace tools {

constexpr int64_t kResultsId = 0x47524553;  ///< "GRES" in the file's header
constexpr int64_t kResultsVersion = 2;

/// A report of 100,000 frames holds a file for several seconds, and a run that took an hour can wait for it.
constexpr int kResultsPatienceMs = 30000;

/// Casters that are kept of a frame: those that cost it the most triangles. Of all casters sums are kept.
constexpr size_t kDearest = 8;

/// Adds runs to a file, each whole or not at all: until `commit` a run's rows lie in a temporary file that goes away with
/// the process, however that ends. Memory is bounded, however long the run. Several processes may add to one file; each
/// waits for the others' commits. One thread at a time.
class ResultsStore {
public:
    /// Makes the file where there is none. kBadData for a file that is something else, damaged, or of another version;
    /// kIo for one that is locked, cannot be written or has no room.
    static world::Result<ResultsStore> open(const std::string& file);

    /// How long `commit` waits for others: kResultsPatienceMs to begin with.
    void waitAtMost(int ms) { database_.waitAtMost(ms); }
    /// Rows of the run under way. kIo where the temporary file has no room.
    world::Result<world::Done> add(const ReplayFrame& frame);
    world::Result<world::Done> add(const DumpedPicture& picture);
    world::Result<world::Done> add(const lab::MethodRecord& method);
    /// Ends the run. Its number in the file, from 1 on. After an error the file is as before.
    world::Result<int64_t> commit(const RunRecord& run);

private:
    struct Inserts {
        world::Statement frame, cascade, cause, caster, sum, read, picture, method;
    };
    ResultsStore(std::string file, world::Database database)
        : file_(std::move(file)), database_(std::move(database)), columns_(resultColumns()) {}
    world::Result<world::Done> stage();
    world::Result<world::Done> write(const ReplayFrame& frame);
    world::Result<int64_t> move(const RunRecord& run);
    world::Error told(world::Error error) const;

    std::string file_;
    world::Database database_;
    ResultColumns columns_;
    std::optional<Inserts> inserts_;
    uint64_t methods_ = 0;  ///< of the run under way
    size_t pending_ = 0;  ///< frames since the temporary tables' last commit
};

/// Opens a results file to read it; errors as above, kNotFound for one that is not there.
world::Result<world::Database> openResults(const std::string& file);

/// Columns of `run` in their order, but for `id` and `key`, written and read by the same list.
template <class Record, class Visit>
void eachRunColumn(Record& r, Visit visit) {
    visit(r.kind);
    visit(r.name);
    visit(r.verdict);
    visit(r.world);
    visit(r.worldHash);
    visit(r.source);
    visit(r.chunkSize);
    visit(r.path);
    visit(r.pathHash);
    visit(r.movers);
    visit(r.moversHash);
    visit(r.settings);
    visit(r.frames);
    visit(r.device);
    visit(r.driver);
    visit(r.machine);
    visit(r.threads);
    visit(r.program);
    visit(r.summary);
    visit(r.started);
    visit(r.wallSeconds);
}

}  // namespace tools
