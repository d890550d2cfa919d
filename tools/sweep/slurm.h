// tools/sweep/slurm.h — shards as tasks of Slurm's job arrays: Slurm decides what runs where and when, and what runs again.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "tools/sweep/folder.h"
#include "world/result.h"

namespace tools::sweep {

/// Tasks of an array: Slurm's own limit, MaxArraySize, is 1001 unless a site raises it.
constexpr size_t kArray = 1000;

/// Hands the shards of these numbers to sbatch, ascending, one array for each thousand of the sweep; what could not be launched
/// before leaves the queue. What was submitted is in the folder even if a later array is refused. kNotFound without sbatch;
/// kIo with what it said. Gives the jobs' ids.
world::Result<std::vector<std::string>> submit(const Sweep& sweep, const std::vector<size_t>& shards);

/// What Slurm will run or is running of the sweep; nothing where nothing was submitted. A task that could not be launched is
/// not in it: Slurm puts it back and holds it until somebody sees to it. kNotFound without squeue, kIo if the
/// controller does not answer: nobody can then tell lost from queued. To be asked before `Sweep::status`: what ends in
/// between is then not taken for lost.
world::Result<Queue> askQueue(const Sweep& sweep);

/// Numbers as sbatch wants them, ascending: "0-3,7".
std::string ranges(const std::vector<size_t>& numbers);

}  // namespace tools::sweep
