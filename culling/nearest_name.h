// culling/nearest_name.h — what somebody who mistyped a name may have meant.
#pragma once

#include <span>
#include <string>

namespace culling {

/// The first of those that take the fewest characters to insert, drop or replace. `names` is not empty.
/// Source: Wagner & Fischer, "The String-to-String Correction Problem", 1974.
const std::string& nearestName(const std::string& name, std::span<const std::string> names);

}  // namespace culling
