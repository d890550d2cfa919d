#include "server/world_folder.h"

#include <algorithm>
#include <system_error>

namespace server {

using world::Error;
using world::ErrorCode;
using world::Result;
namespace fs = std::filesystem;

namespace {

constexpr const char* kEnding = ".world";
constexpr size_t kLongestName = 128;

bool plain(const std::string& name) {
    const auto fits = [](char c) {
        return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '_' || c == '.';
    };
    return !name.empty() && name.size() <= kLongestName && name.front() != '.' && std::all_of(name.begin(), name.end(), fits);
}

}  // namespace

Result<std::unique_ptr<WorldFolder>> WorldFolder::create(const std::string& path) {
    std::error_code error;
    const fs::path folder = fs::canonical(path, error);
    if (error) return Error{ErrorCode::kNotFound, path + ": " + error.message() + "; give the folder that holds the worlds", error.value()};
    if (!fs::is_directory(folder, error)) return Error{ErrorCode::kUsage, path + ": no folder; give the one that holds the worlds"};
    return std::unique_ptr<WorldFolder>(new WorldFolder(folder));
}

Result<std::vector<std::string>> WorldFolder::names() const {
    std::vector<std::string> names;
    std::error_code error;
    for (const fs::directory_entry& entry : fs::directory_iterator(folder_, error)) {
        const std::string name = entry.path().stem().string();
        if (entry.path().extension() == kEnding && plain(name)) names.push_back(name);
    }
    if (error) return Error{ErrorCode::kIo, "the folder of worlds: " + error.message(), error.value()};
    std::sort(names.begin(), names.end());
    return names;
}

Result<std::shared_ptr<const OpenedWorld>> WorldFolder::open(const std::string& name) {
    if (!plain(name))
        return Error{ErrorCode::kUsage, "world name: give one as ListWorlds tells it: letters, digits, '-', '_' and '.'"};
    const std::lock_guard lock(mutex_);
    if (const auto found = open_.find(name); found != open_.end()) return found->second;
    const std::string who = "world " + name;
    std::error_code error;
    const fs::path file = fs::canonical(folder_ / (name + kEnding), error);
    if (error) return Error{ErrorCode::kNotFound, who + ": there is none of that name; ListWorlds tells which there are", error.value()};
    if (file.parent_path() != folder_ || !fs::is_regular_file(file, error))
        return Error{ErrorCode::kUsage, who + ": it is a link that leads out of the folder, or no file; nothing else is served"};
    const auto hidden = [&](Error e) {
        if (const size_t at = e.what.find(file.string()); at != std::string::npos) e.what.replace(at, file.string().size(), who);
        return e;
    };
    auto store = world::WorldStore::open(file.string());
    if (!store) return hidden(store.error());
    const auto content = store.value().contentHash();
    if (!content) return hidden(content.error());
    auto opened = std::make_shared<const OpenedWorld>(OpenedWorld{name, std::move(store.value()), content.value()});
    open_.emplace(name, opened);
    return opened;
}

}  // namespace server
