// tools/sweep/workers.h — shards on this machine, as many processes at once as there are cores: a shard that crashes takes
// no other along.
#pragma once

#include <cstddef>
#include <vector>

#include "tools/sweep/folder.h"
#include "world/result.h"

namespace tools::sweep {

/// Runs the shards of the given numbers, each in a child that is this same program. A child that ends with an error or by a
/// signal is said on stderr and left in the folder as failed; the others go on. SIGINT and SIGTERM end the children.
/// The process must have no thread but this one.
///   jobs  at a time; 0: a core each
/// False if it was ended so.
world::Result<bool> runHere(const Sweep& sweep, const std::vector<size_t>& shards, int jobs);

}  // namespace tools::sweep
