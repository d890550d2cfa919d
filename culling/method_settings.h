// culling/method_settings.h — the values of a shadow method by name, as text: what command lines, configuration
// files and reports say of it.
#pragma once

#include <string>
#include <vector>

#include "culling/shadow_method.h"
#include "world/result.h"

namespace culling {

struct MethodSetting {
    std::string name, value;  ///< "filter", "box3"
    std::string unit{};       ///< empty for words and plain numbers
    friend bool operator==(const MethodSetting&, const MethodSetting&) = default;
};

/// All of a method's but its name, always in the same order; numbers so that they read back to the last bit.
std::vector<MethodSetting> settingsOf(const ShadowMethod& method);

/// Sets one. kUsage for a name that there is not, with the nearest, and for a value that is none.
world::Result<world::Done> set(ShadowMethod& method, const std::string& name, const std::string& value);

/// "gnomon", or a named method with other settings: "gnomon:filter=box3:side=2048", which is then its name. kUsage as of
/// `methodNamed`, `set` and `requireMethod`.
world::Result<ShadowMethod> methodFrom(const std::string& text);

}  // namespace culling
