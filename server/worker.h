// server/worker.h — a process that draws for this one, and is started again whenever it ends.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "world/result.h"

namespace server {

struct WorkerConfig {
    /// Program and arguments of a start, counted from 1. The program must serve at `address`, and end when its standard
    /// input does: so it outlives nobody.
    std::function<std::vector<std::string>(uint64_t start)> command;
    std::string address;  ///< as `Client::connect` takes it
    int inherited = -1;   ///< descriptor that the program gets as number 3; -1: none
};

/// Any thread, but for the destructor.
class Worker {
public:
    /// Starts it and waits until it serves. kIo where it cannot be started, or ends before it serves.
    ///   onEvent  gets a line whenever it ended and was started again; from a thread of the worker's own
    static world::Result<std::unique_ptr<Worker>> start(const WorkerConfig& config, std::function<void(const std::string&)> onEvent);
    /// Lets it end for a second, and then kills it.
    ~Worker();
    Worker(const Worker&) = delete;
    Worker& operator=(const Worker&) = delete;

    /// Waits until a worker serves, at most half a minute: which start that is. kIo where none does.
    world::Result<uint64_t> serving();
    /// A worker that is of no use, if it is still that of this start: it is killed, and the next one started.
    void discard(uint64_t start);
    pid_t pid() const;  ///< 0 between two

private:
    struct Impl;
    explicit Worker(std::unique_ptr<Impl> impl);
    std::unique_ptr<Impl> impl_;
};

}  // namespace server
