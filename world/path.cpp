// world/path.cpp — eight numbers a line, checked one by one.

#include "world/path.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>

#include "world/check.h"
#include "world/record_text.h"

namespace world {
namespace {

constexpr size_t kFields = 8;  // t tx ty tz qx qy qz qw

/// The pose on one line that holds nothing but fields.
Result<Pose> poseOf(std::string_view line, const RecordLines& lines) {
    std::array<double, kFields> values;
    size_t count = 0;
    for (std::string_view rest = trimmed(line); !rest.empty(); ++count) {
        const std::string_view field = rest.substr(0, rest.find_first_of(" \t"));
        rest = trimmed(rest.substr(field.size()));
        if (count >= kFields) continue;
        const std::optional<double> value = finiteNumber(field);
        if (!value) return lines.error("field " + std::to_string(count + 1) + " is not a finite number");
        values[count] = *value;
    }
    if (count != kFields)
        return lines.error(std::to_string(count) + " fields; a pose has 8: t tx ty tz qx qy qz qw");
    const std::optional<glm::dquat> orientation = unitQuaternion(values[4], values[5], values[6], values[7]);
    if (!orientation) return lines.error("the quaternion's length is not 1; normalise it");
    return Pose{values[0], {values[1], values[2], values[3]}, *orientation};
}

}  // namespace

Result<std::vector<Pose>> readTum(const std::string& path) {
    Result<RecordLines> opened = RecordLines::open(path);
    if (!opened) return opened.error();
    RecordLines& lines = opened.value();
    std::vector<Pose> poses;
    for (std::string_view line;;) {
        const Result<bool> more = lines.next(line);
        if (!more) return more.error();
        if (!more.value()) break;
        line = line.substr(0, line.find('#'));
        if (trimmed(line).empty()) continue;
        const Result<Pose> pose = poseOf(line, lines);
        if (!pose) return pose.error();
        if (!poses.empty() && !(pose.value().time > poses.back().time))
            return lines.error("time does not ascend; sort the lines, and keep one of each time");
        poses.push_back(pose.value());
    }
    if (poses.empty()) return lines.error("no poses; a path has at least one line t tx ty tz qx qy qz qw");
    return poses;
}

Result<Done> writeTum(const std::string& path, const std::vector<Pose>& poses) {
    std::string text =
        "# t tx ty tz qx qy qz qw; camera-to-world, x right, y up, looking along -z; seconds, metres\n";
    for (size_t i = 0; i < poses.size(); ++i) {
        const glm::dquat& q = poses[i].orientation;
        const glm::dvec3& p = poses[i].position;
        for (const double value : {poses[i].time, p.x, p.y, p.z, q.x, q.y, q.z, q.w}) {
            if (!std::isfinite(value))
                return Error{ErrorCode::kUsage, path + ": pose " + std::to_string(i) + " is not finite"};
            appendNumber(text, value);
            text += ' ';
        }
        text.back() = '\n';
    }
    return writeRecord(path, text);
}

Pose poseAt(const std::vector<Pose>& path, double time) {
    CHECK(!path.empty());
    const auto after = std::upper_bound(path.begin(), path.end(), time,
                                        [](double t, const Pose& pose) { return t < pose.time; });
    if (after == path.begin()) return Pose{time, path.front().position, path.front().orientation};
    const Pose& from = *(after - 1);
    if (after == path.end() || from.time == time) return Pose{time, from.position, from.orientation};
    const double part = (time - from.time) / (after->time - from.time);
    return {time, from.position + (after->position - from.position) * part,
            glm::normalize(glm::slerp(from.orientation, after->orientation, part))};
}

}  // namespace world
