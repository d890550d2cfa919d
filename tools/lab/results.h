// tools/lab/results.h — a folder of results: lab.sqlite, which outlives interrupted runs, and the page made from it.
// docs/lab.md has every table and column.
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "tools/lab/occlusion.h"
#include "tools/lab/record.h"
#include "world/database.h"
#include "world/result.h"

namespace tools::lab {

/// A method is there whole or not at all: what a killed process had not ended is not there. Several processes may
/// share a folder; each waits for the others' writes. One thread at a time.
class Results {
public:
    /// Makes nothing: a folder that is not there holds no results. kBadData for a lab.sqlite that is something else,
    /// kIo.
    static world::Result<Results> open(const std::string& folder);

    /// A method's row, by `methodKey`; none where it has not been run.
    world::Result<std::optional<MethodRecord>> find(uint64_t method);
    /// Those of the run, by name.
    world::Result<std::vector<MethodRecord>> methodsOf(const RunRecord& run);
    /// Makes folder and file where they are missing, and writes both in one transaction. Replaces what is there of the same
    /// keys.
    world::Result<world::Done> save(const RunRecord& run, uint64_t method, const MethodRecord& record);
    /// What leaving casters out as hidden came to in the run, in the order in which it was saved; none where that is not known.
    world::Result<std::vector<OcclusionRecord>> occlusionOf(const RunRecord& run);
    /// As `save`, all of a run's at once.
    world::Result<world::Done> saveOcclusion(const RunRecord& run, std::span<const OcclusionRecord> records);
    /// What the failure suite came to when it was played with the run, in its order; none where it was not.
    world::Result<std::vector<ClaimRecord>> claimsOf(const RunRecord& run);
    /// As `saveOcclusion`.
    world::Result<world::Done> saveClaims(const RunRecord& run, std::span<const ClaimRecord> records);
    /// Writes lab.html, whole or not at all, with all that is there of the run. Its path.
    world::Result<std::string> writePage(const RunRecord& run);

private:
    explicit Results(std::string folder) : folder_(std::move(folder)) {}
    world::Result<world::Done> connect();
    template <class Record, class Each>
    world::Result<std::vector<Record>> readAll(const char* sql, const RunRecord& run, Each each);
    template <class Record, class Each>
    world::Result<world::Done> replaceAll(const char* clear, const char* add, const RunRecord& run,
                                          std::span<const Record> records, Each each);
    world::Result<world::Done> inTransaction(const std::function<world::Result<world::Done>()>& write);
    world::Result<world::Done> write(const RunRecord& run);
    world::Result<world::Done> write(const RunRecord& run, uint64_t method, const MethodRecord& record);
    world::Result<std::vector<MethodRecord>> read(const char* condition, uint64_t key);
    std::string folder_;
    std::optional<world::Database> database_;  ///< none: there is no file
};

}  // namespace tools::lab
