// world/reads.h — rows read and decoded off the frame's thread, by one of three clocks.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "world/chunk.h"
#include "world/result.h"
#include "world/store.h"

namespace world {

enum class Clock : uint8_t {
    kLockStep,  ///< whoever asks waits: everything that is asked for is there in the same step
    kVirtual,   ///< a model of a disk says when a read ends: late, and the same in every run
    kLive,      ///< threads of their own read as fast as they can
};

/// Threads of the live clock. Decoding is what takes time; more would take the frame's cores.
constexpr int kReaders = 2;

/// The virtual disk. A read waits for a free channel, then takes a latency and its bytes' time.
struct DiskModel {
    uint64_t seed = 1;
    double latency = 0.004;    ///< median [s]: a network disk or a slow SSD
    double spread = 0.5;       ///< of the latency's logarithm: log-normal
    double bandwidth = 200e6;  ///< decoded bytes a second, for all channels together
    int channels = 4;          ///< reads at once
    double stallShare = 0;     ///< reads that stall
    double stallSeconds = 0;
    double failShare = 0;      ///< reads that fail this time (kIo)
    double corruptShare = 0;   ///< chunks whose rows are always refused (kBadData)
};

/// kUsage names the number that is out of range.
Result<Done> requireDisk(const DiskModel& disk);

/// A chunk's rows, or a mesh's.
struct ReadRequest {
    std::optional<uint32_t> mesh;       ///< id; else a chunk is read
    uint32_t record = 0;                ///< of the chunk, in WorldStore::chunks
    size_t firstLevel = 0;              ///< finest level of its terrain that is wanted
    std::shared_ptr<const Chunk> base;  ///< what is there already, or null
    uint64_t bytes = 0;                 ///< decoded, that must be read
};

/// When a thread read and decoded; measured.
struct ReadTimes {
    int thread = 0;  ///< of those that read, from 0
    std::chrono::steady_clock::time_point begin, end;
};

struct FinishedRead {
    ReadRequest request;
    ReadTimes times;  ///< `begin` is `end` where nothing was read
    std::shared_ptr<const Chunk> chunk;  ///< null for a mesh, and where there is an error
    std::unique_ptr<const Mesh> mesh;
    std::optional<Error> error;
};

/// One thread at a time may ask and collect.
class Reads {
public:
    virtual ~Reads() = default;
    virtual void ask(ReadRequest request, double now) = 0;
    /// Appends what has ended by `now` [s], ascending from call to call. Lock-step and virtual clock: in an order that
    /// depends on the requests alone.
    virtual void collect(double now, std::vector<FinishedRead>& finished) = 0;
    /// Asked for and not collected.
    virtual size_t underWay() const = 0;
};

/// `store` must outlive the reads. `disk` is the virtual clock's.
std::unique_ptr<Reads> makeReads(Clock clock, const WorldStore& store, const DiskModel& disk);

}  // namespace world
