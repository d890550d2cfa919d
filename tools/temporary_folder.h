// tools/temporary_folder.h — a folder of this process's own, gone with the object.
#pragma once

#include <cstdlib>
#include <filesystem>
#include <string>

namespace tools {

class TemporaryFolder {
public:
    /// Within `in`, an existing folder; by default the system's place for such things. Only this user can reach it.
    explicit TemporaryFolder(const std::filesystem::path& in = std::filesystem::temp_directory_path()) : path_((in / "gnomon-XXXXXX").string()) {
        if (!::mkdtemp(path_.data())) path_.clear();
    }
    ~TemporaryFolder() {
        std::error_code ignored;
        if (!path_.empty()) std::filesystem::remove_all(path_, ignored);
    }
    TemporaryFolder(const TemporaryFolder&) = delete;
    TemporaryFolder& operator=(const TemporaryFolder&) = delete;

    const std::string& path() const { return path_; }  ///< empty: it could not be made

private:
    std::string path_;
};

}  // namespace tools
