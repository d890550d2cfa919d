// tests/tools/page_data.h — what a page was given to show.
#pragma once

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>

namespace tools_test {

inline nlohmann::json dataOf(const std::string& page) {
    const std::string head = "<script type=\"application/json\" id=\"data\">";
    const size_t begin = page.find(head);
    EXPECT_NE(begin, std::string::npos);
    const size_t from = begin + head.size();
    return nlohmann::json::parse(page.substr(from, page.find("</script", from) - from), nullptr, false);
}

}  // namespace tools_test
