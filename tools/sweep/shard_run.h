// tools/sweep/shard_run.h — one shard, in this process: whoever runs it, a parent on this machine, Slurm or Kubernetes.
#pragma once

#include <cstddef>

#include "tools/sweep/folder.h"
#include "world/result.h"

namespace tools::sweep {

/// Runs shard `index` unless its results are there. What it says goes to its log. An error is also left in the folder, for
/// `status`. May run several times at once, on several machines.
///   threads  0: all
world::Result<world::Done> runShard(const Sweep& sweep, size_t index, int threads);

}  // namespace tools::sweep
