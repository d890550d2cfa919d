// tests/world/temp_file.h — a file that goes with its test.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>

namespace world::test {

class TempFile {
public:
    /// `name` keeps it apart from those of other tests; each process has its own.
    explicit TempFile(const std::string& name) : path_(testing::TempDir() + std::to_string(::getpid()) + name) {}
    TempFile(const TempFile&) = delete;
    TempFile& operator=(const TempFile&) = delete;
    ~TempFile() { std::filesystem::remove(path_); }
    const std::string& path() const { return path_; }
    void write(std::string_view text) const { std::ofstream(path_, std::ios::binary) << text; }

private:
    std::string path_;
};

}  // namespace world::test
