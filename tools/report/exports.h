// tools/report/exports.h — a run for other programs: its rows as CSV, its distributions in the shape of Google Benchmark's
// JSON, its times as a timeline.
// Source: Google, "Trace Event Format" (slices of the timeline); Google Benchmark's --benchmark_format=json.
#pragma once

#include <functional>
#include <iosfwd>
#include <string>

#include "tools/report/run_file.h"

namespace tools::report {

/// Frames done, of how many.
using Follow = std::function<void(size_t, size_t)>;

/// The rows of frames.csv as the replay wrote them.
world::Result<world::Done> writeCsv(RunFile& run, std::ostream& out, const Follow& follow);

/// One "benchmark" for each time that frames have, its percentiles as counters beside those of the deterministic columns
/// that tell what was drawn.
world::Result<std::string> benchmarkJson(RunFile& run, const Follow& follow);

/// Gzipped JSON for Perfetto: slices that nest strictly. Frames stand one after the other, as long as they took; within each
/// the stages of the CPU one after the other, and on a track of its own the GPU's passes. Chunks and memory are counters.
/// kIo names the file.
world::Result<world::Done> writeTimeline(RunFile& run, const std::string& path, const Follow& follow);

}  // namespace tools::report
