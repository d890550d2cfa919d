// tests/tools/image_test.cpp — pictures come back from PNG files as they were written.
#include "tools/image.h"

#include <gtest/gtest.h>
#include <png.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <random>

namespace {

using tools::RgbImage;

RgbImage noise(int width, int height) {
    std::mt19937 rng(3);
    RgbImage image{width, height, std::vector<uint8_t>(3 * size_t(width) * size_t(height))};
    for (uint8_t& value : image.pixels) value = uint8_t(rng());
    return image;
}

class Png : public testing::Test {
protected:
    std::string path_ = testing::TempDir() + "gnomon_image_test.png";
    void TearDown() override { std::filesystem::remove(path_); }

    /// Decodes the file by libpng into `format`.
    template <class T>
    std::vector<T> read(png_uint_32 format, int& width, int& height) {
        png_image image;
        std::memset(&image, 0, sizeof image);
        image.version = PNG_IMAGE_VERSION;
        EXPECT_TRUE(png_image_begin_read_from_file(&image, path_.c_str())) << image.message;
        image.format = format;
        std::vector<T> pixels(PNG_IMAGE_SIZE(image) / sizeof(T));
        EXPECT_TRUE(png_image_finish_read(&image, nullptr, pixels.data(), 0, nullptr)) << image.message;
        width = int(image.width);
        height = int(image.height);
        return pixels;
    }
};

TEST_F(Png, PicturesReadBackAsWritten) {
    const RgbImage image = noise(16, 48);
    ASSERT_TRUE(tools::writePng(image, path_));
    int width = 0, height = 0;
    EXPECT_EQ(read<uint8_t>(PNG_FORMAT_RGB, width, height), image.pixels);
    EXPECT_EQ(width, 16);
    EXPECT_EQ(height, 48);
}

TEST_F(Png, TheBytesAreThoseOfTheFile) {
    for (const RgbImage& image : {noise(1, 1), noise(31, 7), RgbImage{64, 64, std::vector<uint8_t>(3 * 64 * 64)}}) {
        const auto bytes = tools::pngOf(image);
        ASSERT_TRUE(bytes);
        ASSERT_TRUE(tools::writePng(image, path_));
        std::ifstream file(path_, std::ios::binary);
        const std::string written(std::istreambuf_iterator<char>(file), {});
        EXPECT_EQ(std::string(reinterpret_cast<const char*>(bytes.value().data()), bytes.value().size()), written);
    }
    EXPECT_EQ(tools::pngOf({0, 0, {}}).error().code, world::ErrorCode::kLimit);
}

TEST_F(Png, DepthsReadBackInSixteenBits) {
    std::vector<float> depths(64);
    for (size_t k = 0; k < depths.size(); ++k) depths[k] = float(k) / 63;
    ASSERT_TRUE(tools::writeDepthPng(depths, 8, path_));
    int width = 0, height = 0;
    const std::vector<uint16_t> gray = read<uint16_t>(PNG_FORMAT_LINEAR_Y, width, height);
    ASSERT_EQ(gray.size(), depths.size());
    // Half a step of 16 bits.
    for (size_t k = 0; k < depths.size(); ++k) EXPECT_NEAR(gray[k], depths[k] * 65535, 0.51);
}

TEST_F(Png, AFolderThatIsNotThereIsAnError) {
    const auto done = tools::writePng({1, 1, {1, 2, 3}}, "/no/such/folder/a.png");
    ASSERT_FALSE(done);
    EXPECT_EQ(done.error().code, world::ErrorCode::kIo);
    EXPECT_NE(done.error().what.find("/no/such/folder/a.png"), std::string::npos);
}

}  // namespace
