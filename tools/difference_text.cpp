#include "tools/difference_text.h"

#include <cstdio>

namespace tools {

std::string toText(const server::Difference& d) {
    const std::string owner =
        d.cascade < 0 ? "spot light " + std::to_string(d.spot) : "cascade " + std::to_string(d.cascade);
    char line[256];
    std::snprintf(line, sizeof line,
                  "  %s, %s map, texel (%lld, %lld): cached %.9g, redrawn %.9g; casters:", owner.c_str(),
                  d.map == gpu::MapKind::kCache ? "cache" : "working", static_cast<long long>(d.texel.x),
                  static_cast<long long>(d.texel.y), double(d.cached), double(d.redrawn));
    std::string text = line;
    for (const std::string& caster : d.casters) text += ' ' + caster;
    return d.casters.empty() ? text + " none" : text;
}

}  // namespace tools
