// world/movers.cpp — comma separated rows, names quoted where they must be (RFC 4180).

#include "world/movers.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <string_view>

#include "world/check.h"
#include "world/record_text.h"

namespace world {
namespace {

constexpr std::array<std::string_view, 11> kColumns{"time", "id", "node_or_mesh", "x",  "y",    "z",
                                                    "qx",   "qy", "qz",           "qw", "scale"};
constexpr size_t kName = 2;
constexpr const char* kHeader = "time,id,node_or_mesh,x,y,z,qx,qy,qz,qw,scale";

/// A row's fields; the strings behind them are kept, so that reading a row allocates nothing.
class Row {
public:
    /// Cuts `line`, which must outlive the fields. Returns what is wrong with it, or null.
    const char* cut(std::string_view line) {
        count_ = 0;
        for (bool more = true; more;) {
            if (count_ == kColumns.size()) return "too many fields";
            const std::string_view rest = line.substr(std::min(line.find_first_not_of(" \t"), line.size()));
            if (rest.starts_with('"')) {
                const size_t end = unquote(rest, quoted_[count_]);
                if (end == std::string_view::npos) return "a quote is not closed";
                fields_[count_] = quoted_[count_];
                line = trimmed(rest.substr(end));
                if (!line.empty() && line[0] != ',')
                    return "text after a closing quote; double the quotes within";
            } else {
                const std::string_view field = line.substr(0, line.find(','));
                fields_[count_] = trimmed(field);
                line.remove_prefix(field.size());
            }
            ++count_;
            more = !line.empty();
            if (more) line.remove_prefix(1);
        }
        return count_ == kColumns.size() ? nullptr : "too few fields";
    }

    std::string_view operator[](size_t column) const { return fields_[column]; }

private:
    /// Appends the text within the quotes to `out`; returns where they close, past the quote.
    static size_t unquote(std::string_view text, std::string& out) {
        out.clear();
        for (size_t i = 1; i < text.size(); ++i) {
            if (text[i] == '"') {
                if (i + 1 == text.size() || text[i + 1] != '"') return i + 1;
                ++i;
            }
            out += text[i];
        }
        return std::string_view::npos;
    }

    std::array<std::string_view, kColumns.size()> fields_;
    std::array<std::string, kColumns.size()> quoted_;
    size_t count_ = 0;
};

// Recordings carry decimals: millimetres, and quaternions to five places. A pose this near to the
// world's own is the same place, rounded.
constexpr double kSamePlace = 1e-3;   // [m]
constexpr double kSameLinear = 1e-4;  // of the largest factor

Result<MoverSample> sampleOf(const Row& row, const RecordLines& lines) {
    std::array<double, kColumns.size()> values{};
    for (size_t column = 0; column < kColumns.size(); ++column) {
        if (column == 1 || column == kName) continue;
        const std::optional<double> value = finiteNumber(row[column]);
        if (!value) return lines.error(std::string(kColumns[column]) + " is not a finite number");
        values[column] = *value;
    }
    const std::optional<glm::dquat> orientation = unitQuaternion(values[6], values[7], values[8], values[9]);
    if (!orientation) return lines.error("the quaternion's length is not 1; normalise it");
    if (!(values[10] > 0)) return lines.error("scale must be above zero");
    return MoverSample{values[0], {values[3], values[4], values[5]}, *orientation, values[10]};
}

/// Reads the header line: the columns by name, in their order.
Result<Done> readHeader(RecordLines& lines, Row& row) {
    std::string_view line;
    const Result<bool> more = lines.next(line);
    if (!more) return more.error();
    bool known = more.value() && row.cut(line) == nullptr;
    for (size_t column = 0; known && column < kColumns.size(); ++column)
        known = row[column] == kColumns[column];
    if (!known) return lines.error(std::string("the first line must be ") + kHeader);
    return Done{};
}

std::string quotedName(const std::string& name) {
    if (name.find_first_of(",\"") == std::string::npos && trimmed(name) == name) return name;
    std::string out = "\"";
    for (const char c : name) {
        if (c == '"') out += '"';
        out += c;
    }
    return out + '"';
}

}  // namespace

Result<std::vector<MoverTrack>> readMovers(const std::string& path) {
    Result<RecordLines> opened = RecordLines::open(path);
    if (!opened) return opened.error();
    RecordLines& lines = opened.value();
    Row row;
    const Result<Done> header = readHeader(lines, row);
    if (!header) return header.error();
    std::map<std::string, std::vector<MoverSample>, std::less<>> tracks;
    for (std::string_view line;;) {
        const Result<bool> more = lines.next(line);
        if (!more) return more.error();
        if (!more.value()) break;
        if (trimmed(line).empty()) continue;
        if (const char* wrong = row.cut(line))
            return lines.error(std::string(wrong) + "; a row is " + kHeader);
        const std::string_view name = row[kName];
        if (name.empty()) return lines.error("node_or_mesh is empty; name the object that moves");
        const Result<MoverSample> sample = sampleOf(row, lines);
        if (!sample) return sample.error();
        auto track = tracks.find(name);
        if (track == tracks.end()) track = tracks.emplace(name, std::vector<MoverSample>()).first;
        std::vector<MoverSample>& samples = track->second;
        if (!samples.empty() && !(sample.value().time > samples.back().time))
            return lines.error("time does not ascend for '" + std::string(name) + "'; sort its rows by time");
        samples.push_back(sample.value());
    }
    std::vector<MoverTrack> out;
    for (auto& [name, samples] : tracks) out.push_back({name, std::move(samples)});
    return out;
}

Result<Done> writeMovers(const std::string& path, const std::vector<MoverTrack>& tracks) {
    struct Place {
        double time;
        size_t track, sample;
    };
    std::vector<Place> rows;
    std::vector<std::string> names;
    for (size_t t = 0; t < tracks.size(); ++t) {
        if (tracks[t].name.empty() || tracks[t].name.find_first_of("\r\n") != std::string::npos)
            return Error{ErrorCode::kUsage,
                         path + ": mover " + std::to_string(t) + " needs a name on one line"};
        names.push_back(quotedName(tracks[t].name));
        for (size_t s = 0; s < tracks[t].samples.size(); ++s)
            rows.push_back({tracks[t].samples[s].time, t, s});
    }
    // By time, as a recorder writes: a reader may follow the file as it grows.
    std::stable_sort(rows.begin(), rows.end(),
                     [](const Place& a, const Place& b) { return a.time < b.time; });
    std::string text = std::string(kHeader) + '\n';
    for (const Place& row : rows) {
        const MoverSample& s = tracks[row.track].samples[row.sample];
        const glm::dquat& q = s.orientation;
        const std::array<double, 9> values{s.time, s.position.x, s.position.y, s.position.z, q.x,
                                           q.y,    q.z,          q.w,          s.scale};
        for (size_t i = 0; i < values.size(); ++i) {
            if (!std::isfinite(values[i]))
                return Error{ErrorCode::kUsage,
                             path + ": a sample of '" + tracks[row.track].name + "' is not finite"};
            if (i == 1) text += std::to_string(row.track) + ',' + names[row.track] + ',';
            appendNumber(text, values[i]);
            text += ',';
        }
        text.pop_back();
        text += '\n';
    }
    return writeRecord(path, text);
}

const MoverSample& sampleAt(const MoverTrack& track, double time) {
    CHECK(!track.samples.empty());
    const auto after = std::upper_bound(track.samples.begin(), track.samples.end(), time,
                                        [](double t, const MoverSample& sample) { return t < sample.time; });
    return after == track.samples.begin() ? *after : *(after - 1);
}

Placement moved(const Placement& rest, const MoverSample& pose) {
    glm::dvec3 factors(glm::length(glm::dvec3(rest.linear[0])), glm::length(glm::dvec3(rest.linear[1])),
                       glm::length(glm::dvec3(rest.linear[2])));
    const double mean = std::cbrt(factors.x * factors.y * factors.z);
    // A flat rest placement has no ratios that a scale could multiply: its factors are kept as they are.
    factors = mean > 0 ? factors * (pose.scale / mean) : factors;
    if (glm::determinant(rest.linear) < 0) factors.x = -factors.x;
    const glm::dmat3 rotation = glm::mat3_cast(pose.orientation);
    Placement placement;
    placement.linear = glm::mat3(rotation[0] * factors.x, rotation[1] * factors.y, rotation[2] * factors.z);
    placement.translation = pose.position;
    return placement;
}

bool standsAt(const Placement& a, const Placement& b) {
    double largest = 0, apart = 0;
    for (int column = 0; column < 3; ++column) {
        largest = std::max(largest, double(glm::length(b.linear[column])));
        apart = std::max(apart, double(glm::length(a.linear[column] - b.linear[column])));
    }
    return glm::length(a.translation - b.translation) <= kSamePlace && apart <= kSameLinear * largest;
}

}  // namespace world
