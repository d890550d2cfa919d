#include "tools/bench_streaming.h"

#include <atomic>
#include <chrono>
#include <cstdio>
#include <limits>
#include <mutex>
#include <optional>
#include <thread>

#include "server/stopwatch.h"
#include "tools/summary.h"
#include "world/streamer.h"

namespace tools {
namespace {

using world::Done;
using world::Error;
using world::Result;

constexpr double kShare = 0.7;

/// Reads all rows on the streamer's number of threads and forgets them.
Result<double> bare(const world::WorldStore& store) {
    const server::Stopwatch stopwatch;
    const size_t meshes = store.meshes().size(), all = meshes + store.chunks().size();
    std::atomic<size_t> next = 0;
    std::mutex mutex;
    std::optional<Error> error;
    {
        std::vector<std::jthread> threads;
        for (int t = 0; t < world::kReaders; ++t)
            threads.emplace_back([&] {
                for (size_t i = next++; i < all; i = next++) {
                    std::optional<Error> failed;
                    if (i < meshes) {
                        if (const auto mesh = store.readMesh(uint32_t(i)); !mesh) failed = mesh.error();
                    } else if (const auto chunk = store.readChunk(store.chunks()[i - meshes].key); !chunk) {
                        failed = chunk.error();
                    }
                    if (!failed) continue;
                    const std::lock_guard lock(mutex);
                    error = failed;
                }
            });
    }
    if (error) return *error;
    return stopwatch.ms();
}

Result<double> streamed(const world::WorldStore& store, StreamingCost& cost) {
    constexpr uint64_t kAny = std::numeric_limits<uint64_t>::max() / 4;
    const server::Stopwatch stopwatch;
    world::Streamer streamer(store, {.memoryBytes = kAny, .geometryBytes = kAny, .handOutBytes = kAny,
                                     .clock = world::Clock::kLive, .disk = {}});
    streamer.want([](const world::Box&) { return std::optional(world::Want{}); }, 0);
    cost.bytes = 0;
    do {
        cost.bytes += streamer.advance(stopwatch.ms() / 1e3).bytesRead;
        std::this_thread::sleep_for(std::chrono::milliseconds(1));  // a frame has other work
    } while (!streamer.settled());
    const double ms = stopwatch.ms();
    if (!streamer.lacking().empty())
        return Error{world::ErrorCode::kBadData, store.path() + ": " + std::to_string(streamer.lacking().size()) +
                                                     " chunks cannot be read; 'gnomon info --check' names them"};
    return ms;
}

}  // namespace

Result<StreamingCost> measureStreaming(const world::WorldStore& store, int rounds) {
    StreamingCost cost;
    cost.chunks = store.chunks().size();
    cost.meshes = store.meshes().size();
    for (int round = 0; round <= rounds; ++round) {
        const auto alone = bare(store);
        if (!alone) return alone.error();
        const auto ms = streamed(store, cost);
        if (!ms) return ms.error();
        if (round == 0) continue;  // the file was not in the system's cache yet
        cost.bareMs.push_back(alone.value());
        cost.streamerMs.push_back(ms.value());
    }
    return cost;
}

std::string streamingText(const StreamingCost& cost) {
    char text[400];
    const double megabytes = double(cost.bytes) / 1e6;
    std::snprintf(text, sizeof text,
                  "%zu chunks and %zu meshes, %.1f MB decoded, %d threads, median of %zu\n"
                  "bare loop of read, verify and decode  %8.1f ms  %7.1f MB/s\n"
                  "streamer, coarse levels first         %8.1f ms  %7.1f MB/s\n",
                  cost.chunks, cost.meshes, megabytes, world::kReaders, cost.bareMs.size(), median(cost.bareMs),
                  1e3 * megabytes / median(cost.bareMs), median(cost.streamerMs), 1e3 * megabytes / median(cost.streamerMs));
    return text;
}

Goal streamingGoal(const StreamingCost& cost) {
    const double share = median(cost.bareMs) / median(cost.streamerMs);
    char measured[40];
    std::snprintf(measured, sizeof measured, "%.2f", share);
    return {"streaming: at least 0.7 of the bare loop", measured, share >= kShare};
}

}  // namespace tools
