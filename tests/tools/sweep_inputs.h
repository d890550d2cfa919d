// tests/tools/sweep_inputs.h — a small world, a path and a folder to sweep in.
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "tests/world/hills_world.h"

namespace tools_test {

class SweepInputs : public testing::Test {
protected:
    std::filesystem::path folder_;

    void SetUp() override {
        const auto* info = testing::UnitTest::GetInstance()->current_test_info();
        folder_ = std::filesystem::path(testing::TempDir()) / ("gnomon_sweep_" + std::string(info->name()));
        std::filesystem::remove_all(folder_);
        std::filesystem::create_directories(folder_);
        ASSERT_TRUE(world::bake(world::test::hillsWorld(2, 16, 2), at("hills.world"), {}));
        put("walk.tum", "0 5 12 5 0 0 0 1\n1 9 12 5 0 0 0 1\n2 13 12 9 0 0 0 1\n3 17 12 13 0 0 0 1\n");
    }
    void TearDown() override { std::filesystem::remove_all(folder_); }

    std::string at(const std::string& name) const { return (folder_ / name).string(); }
    void put(const std::string& name, const std::string& text) const { std::ofstream(folder_ / name) << text; }
};

}  // namespace tools_test
