// tools/output_folder.h — results appear whole or not at all: written beside, renamed at the end.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "world/result.h"

namespace tools {

/// Files of a run that belong together. Until `commit` they lie in "FOLDER.partial"; an object that
/// is destroyed before leaves the disk as it was. One thread at a time.
class OutputFolder {
public:
    /// kIo where the folder cannot be made. What an interrupted run left beside is removed.
    static world::Result<OutputFolder> create(const std::string& folder);
    OutputFolder(OutputFolder&&) noexcept = default;
    OutputFolder& operator=(OutputFolder&&) noexcept = default;

    /// Where to write the file that will be FOLDER/name. Names are plain, without folders.
    std::string pathFor(const std::string& name) const;
    world::Result<world::Done> write(const std::string& name, const std::string& text) const;

    /// Renames every file into the folder, over older ones of the same name; other files there stay.
    world::Result<world::Done> commit();

private:
    struct Partial {
        std::filesystem::path folder, partial;
        std::vector<std::filesystem::path> made;  ///< parents that `create` made, outermost first
        bool committed = false;
        ~Partial();
    };
    explicit OutputFolder(std::unique_ptr<Partial> state) : state_(std::move(state)) {}
    std::unique_ptr<Partial> state_;
};

/// Writes a text file whole or not at all. kIo.
world::Result<world::Done> writeText(const std::string& path, const std::string& text);

}  // namespace tools
