#include "tools/results_columns.h"

namespace tools {

std::optional<std::pair<cache::Cause, size_t>> causeColumn(std::string_view name) {
    for (size_t cause = 0; cause < cache::kCauses; ++cause)
        for (size_t part = 0; part < kCostParts.size(); ++part)
            if (name == std::string(cache::toString(cache::Cause(cause))) + "_" + kCostParts[part])
                return std::pair(cache::Cause(cause), part);
    return std::nullopt;
}

ResultColumns resultColumns() {
    ResultColumns columns;
    for (FrameColumn& column : frameColumns()) {
        const std::string& name = column.name;
        if (name == "frame" || name == "cascade" || causeColumn(name)) continue;
        const bool frame = name == "time" || name == "plan_hash" || name.starts_with("frame_") || name.starts_with("t_frame_");
        const bool text = name.ends_with("_hash");
        (frame ? columns.frame : columns.cascade).push_back({std::move(column), text});
    }
    return columns;
}

}  // namespace tools
