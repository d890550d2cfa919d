// tools/method_file.h — a shadow method as a configuration file, TOML: the name of a method and its settings.
#pragma once

#include <string>

#include "culling/shadow_method.h"
#include "server/shadow_system.h"
#include "world/result.h"

namespace tools {

/// `method = "gnomon"` and a table `[settings]` of what differs from the method of that name, by the names of
/// culling/method_settings.h. kNotFound, and kUsage that names file, place and remedy: what is no TOML, an unknown key, a
/// value that is none, and errors of `methodNamed` and `requireMethod`. The method is called as the file.
world::Result<culling::ShadowMethod> readMethod(const std::string& path);

/// The text of such a file, with all settings; `comment` goes before them, line by line.
///   base  name of the method that it is a variant of
std::string methodFileText(const culling::ShadowMethod& method, const std::string& base, const std::string& comment);

/// What the settings of a cached method are for a ShadowSystem; the rest of `config` stays. kUsage for a method that
/// keeps no cache.
world::Result<world::Done> apply(const culling::ShadowMethod& method, server::ShadowConfig& config);

/// A name, a name with settings ("gnomon:side=2048"), or a file, whose name ends with ".toml".
world::Result<culling::ShadowMethod> methodFromWord(const std::string& word);

}  // namespace tools
