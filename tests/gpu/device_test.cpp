#include "gpu/device.h"

#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>

namespace {

using gpu::Device;

/// In a process of its own: creates a device after a variable was set, prints the error, and ends
/// with 0 if it is kNotFound.
[[noreturn]] void createWith(const char* variable, const char* value, bool validation) {
    setenv(variable, value, 1);
    setenv(std::string(variable) == "VK_ICD_FILENAMES" ? "VK_DRIVER_FILES" : variable, value, 1);
    const auto device = Device::create({.validation = validation, .nameContains = {}});
    if (device) std::exit(1);
    std::fprintf(stderr, "%s\n", device.error().what.c_str());
    std::exit(device.error().code == world::ErrorCode::kNotFound ? 0 : 2);
}

TEST(Device, TellsItsNameAndDriver) {
    const auto device = Device::create({});
    ASSERT_TRUE(device) << device.error().what;
    EXPECT_FALSE(device.value()->name().empty());
    EXPECT_FALSE(device.value()->driver().empty());
    EXPECT_TRUE(device.value()->validationMessages().empty());
}

TEST(Device, IsFoundByAPartOfItsName) {
    const auto any = Device::create({});
    ASSERT_TRUE(any) << any.error().what;
    const std::string name = any.value()->name();
    const auto device = Device::create({.validation = false, .nameContains = name.substr(1, 4)});
    ASSERT_TRUE(device) << device.error().what;
    EXPECT_NE(device.value()->name().find(name.substr(1, 4)), std::string::npos);
}

TEST(Device, NamesTheDevicesThereAreWhenNoneFits) {
    const auto device = Device::create({.validation = false, .nameContains = "no such device"});
    ASSERT_FALSE(device);
    EXPECT_EQ(device.error().code, world::ErrorCode::kNotFound);
    EXPECT_NE(device.error().what.find("'no such device'"), std::string::npos) << device.error().what;
    const auto any = Device::create({});
    ASSERT_TRUE(any) << any.error().what;
    EXPECT_NE(device.error().what.find(any.value()->name()), std::string::npos) << device.error().what;
}

TEST(Device, SeveralLiveAtOnce) {
    const auto first = Device::create({.validation = true, .nameContains = {}});
    const auto second = Device::create({.validation = true, .nameContains = {}});
    ASSERT_TRUE(first && second);
    EXPECT_TRUE(first.value()->validationMessages().empty());
    EXPECT_TRUE(second.value()->validationMessages().empty());
}

TEST(DeviceDeathTest, WithoutADriverSaysWhatToInstall) {
    GTEST_FLAG_SET(death_test_style, "threadsafe");  // a process without drivers loaded before
    EXPECT_EXIT(createWith("VK_ICD_FILENAMES", "/nowhere.json", false), testing::ExitedWithCode(0),
                "no Vulkan driver.*install mesa-vulkan-drivers");
}

TEST(DeviceDeathTest, WithoutTheLayerSaysWhatToInstall) {
    GTEST_FLAG_SET(death_test_style, "threadsafe");
    EXPECT_EXIT(createWith("VK_LAYER_PATH", "/nowhere", true), testing::ExitedWithCode(0),
                "no Vulkan layer VK_LAYER_KHRONOS_validation: install vulkan-validationlayers");
}

}  // namespace
