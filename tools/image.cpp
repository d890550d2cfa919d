#include "tools/image.h"

#include <png.h>

#include <algorithm>
#include <cmath>
#include <cstring>

namespace tools {
namespace {

using world::Error;
using world::ErrorCode;

/// For libpng's simplified interface, which reports errors by value.
png_image headOf(png_uint_32 format, int width, int height) {
    png_image image;
    std::memset(&image, 0, sizeof image);
    image.version = PNG_IMAGE_VERSION;
    image.width = static_cast<png_uint_32>(width);
    image.height = static_cast<png_uint_32>(height);
    image.format = format;
    return image;
}

world::Result<world::Done> writeImage(png_uint_32 format, int width, int height, const void* pixels,
                                      const std::string& path) {
    png_image image = headOf(format, width, height);
    if (png_image_write_to_file(&image, path.c_str(), 0, pixels, 0, nullptr)) return world::Done{};
    return Error{ErrorCode::kIo, path + ": " + image.message + "; give a folder that can be written, with room"};
}

}  // namespace

world::Result<std::vector<std::byte>> pngOf(const RgbImage& image) {
    png_image head = headOf(PNG_FORMAT_RGB, image.width, image.height);
    std::vector<std::byte> bytes(PNG_IMAGE_PNG_SIZE_MAX(head));
    size_t size = bytes.size();
    if (!png_image_write_to_memory(&head, bytes.data(), &size, 0, image.pixels.data(), 0, nullptr))
        return Error{ErrorCode::kLimit, std::string("a picture cannot be encoded: ") + head.message};
    bytes.resize(size);
    return bytes;
}

world::Result<RgbImage> imageOf(std::span<const std::byte> png) {
    constexpr png_uint_32 kLargest = 1 << 14;  // a head that lies must not ask for all memory
    png_image head = headOf(PNG_FORMAT_RGB, 0, 0);
    RgbImage image;
    if (png_image_begin_read_from_memory(&head, png.data(), png.size()) && head.width <= kLargest && head.height <= kLargest) {
        head.format = PNG_FORMAT_RGB;
        image.width = int(head.width);
        image.height = int(head.height);
        image.pixels.resize(PNG_IMAGE_SIZE(head));
        if (png_image_finish_read(&head, nullptr, image.pixels.data(), 0, nullptr)) return image;
    }
    png_image_free(&head);
    return Error{ErrorCode::kBadData, "a picture is no PNG, or damaged"};
}

world::Result<world::Done> writePng(const RgbImage& image, const std::string& path) {
    return writeImage(PNG_FORMAT_RGB, image.width, image.height, image.pixels.data(), path);
}

world::Result<world::Done> writeDepthPng(std::span<const float> depths, int side, const std::string& path) {
    std::vector<uint16_t> gray(depths.size());
    std::transform(depths.begin(), depths.end(), gray.begin(), [](float depth) {
        return static_cast<uint16_t>(std::lround(std::clamp(double(depth), 0.0, 1.0) * 65535));
    });
    return writeImage(PNG_FORMAT_LINEAR_Y, side, side, gray.data(), path);
}

}  // namespace tools
