// tools/sweep/agreement.h — whether two runs, in two results files, are the same in all that is not measured.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "world/database.h"
#include "world/result.h"

namespace tools::sweep {

struct RunPlace {
    world::Database& database;
    int64_t run = 0;
    std::string name;  ///< for errors: the file
};

/// The first difference: "table cascade, frame 7, cascade 1: static_texels is 5 in A and 6 in B"; none if there is none.
/// Values are compared to the last bit. Device, driver, machine, threads and summary may differ.
world::Result<std::optional<std::string>> difference(const RunPlace& a, const RunPlace& b);

}  // namespace tools::sweep
