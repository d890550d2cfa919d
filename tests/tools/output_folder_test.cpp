// tests/tools/output_folder_test.cpp — results appear whole or not at all.
#include "tools/output_folder.h"

#include <gtest/gtest.h>

#include <fstream>
#include <set>
#include <sstream>

namespace {

namespace fs = std::filesystem;
using tools::OutputFolder;

class OutputFolderTest : public testing::Test {
protected:
    fs::path root_ = fs::path(testing::TempDir()) / "gnomon_output_folder_test";
    void SetUp() override {
        fs::remove_all(root_);
        fs::create_directories(root_);
    }
    void TearDown() override { fs::remove_all(root_); }

    std::string path(const std::string& name) const { return (root_ / name).string(); }
    std::string read(const std::string& name) const {
        std::ifstream file(root_ / name);
        std::stringstream text;
        text << file.rdbuf();
        return text.str();
    }
    void put(const std::string& name, const std::string& text) const {
        fs::create_directories((root_ / name).parent_path());
        std::ofstream(root_ / name) << text;
    }
    std::set<std::string> everything() const {
        std::set<std::string> names;
        for (const auto& entry : fs::recursive_directory_iterator(root_))
            names.insert(entry.path().lexically_relative(root_).string());
        return names;
    }
};

TEST_F(OutputFolderTest, AppearsAtCommitAndNotBefore) {
    auto folder = OutputFolder::create(path("a/b/out/"));
    ASSERT_TRUE(folder) << folder.error().what;
    ASSERT_TRUE(folder.value().write("one", "1"));
    EXPECT_FALSE(fs::exists(root_ / "a/b/out"));
    ASSERT_TRUE(folder.value().commit());
    EXPECT_EQ(everything(), (std::set<std::string>{"a", "a/b", "a/b/out", "a/b/out/one"}));
    EXPECT_EQ(read("a/b/out/one"), "1");
}

TEST_F(OutputFolderTest, AbandonedLeavesTheDiskAsItWas) {
    put("kept/file", "old");
    const std::set<std::string> before = everything();
    {
        auto fresh = OutputFolder::create(path("new/deep/out"));
        auto nested = OutputFolder::create(path("new/deep/out/pictures"));
        auto existing = OutputFolder::create(path("kept"));
        ASSERT_TRUE(fresh && nested && existing);
        ASSERT_TRUE(fresh.value().write("one", "1"));
        ASSERT_TRUE(existing.value().write("file", "new"));
    }
    EXPECT_EQ(everything(), before);
    EXPECT_EQ(read("kept/file"), "old");
}

TEST_F(OutputFolderTest, ReplacesItsOwnFilesAndKeepsOthers) {
    put("out/mine", "old");
    put("out/other", "theirs");
    auto folder = OutputFolder::create(path("out"));
    ASSERT_TRUE(folder);
    ASSERT_TRUE(folder.value().write("mine", "new"));
    EXPECT_EQ(read("out/mine"), "old");
    ASSERT_TRUE(folder.value().commit());
    EXPECT_EQ(read("out/mine"), "new");
    EXPECT_EQ(read("out/other"), "theirs");
}

TEST_F(OutputFolderTest, RemovesWhatAnInterruptedRunLeft) {
    put("out.partial/stale", "x");
    auto folder = OutputFolder::create(path("out"));
    ASSERT_TRUE(folder);
    ASSERT_TRUE(folder.value().commit());
    EXPECT_EQ(everything(), (std::set<std::string>{"out"}));
}

TEST_F(OutputFolderTest, AFileInTheWayIsAnError) {
    put("out", "a file");
    const auto folder = OutputFolder::create(path("out"));
    ASSERT_FALSE(folder);
    EXPECT_EQ(folder.error().code, world::ErrorCode::kIo);
    const auto below = OutputFolder::create(path("out/below"));
    ASSERT_FALSE(below);
    EXPECT_EQ(everything(), (std::set<std::string>{"out"}));
}

}  // namespace
