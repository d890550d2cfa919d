// tools/lab/method_fields.h — all that a shadow method is, value by value, for people and for keys.
#pragma once

#include <string>
#include <vector>

#include "culling/shadow_method.h"

namespace tools::lab {

/// One of a method's values.
struct MethodField {
    std::string name;   ///< "receiver bias"
    std::string value;  ///< a word, or a number that reads back as the same double
    std::string unit;   ///< empty for words and for plain numbers
    friend bool operator==(const MethodField&, const MethodField&) = default;
};

/// Every member of the method but its name, always the same ones in the same order: methods are the same if all fields
/// are.
std::vector<MethodField> fieldsOf(const culling::ShadowMethod& method);

}  // namespace tools::lab
