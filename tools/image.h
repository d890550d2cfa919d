// tools/image.h — pictures, and the PNG files that they become.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "world/result.h"

namespace tools {

/// 8-bit RGB, row by row, three bytes a pixel.
struct RgbImage {
    int width = 0, height = 0;  ///< [pixels]
    std::vector<uint8_t> pixels;
};

/// The bytes of a PNG file. The same for the same image. kLimit for one that libpng refuses.
world::Result<std::vector<std::byte>> pngOf(const RgbImage& image);
/// The image of such bytes. kBadData for what is no PNG.
world::Result<RgbImage> imageOf(std::span<const std::byte> png);
/// kIo names the file.
world::Result<world::Done> writePng(const RgbImage& image, const std::string& path);
/// 16 bits a pixel, round(depth * 65535): absolute, unlike the pictures. `depths` has side * side values.
world::Result<world::Done> writeDepthPng(std::span<const float> depths, int side, const std::string& path);

}  // namespace tools
