#include "tools/output_folder.h"

#include <algorithm>
#include <fstream>
#include <system_error>
#include <utility>

namespace tools {
namespace {

namespace fs = std::filesystem;

world::Error ioError(const fs::path& path, const std::error_code& error) {
    return {world::ErrorCode::kIo,
            path.string() + ": " + error.message() + "; give a folder that can be written, with room",
            error.value()};
}

}  // namespace

world::Result<OutputFolder> OutputFolder::create(const std::string& folder) {
    auto state = std::make_unique<Partial>();
    std::error_code error;
    state->folder = fs::absolute(folder, error).lexically_normal();
    if (error) return ioError(folder, error);
    if (!state->folder.has_filename()) state->folder = state->folder.parent_path();
    if (fs::exists(state->folder, error) && !fs::is_directory(state->folder, error))
        return world::Error{world::ErrorCode::kIo, folder + ": is a file; give another folder"};
    state->partial = state->folder;
    state->partial += ".partial";
    fs::remove_all(state->partial, error);
    if (error) return ioError(state->partial, error);

    std::vector<fs::path> missing;
    for (fs::path p = state->partial; !p.empty() && !fs::exists(p, error); p = p.parent_path())
        missing.push_back(p);
    for (auto p = missing.rbegin(); p != missing.rend(); ++p) {
        fs::create_directory(*p, error);
        if (error) return ioError(*p, error);
        if (*p != state->partial) state->made.push_back(*p);
    }
    return OutputFolder(std::move(state));
}

std::string OutputFolder::pathFor(const std::string& name) const { return (state_->partial / name).string(); }

world::Result<world::Done> OutputFolder::write(const std::string& name, const std::string& text) const {
    return writeText(pathFor(name), text);
}

world::Result<world::Done> OutputFolder::commit() {
    std::error_code error;
    fs::create_directories(state_->folder, error);
    if (error) return ioError(state_->folder, error);
    std::vector<fs::path> files;
    for (fs::directory_iterator entry(state_->partial, error), end; !error && entry != end;
         entry.increment(error))
        files.push_back(entry->path());
    if (error) return ioError(state_->partial, error);
    std::sort(files.begin(), files.end());
    for (const fs::path& file : files) {
        fs::rename(file, state_->folder / file.filename(), error);
        if (error) return ioError(state_->folder / file.filename(), error);
    }
    state_->committed = true;
    fs::remove(state_->partial, error);
    return world::Done{};
}

OutputFolder::Partial::~Partial() {
    std::error_code ignored;  // nothing can be done about it here, and the name says what the folder is
    fs::remove_all(partial, ignored);
    if (committed) return;
    for (auto p = made.rbegin(); p != made.rend(); ++p) fs::remove(*p, ignored);  // only empty ones go
}

world::Result<world::Done> writeText(const std::string& path, const std::string& text) {
    const std::string partial = path + ".partial";
    std::error_code error;
    {
        std::ofstream file(partial, std::ios::binary);
        file.write(text.data(), static_cast<std::streamsize>(text.size()));
        file.close();
        if (!file) {
            fs::remove(partial, error);
            return world::Error{world::ErrorCode::kIo,
                                path + ": cannot be written; give a folder that can be written, with room"};
        }
    }
    fs::rename(partial, path, error);
    if (!error) return world::Done{};
    const world::Error failure = ioError(path, error);
    fs::remove(partial, error);
    return failure;
}

}  // namespace tools
