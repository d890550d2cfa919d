// server/world_folder.h — the worlds that a service may open: the files NAME.world of one folder, and nothing else.
#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "world/result.h"
#include "world/store.h"

namespace server {

/// A world that is open, and the hash of what it holds.
struct OpenedWorld {
    std::string name;
    world::WorldStore store;
    uint64_t content = 0;
};

/// Opens each world once, and keeps it: sessions share it. Any thread.
class WorldFolder {
public:
    /// kNotFound, kUsage for a path that is no folder.
    static world::Result<std::unique_ptr<WorldFolder>> create(const std::string& path);

    /// Names of the worlds that are there now, ascending. kIo.
    world::Result<std::vector<std::string>> names() const;
    /// kUsage for a name that is no plain file name, or a link that leads out of the folder; kNotFound, kBadData as
    /// WorldStore::open. Errors name the world and not where the folder is.
    world::Result<std::shared_ptr<const OpenedWorld>> open(const std::string& name);

private:
    explicit WorldFolder(std::filesystem::path folder) : folder_(std::move(folder)) {}

    std::filesystem::path folder_;  ///< canonical
    std::mutex mutex_;
    std::map<std::string, std::shared_ptr<const OpenedWorld>> open_;
};

}  // namespace server
