// server/worker.h — a process that draws for this one, and is started again whenever it ends.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "world/result.h"

namespace gnomon::worker {
class Reply;
class Request;
}  // namespace gnomon::worker

namespace server {

/// Descriptors as the worker finds them.
constexpr int kWorkerLine = 3;      ///< a socket: requests come, replies go, and its end is the worker's
constexpr int kWorkerInherited = 4;  ///< WorkerConfig::inherited

struct WorkerConfig {
    /// Program and arguments of a start, counted from 1. The program must call `runWorker`.
    std::function<std::vector<std::string>(uint64_t start)> command;
    int inherited = -1;  ///< descriptor that it gets as well; -1: none
};

/// What leads to one start of the worker. One thread at a time.
class WorkerLine {
public:
    WorkerLine(uint64_t start, int socket) : start_(start), socket_(socket) {}
    ~WorkerLine();
    WorkerLine(const WorkerLine&) = delete;
    WorkerLine& operator=(const WorkerLine&) = delete;

    uint64_t start() const { return start_; }
    /// kIo where the worker is dead. An error of the reply is its own to look at.
    ///   descriptor  if given, what came with the reply to a session that shares its maps; else as it was
    world::Result<gnomon::worker::Reply> ask(const gnomon::worker::Request& request, int* descriptor = nullptr);

private:
    const uint64_t start_;
    const int socket_;
};

/// Any thread, but for the destructor.
class Worker {
public:
    /// Starts it and waits until it serves. kIo where it cannot be started, or ends before it serves.
    ///   onEvent  gets a line whenever it ended and is started again; from a thread of the worker's own
    static world::Result<std::unique_ptr<Worker>> start(const WorkerConfig& config, std::function<void(const std::string&)> onEvent);
    /// Lets it end for two seconds, and then kills it. No line may be left.
    ~Worker();
    Worker(const Worker&) = delete;
    Worker& operator=(const Worker&) = delete;

    /// The line to a worker that serves; waits for one half a minute at most. kIo where none does.
    world::Result<std::shared_ptr<WorkerLine>> serving();
    /// A worker that is of no use, if it is still that of this start: it is killed, and the next one started.
    void discard(uint64_t start);
    pid_t pid() const;  ///< 0 between two

private:
    struct Impl;
    explicit Worker(std::unique_ptr<Impl> impl);
    std::unique_ptr<Impl> impl_;
};

}  // namespace server
