// tools/run_record.h — what a results file says of a run as a whole: what was run on what, so that runs can be told
// apart, compared, and known as repetitions of each other.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>

#include "gpu/device.h"
#include "tools/summary.h"
#include "world/store.h"

namespace tools {

struct RunRecord {
    std::string kind;     ///< "replay", "stress", "lab" or "soak"
    std::string name;     ///< of a case of stress; else empty
    std::string verdict;  ///< "pass", or what went wrong; empty where nothing was judged
    std::string world, worldHash, source;  ///< as ReplayHead
    double chunkSize = 0;                  ///< of the world [m]
    std::string path, movers;              ///< file names; empty where there is none
    std::string pathHash, moversHash;      ///< of what was played of them, hex; empty where there is none
    std::string settings;                  ///< JSON object: name to value
    uint64_t frames = 0;
    std::string device, driver, machine;   ///< machine: the processor
    int threads = 0;
    std::string program;                   ///< hash of the program that ran, hex
    std::string summary;                   ///< JSON, as in summary.json or what the command prints
    std::string started;                   ///< UTC, "2026-01-31T12:00:00Z"
    double wallSeconds = 0;                ///< from the start to the last frame
    std::chrono::steady_clock::time_point begun{};  ///< of this process; not kept

    /// Hash of all that the deterministic results follow from, and of device, driver, machine and threads, on which
    /// times depend: runs of the same key are repetitions. Names of files are no part of it.
    uint64_t key() const;
    /// Ends now; the record itself.
    const RunRecord& ended();
};

/// World, machine, program and the moment at which the run starts: now. Errors of the store.
world::Result<RunRecord> beginRecord(std::string kind, const world::WorldStore& store, const std::string& worldFile,
                                     const gpu::Device& device);
/// Fills in what the last frame brings: settings, frames, summary and time.
void endRecord(RunRecord& record, const ReplayHead& head, const Summary& summary);

}  // namespace tools
