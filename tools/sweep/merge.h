// tools/sweep/merge.h — results of shards as runs of one results file, each shard once, however often it ran.
#pragma once

#include <cstddef>
#include <functional>
#include <string>

#include "tools/sweep/folder.h"
#include "world/result.h"

namespace tools::sweep {

struct Merged {
    size_t there = 0;  ///< shards that the file holds now
    size_t added = 0;  ///< of them, by this call
};

/// Adds all shards that are done to `file`, in their order and each in a transaction of its own; the file is made where
/// there is none. A shard that it holds already is compared and not added. kBadData, which names shard, table, frame, column
/// and both values, if results of a shard differ in anything that is not measured; both files stay then. kBadData for a
/// file that is damaged; errors of ResultsStore.
world::Result<Merged> merge(const Sweep& sweep, const std::string& file, const std::function<void(size_t done, size_t total)>& follow);

}  // namespace tools::sweep
