#include "culling/nearest_name.h"

#include <algorithm>
#include <numeric>
#include <vector>

namespace culling {
namespace {

size_t editDistance(const std::string& from, const std::string& to) {
    std::vector<size_t> row(to.size() + 1);
    std::iota(row.begin(), row.end(), size_t{0});
    for (size_t i = 1; i <= from.size(); ++i) {
        size_t diagonal = row[0];
        row[0] = i;
        for (size_t j = 1; j <= to.size(); ++j) {
            const size_t replaced = diagonal + (from[i - 1] != to[j - 1]);
            diagonal = row[j];
            row[j] = std::min({replaced, row[j] + 1, row[j - 1] + 1});
        }
    }
    return row.back();
}

}  // namespace

const std::string& nearestName(const std::string& name, std::span<const std::string> names) {
    return *std::ranges::min_element(names, {}, [&](const std::string& other) { return editDistance(name, other); });
}

}  // namespace culling
