// server/worker_host.h — sessions drawn by a worker: when it dies or its device is lost, the next one gets each session's
// recorded requests again and goes on where the other one was.
// Source: Gray & Reuter, "Transaction Processing: Concepts and Techniques", 1993 (recovery by repeating a log).
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "server/session_host.h"
#include "server/worker.h"

namespace server {

/// Each session needs a recording. One thing at a time is asked of the worker, in turns, so that it is known what it died
/// of: a frame that three died of ends its session. A worker that takes five minutes for a frame is hung, and discarded.
///   worker   outlives the host
///   onEvent  a session, by its number, and what it had to go through; any thread
std::unique_ptr<SessionHost> makeWorkerHost(Worker& worker, std::function<void(uint64_t session, const std::string& what)> onEvent);

}  // namespace server
