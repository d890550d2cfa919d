// world/file_identity.h — tells one file from another that took its name.
#pragma once

#include <sys/stat.h>

#include <optional>
#include <string>

namespace world {

/// Of a file that stays open, so that its number is not given to another.
struct FileIdentity {
    dev_t device = 0;
    ino_t inode = 0;
    friend bool operator==(const FileIdentity&, const FileIdentity&) = default;
};

/// Nothing where there is no such file.
inline std::optional<FileIdentity> identify(const std::string& path) {
    struct stat s {};
    if (::stat(path.c_str(), &s) != 0) return std::nullopt;
    return FileIdentity{s.st_dev, s.st_ino};
}

}  // namespace world
