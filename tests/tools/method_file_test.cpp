// Methods as configuration files: what is written reads back; what is wrong is named with its line.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "culling/method_settings.h"
#include "culling/shadow_views.h"
#include "tools/method_file.h"

namespace {

namespace fs = std::filesystem;

class MethodFile : public testing::Test {
protected:
    void SetUp() override { fs::create_directories(folder_); }
    void TearDown() override { fs::remove_all(folder_); }
    std::string write(const std::string& text) {
        const std::string path = (folder_ / "some.toml").string();
        std::ofstream(path) << text;
        return path;
    }

private:
    fs::path folder_ = fs::path(testing::TempDir()) / ("method_file_" + std::to_string(getpid()));
};

TEST_F(MethodFile, WhatIsWrittenReadsBack) {
    for (culling::ShadowMethod method : culling::namedMethods()) {
        const std::string base = method.name;
        if (base == "pushed-spheres") method.radii = {5, 1.0 / 3 + 10, 40, 1000};
        const auto read = tools::readMethod(write(tools::methodFileText(method, base, "two\nlines")));
        ASSERT_TRUE(read) << read.error().what;
        EXPECT_EQ(read.value().name, "some.toml");
        const auto had = culling::settingsOf(method), has = culling::settingsOf(read.value());
        for (size_t i = 0; i < had.size(); ++i) EXPECT_EQ(had[i].value, has[i].value) << base << ' ' << had[i].name;
    }
}

TEST_F(MethodFile, WhatIsLeftOutIsTheNamedMethods) {
    const auto read = tools::methodFromWord(write("method = 'gnomon'\n[settings]\nfilter = 'box3'\nside = 512\n"));
    ASSERT_TRUE(read) << read.error().what;
    EXPECT_EQ(read.value().filter, culling::Filter::kBox3);
    EXPECT_EQ(read.value().side, 512);
    EXPECT_EQ(read.value().guardBand, 4);
}

TEST_F(MethodFile, ErrorsNameTheFileThePlaceAndTheNearest) {
    const std::pair<const char*, const char*> wrong[] = {
        {"method = ", "line 1"},
        {"method = 'gnomn'", "the nearest is gnomon"},
        {"[settings]\nside = 512", "names no method"},
        {"method = 'gnomon'\nside = 512", "line 2: unknown key 'side'"},
        {"method = 'gnomon'\n[settings]\nsied = 512", "line 3: method gnomon: there is no setting 'sied'; the nearest is side"},
        {"method = 'gnomon'\n[settings]\nside = 1999-01-01", "line 3: side is no value"},
        {"method = 'gnomon'\n[settings]\nradii = ['a']", "line 3: radii is no value"},
        {"method = 'gnomon'\n[settings]\nside = 7", "64 to 8192"},
        {"method = 'gnomon'\nsettings = 3", "line 2: settings is no table"}};
    for (const auto& [text, says] : wrong) {
        const auto read = tools::readMethod(write(text));
        ASSERT_FALSE(read) << text;
        EXPECT_EQ(read.error().code, world::ErrorCode::kUsage);
        EXPECT_NE(read.error().what.find("some.toml: "), std::string::npos) << read.error().what;
        EXPECT_NE(read.error().what.find(says), std::string::npos) << read.error().what;
    }
    EXPECT_EQ(tools::methodFromWord("nowhere.toml").error().code, world::ErrorCode::kNotFound);
}

}  // namespace
