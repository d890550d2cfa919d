#include "tools/page_text.h"

#include <nlohmann/json.hpp>

#include "world/check.h"

namespace tools {

std::string base64(std::span<const std::byte> bytes) {
    constexpr char kDigits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string text;
    for (size_t k = 0; k < bytes.size(); k += 3) {
        uint32_t group = 0;
        for (size_t j = 0; j < 3; ++j) group = group << 8 | (k + j < bytes.size() ? uint32_t(bytes[k + j]) : 0);
        for (size_t j = 0; j < 4; ++j) text += k + j > bytes.size() ? '=' : kDigits[group >> (18 - 6 * j) & 63];
    }
    return text;
}

std::string embeddable(const nlohmann::ordered_json& json) {
    using Json = nlohmann::ordered_json;
    std::string text = json.dump(-1, ' ', false, Json::error_handler_t::replace), out;
    for (const char c : text) {
        if (c == '<') out += "\\u003c";
        else out += c;
    }
    return out;
}

void put(std::string& page, std::string_view mark, std::string_view value) {
    const size_t at = page.find(mark);
    CHECK(at != std::string::npos);
    page.replace(at, mark.size(), value);
}

}  // namespace tools
