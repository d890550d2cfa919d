// tools/page_text.h — what a page that needs nothing else is put together with: templates, and data that cannot break out.
#pragma once

#include <cstddef>
#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>
#include <string_view>

namespace tools {

/// Of an array that the build made from a file.
template <size_t N>
std::string_view viewOf(const unsigned char (&bytes)[N]) {
    return {reinterpret_cast<const char*>(bytes), N};
}

std::string base64(std::span<const std::byte> bytes);

/// JSON that may stand in a script element: no text in it can end the element, or open a comment. Text that is not UTF-8
/// gets replacement characters.
std::string embeddable(const nlohmann::ordered_json& json);

/// Puts `value` where the page says `mark`, which it does once.
void put(std::string& page, std::string_view mark, std::string_view value);

}  // namespace tools
