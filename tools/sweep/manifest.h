// tools/sweep/manifest.h — a sweep as an Indexed Job of Kubernetes, for those who have that and no Slurm: one shard a
// completion, in the manifest's JSON form.
#pragma once

#include <string>

#include "tools/sweep/folder.h"
#include "world/result.h"

namespace tools::sweep {

struct Cluster {
    std::string image;   ///< that holds this very program, as `gnomon` on its PATH
    std::string claim;   ///< PersistentVolumeClaim, shared by all nodes, that is mounted at `mount`
    std::string mount;   ///< absolute
    int threads = 1;     ///< of a shard, and the CPUs that it asks for
};

/// kUsage if the sweep's folder or one of its inputs is not below the mount, naming it.
world::Result<std::string> manifest(const Sweep& sweep, const Cluster& cluster);

}  // namespace tools::sweep
