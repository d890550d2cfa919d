// server/metrics.h — what all sessions together came to, as Prometheus reads it.
// Source: Prometheus, "Exposition formats", text format 0.0.4.
#pragma once

#include <string>

#include "server/live_board.h"

namespace server {

/// Every family with its HELP and TYPE; counters only grow while the process lives. The same text for the same totals.
///   processBytes  memory of the process that is in RAM
std::string metricsText(const LiveTotals& totals, bool ready, uint64_t processBytes);

/// Of this process, by /proc; 0 where that cannot be read.
uint64_t processResidentBytes();

}  // namespace server
