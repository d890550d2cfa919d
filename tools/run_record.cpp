#include "tools/run_record.h"

#include <tbb/global_control.h>

#include <ctime>
#include <filesystem>
#include <utility>

#include "tools/input_hash.h"
#include "tools/machine.h"
#include "world/hash.h"
#include "world/program.h"

namespace tools {

uint64_t RunRecord::key() const {
    uint64_t key = world::hashValues(std::span(&chunkSize, 1), 0);
    for (const std::string* text : {&kind, &name, &worldHash, &pathHash, &moversHash, &settings, &device, &driver, &machine, &program})
        key = hashText(*text, key);
    const int64_t counts[] = {threads, int64_t(frames)};
    return world::hashValues(std::span<const int64_t>(counts), key);
}

const RunRecord& RunRecord::ended() {
    wallSeconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
    return *this;
}

world::Result<RunRecord> beginRecord(std::string kind, const world::WorldStore& store, const std::string& worldFile,
                                     const gpu::Device& device) {
    const auto hash = store.contentHash();
    if (!hash) return hash.error();
    RunRecord record;
    record.kind = std::move(kind);
    record.world = std::filesystem::path(worldFile).filename().string();
    record.worldHash = hexOf(hash.value());
    record.source = store.header().source;
    record.chunkSize = store.header().chunkSize;
    record.device = device.name();
    record.driver = device.driver();
    record.machine = processor();
    record.threads = int(tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism));
    record.program = hexOf(world::hashProgram());
    char text[32];
    const std::time_t now = std::time(nullptr);
    std::tm utc{};
    gmtime_r(&now, &utc);
    std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &utc);
    record.started = text;
    record.begun = std::chrono::steady_clock::now();
    return record;
}

void endRecord(RunRecord& record, const ReplayHead& head, const Summary& summary) {
    record.settings = settingsJson(head);
    record.frames = summary.frames;
    record.summary = toJson(head, summary);
    record.ended();
}

}  // namespace tools
