// tests/include_rule_test.cpp — who may include whom, and which libraries have one home: every #include
// of the source folders against that table.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <string>
#include <vector>

namespace {

namespace fs = std::filesystem;

const std::vector<std::string> kFolders = {"world", "culling", "cache", "gpu", "server", "tools"};

/// Folder -> what its files may include besides their own folder: a folder, or one header of it.
const std::map<std::string, std::set<std::string>> kMayInclude = {
    {"world", {}},
    {"culling", {"world"}},
    {"cache", {"world", "culling"}},
    {"gpu", {"world", "cache/frame_plan.h"}},
    {"server", {"world", "culling", "cache", "gpu"}},
    {"tools", {"world", "culling", "cache", "gpu", "server"}},
};

/// Beginning of a library's headers -> the folder that is its sole home.
const std::map<std::string, std::string> kHome = {
    {"openvdb/", "world"}, {"gdal", "world"},     {"ogr", "world"},      {"cpl_", "world"},
    {"sqlite3", "world"},  {"embree", "culling"}, {"vulkan/", "gpu"},    {"vk_mem_alloc", "gpu"},
    {"glslang/", "gpu"},   {"grpc", "server"},    {"httplib", "server"}, {"gtest/", "tests"},
    {"gmock/", "tests"},  {"boost/asio", "server"}, {"boost/beast", "server"},
};

/// Libraries whose headers stay out of our own headers, so that only their home's .cpp files need them.
const std::vector<std::string> kSourcesOnly = {"openvdb/", "gdal", "ogr", "cpl_", "sqlite3"};

struct Include {
    std::string file;  ///< from the root
    int line = 0;
    std::string target;
    bool quoted = false;
};

std::string folderOf(const std::string& path) { return path.substr(0, path.find('/')); }

/// What is wrong with one include; empty if nothing is.
std::string finding(const Include& include) {
    const std::string folder = folderOf(include.file), target = folderOf(include.target);
    for (const auto& [library, home] : kHome)
        if (!include.quoted && include.target.starts_with(library) && home != folder)
            return "<" + include.target + "> is at home in " + home;
    const bool header = include.file.ends_with(".h");
    for (const std::string& library : kSourcesOnly)
        if (!include.quoted && header && include.target.starts_with(library))
            return "<" + include.target + "> belongs into .cpp files";
    if (!include.quoted) return "";
    if (std::find(kFolders.begin(), kFolders.end(), target) == kFolders.end())
        return "\"" + include.target + "\" is not written from the root";
    const std::set<std::string>& allowed = kMayInclude.at(folder);
    if (target == folder || allowed.contains(target) || allowed.contains(include.target)) return "";
    return folder + " may not include \"" + include.target + "\"";
}

/// What a line includes, between its quotes or angle brackets; empty if it includes nothing.
std::string targetOf(const std::string& line) {
    const auto skipBlanks = [&line](size_t at) { return std::min(line.find_first_not_of(" \t", at), line.size()); };
    size_t at = skipBlanks(0);
    if (line.compare(at, 1, "#") != 0) return {};
    at = skipBlanks(at + 1);
    if (line.compare(at, 7, "include") != 0) return {};
    const size_t open = line.find_first_of("<\"", at);
    if (open == std::string::npos) return {};
    const size_t close = line.find_first_of(">\"", open + 1);
    return close == std::string::npos ? std::string() : line.substr(open + 1, close - open - 1);
}

std::vector<Include> includesOf(const fs::path& root) {
    std::vector<Include> includes;
    for (const std::string& folder : kFolders) {
        for (const auto& entry : fs::recursive_directory_iterator(root / folder)) {
            const std::string extension = entry.path().extension().string();
            if (extension != ".h" && extension != ".cpp") continue;
            std::ifstream file(entry.path());
            std::string text;
            for (int line = 1; std::getline(file, text); ++line) {
                const std::string target = targetOf(text);
                if (target.empty()) continue;
                includes.push_back({entry.path().lexically_relative(root).generic_string(), line, target,
                                    text.find('"') != std::string::npos});
            }
        }
    }
    return includes;
}

TEST(IncludeRule, HoldsForEveryFile) {
    const std::vector<Include> includes = includesOf(GNOMON_SOURCE_DIR);
    EXPECT_GT(includes.size(), 100u) << "the folders were not read";
    for (const Include& include : includes)
        EXPECT_EQ(finding(include), "") << include.file << ":" << include.line;
}

TEST(IncludeRule, SeesEachKindOfBreach) {
    const auto breach = [](const std::string& file, const std::string& target, bool quoted) {
        return finding({file, 1, target, quoted});
    };
    EXPECT_NE(breach("world/store.cpp", "culling/light_space.h", true), "");
    EXPECT_NE(breach("gpu/frame.cpp", "cache/statistics.h", true), "");
    EXPECT_NE(breach("cache/scroll.cpp", "gpu/device.h", true), "");
    EXPECT_NE(breach("server/shadow_system.cpp", "tools/replay.h", true), "");
    EXPECT_NE(breach("cache/scroll.cpp", "vulkan/vulkan.h", false), "");
    EXPECT_NE(breach("world/store.cpp", "embree3/rtcore.h", false), "");
    EXPECT_NE(breach("culling/oracle.cpp", "openvdb/openvdb.h", false), "");
    EXPECT_NE(breach("tools/bake_command.cpp", "gdal_priv.h", false), "");
    EXPECT_NE(breach("tools/info_command.cpp", "sqlite3.h", false), "");
    EXPECT_NE(breach("world/store.h", "sqlite3.h", false), "");
    EXPECT_NE(breach("tools/main.cpp", "replay.h", true), "");
    EXPECT_NE(breach("tools/main.cpp", "gtest/gtest.h", false), "");
    EXPECT_EQ(breach("gpu/frame.cpp", "cache/frame_plan.h", true), "");
    EXPECT_EQ(breach("world/dem.cpp", "gdal_priv.h", false), "");
    EXPECT_EQ(breach("tools/main.cpp", "server/shadow_system.h", true), "");
}

}  // namespace
