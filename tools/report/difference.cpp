#include "tools/report/difference.h"

#include <algorithm>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>

#include "tools/report/metric.h"

namespace tools::report {
namespace {

using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

constexpr double kPlace = 32;  ///< edge of a place [m]: about what a walker sees around
constexpr size_t kLook = 3, kFramesToLook = 8;

Error incomparable(const RunFile& a, const RunFile& b, const std::string& why) {
    return {ErrorCode::kUsage, a.name() + " and " + b.name() + " cannot be compared: " + why};
}

Result<Done> requireComparable(const RunFile& fileA, const RunFile& fileB) {
    const RunRecord &a = fileA.record(), &b = fileB.record();
    if (a.kind != b.kind) return incomparable(fileA, fileB, "one is a " + a.kind + ", the other a " + b.kind);
    if (a.kind == "lab") return incomparable(fileA, fileB, "runs of the lab keep no frames; their pages lab.html show their figures");
    if (a.name != b.name) return incomparable(fileA, fileB, "one is '" + a.name + "', the other '" + b.name + "'");
    if (a.frames != b.frames)
        return incomparable(fileA, fileB, "one has " + std::to_string(a.frames) + " frames, the other " + std::to_string(b.frames) +
                                              "; play the same frames of the same path");
    if (a.pathHash != b.pathHash)
        return incomparable(fileA, fileB, "they follow other paths, " + a.path + " and " + b.path + "; play the same poses in both");
    return Done{};
}

std::vector<OtherInput> otherInputs(const RunRecord& a, const RunRecord& b) {
    std::vector<OtherInput> list;
    const auto compare = [&](const std::string& name, const std::string& inA, const std::string& inB) {
        if (inA != inB) list.push_back({name, inA, inB});
    };
    const auto settingsA = nlohmann::ordered_json::parse(a.settings, nullptr, false), settingsB = nlohmann::ordered_json::parse(b.settings, nullptr, false);
    if (settingsA.is_object() && settingsB.is_object()) {
        for (const auto& [name, value] : settingsA.items()) compare(name, value.dump(), settingsB.contains(name) ? settingsB[name].dump() : "");
        for (const auto& [name, value] : settingsB.items())
            if (!settingsA.contains(name)) compare(name, "", value.dump());
    }
    char sizeA[32], sizeB[32];
    std::snprintf(sizeA, sizeof sizeA, "%g m", a.chunkSize);
    std::snprintf(sizeB, sizeof sizeB, "%g m", b.chunkSize);
    compare("chunk size", sizeA, sizeB);
    compare("world's content", a.worldHash, b.worldHash);
    compare("movers", a.moversHash, b.moversHash);
    compare("program", a.program, b.program);
    compare("device", a.device, b.device);
    compare("driver", a.driver, b.driver);
    compare("machine", a.machine, b.machine);
    compare("threads", std::to_string(a.threads), std::to_string(b.threads));
    return list;
}

/// Most changed first.
void sortByChange(std::vector<Change>& list) {
    std::stable_sort(list.begin(), list.end(), [](const Change& x, const Change& y) {
        return std::pair(std::abs(x.triangles.change()), std::abs(x.texels.change())) >
               std::pair(std::abs(y.triangles.change()), std::abs(y.texels.change()));
    });
}

/// Sums under a name, and the frames in which they changed most.
class Parts {
public:
    void add(const std::string& name, uint64_t frame, Pair triangles, Pair texels) {
        Change& change = parts_[name].change;
        change.triangles.a += triangles.a;
        change.triangles.b += triangles.b;
        change.texels.a += texels.a;
        change.texels.b += texels.b;
        auto& most = parts_[name].most;
        const double by = std::abs(triangles.change());
        if (by == 0 && texels.change() == 0) return;
        most.push_back({by, frame});
        // Ascending frames: of equal ones the first stays first.
        std::stable_sort(most.begin(), most.end(), [](const auto& x, const auto& y) { return x.first > y.first; });
        most.resize(std::min(most.size(), kLook));
    }
    std::vector<Change> changed() {
        std::vector<Change> list;
        for (auto& [name, part] : parts_) {
            if (part.most.empty()) continue;
            part.change.name = name;
            part.change.frames = frames(name);
            list.push_back(part.change);
        }
        sortByChange(list);
        return list;
    }
    std::vector<uint64_t> frames(const std::string& name) const {
        std::vector<uint64_t> list;
        if (const auto part = parts_.find(name); part != parts_.end())
            for (const auto& [by, frame] : part->second.most) list.push_back(frame);
        return list;
    }

private:
    struct Part {
        Change change;
        std::vector<std::pair<double, uint64_t>> most;
    };
    std::map<std::string, Part> parts_;
};

cache::Cost costOf(const FrameRow& row, size_t cause) {
    cache::Cost sum;
    for (const FrameRow::Cascade& cascade : row.cascades) sum += cascade.byCause[cause];
    return sum;
}

std::string placeOf(const glm::dvec3& eye) {
    char text[64];
    std::snprintf(text, sizeof text, "around (%.0f, %.0f)", (std::floor(eye.x / kPlace) + 0.5) * kPlace, (std::floor(eye.z / kPlace) + 0.5) * kPlace);
    return text;
}

/// Adds a pair of frames to all that is compared.
class Comparison {
public:
    explicit Comparison(const ResultColumns& columns) {
        for (Metric& metric : allMetrics(columns))
            if (!metric.measured()) metrics_.push_back({std::move(metric), {}, false});
    }
    void add(const FrameRow& a, const FrameRow& b) {
        bool differs = a.texts != b.texts;
        for (Counter& counter : metrics_) {
            const double inA = counter.metric(a), inB = counter.metric(b);
            if (inA == inB || (std::isnan(inA) && std::isnan(inB))) {
                counter.sum.a += std::isnan(inA) ? 0 : inA;
                counter.sum.b += std::isnan(inB) ? 0 : inB;
                continue;
            }
            counter.sum.a += std::isnan(inA) ? 0 : inA;
            counter.sum.b += std::isnan(inB) ? 0 : inB;
            counter.differs = differs = true;
        }
        differing_ += differs ? 1 : 0;
        cache::Cost allA, allB;
        for (size_t k = 0; k < cache::kCauses; ++k) {
            const cache::Cost costA = costOf(a, k), costB = costOf(b, k);
            causes_.add(cache::toString(cache::Cause(k)), a.number, triangles(costA, costB), texels(costA, costB));
            allA += costA;
            allB += costB;
        }
        places_.add(placeOf(a.eye), a.number, triangles(allA, allB), texels(allA, allB));
        frames_.add(std::to_string(a.number), a.number, triangles(allA, allB), texels(allA, allB));
        std::map<std::string, Pair> casters;
        for (const server::CasterCost& c : a.dearest) casters[named(c)].a += double(c.triangles);
        for (const server::CasterCost& c : b.dearest) casters[named(c)].b += double(c.triangles);
        for (const auto& [name, pair] : casters) dearest_.add(name, a.number, pair, {});
    }
    /// All casters, by their sums; the frames are known of those that were among the dearest.
    void addCasters(const std::vector<server::CasterCost>& a, const std::vector<server::CasterCost>& b) {
        for (const server::CasterCost& c : a) casters_[named(c)].a += double(c.triangles);
        for (const server::CasterCost& c : b) casters_[named(c)].b += double(c.triangles);
    }
    void into(Difference& d) {
        d.differing = differing_;
        for (const Counter& counter : metrics_)
            if (counter.differs) d.counters.emplace_back(counter.metric.name, counter.sum);
        d.causes = causes_.changed();
        d.places = places_.changed();
        for (const auto& [name, pair] : casters_)
            if (pair.change() != 0) d.casters.push_back({name, pair, {}, dearest_.frames(name)});
        sortByChange(d.casters);
        for (const Change& frame : frames_.changed())
            if (d.look.size() < kFramesToLook) d.look.push_back(frame.frames.front());
    }

private:
    struct Counter {
        Metric metric;
        Pair sum;
        bool differs;
    };
    static Pair triangles(const cache::Cost& a, const cache::Cost& b) { return {double(a.triangles), double(b.triangles)}; }
    static Pair texels(const cache::Cost& a, const cache::Cost& b) { return {double(a.texels), double(b.texels)}; }
    static std::string named(const server::CasterCost& c) {
        char at[96];
        std::snprintf(at, sizeof at, " at (%.1f, %.1f, %.1f)", c.pWorld.x, c.pWorld.y, c.pWorld.z);
        return c.name + at;
    }
    std::vector<Counter> metrics_;
    uint64_t differing_ = 0;
    Parts causes_, places_, dearest_, frames_;
    std::map<std::string, Pair> casters_;
};

/// Medians over the frames of each run that repeats `run`, by the metric's order.
Result<std::vector<std::vector<double>>> mediansOf(RunFile& run, const std::vector<std::string>& times) {
    const auto words = run.repetitions();
    if (!words) return words.error();
    std::vector<std::vector<double>> medians(times.size());
    for (const std::string& word : words.value()) {
        auto repetition = RunFile::open(word);
        if (!repetition) return repetition.error();
        auto cursor = repetition.value().frames();
        if (!cursor) return cursor.error();
        std::vector<Distribution> values(times.size());
        FrameRow row;
        for (;;) {
            const auto more = cursor.value().next(row);
            if (!more) return more.error();
            if (!more.value()) break;
            for (size_t k = 0; k < times.size(); ++k) values[k].add(metricOf(times[k], run.columns())(row));
        }
        for (size_t k = 0; k < times.size(); ++k) medians[k].push_back(values[k].quantile(0.5));
    }
    return medians;
}

double meanOf(const std::vector<double>& values) {
    double sum = 0;
    for (const double v : values) sum += v;
    return sum / double(values.size());
}

/// Of the mean.
double varianceOf(const std::vector<double>& values) {
    const double mean = meanOf(values);
    double sum = 0;
    for (const double v : values) sum += (v - mean) * (v - mean);
    return sum / double(values.size() - 1) / double(values.size());
}

/// Source: Welch, "The generalization of Student's problem when several different population variances are involved", 1947.
TimeChange timeChange(const std::string& name, const std::vector<double>& a, const std::vector<double>& b) {
    TimeChange time{name, {meanOf(a), meanOf(b)}, a.size(), b.size(), std::nullopt};
    if (a.size() < 2 || b.size() < 2) return time;
    const double va = varianceOf(a), vb = varianceOf(b);
    if (va + vb == 0) {
        time.half = 0;
        return time;
    }
    const double freedom = (va + vb) * (va + vb) / (va * va / double(a.size() - 1) + vb * vb / double(b.size() - 1));
    time.half = boost::math::quantile(boost::math::students_t(freedom), 0.975) * std::sqrt(va + vb);
    return time;
}

Result<Done> compareTimes(RunFile& a, RunFile& b, Difference& d) {
    const std::vector<std::string> times{"t_frame_ms", "t_frame_gpu_wall_ms", "t_frame_occlusion_ms", "t_frame_stream_ms", "t_frame_plan_ms"};
    const auto inA = mediansOf(a, times), inB = mediansOf(b, times);
    if (!inA) return inA.error();
    if (!inB) return inB.error();
    for (size_t k = 0; k < times.size(); ++k) d.times.push_back(timeChange(times[k], inA.value()[k], inB.value()[k]));
    return Done{};
}

std::string grouped(double value) {
    char digits[48];
    std::snprintf(digits, sizeof digits, "%.*f", value == std::floor(value) ? 0 : 3, value);
    std::string text = digits;
    const size_t point = std::min(text.find('.'), text.size());
    for (size_t at = point; at > (value < 0 ? 4u : 3u); at -= 3) text.insert(at - 3, 1, ',');
    return text;
}

std::string ratio(const Pair& pair) {
    if (pair.a == 0) return "new";
    char text[32];
    std::snprintf(text, sizeof text, "x %.4g", pair.b / pair.a);
    return text;
}

std::string listed(const std::vector<uint64_t>& frames) {
    std::string list;
    for (const uint64_t frame : frames) {
        if (!list.empty()) list += ", ";
        list += std::to_string(frame);
    }
    return list;
}

void print(std::string& out, const std::string& name, const Pair& pair, const std::string& rest) {
    char line[256];
    std::snprintf(line, sizeof line, "  %-42s %16s %16s %10s  %s\n", name.c_str(), grouped(pair.a).c_str(), grouped(pair.b).c_str(),
                  ratio(pair).c_str(), rest.c_str());
    out += line;
}

void print(std::string& out, const std::string& title, const std::vector<Change>& changes) {
    if (changes.empty()) return;
    constexpr size_t kMost = 8;
    char line[256];
    std::snprintf(line, sizeof line, "%-44s %16s %16s %10s  frames to look at\n", (title + ", triangles").c_str(), "A", "B", "");
    out += line;
    for (size_t k = 0; k < std::min(changes.size(), kMost); ++k) {
        print(out, changes[k].name, changes[k].triangles, listed(changes[k].frames));
    }
    if (changes.size() <= kMost) return;
    std::snprintf(line, sizeof line, "  and %zu that changed less\n", changes.size() - kMost);
    out += line;
}

}  // namespace

Result<Difference> compare(RunFile& a, RunFile& b, const std::function<void(size_t, size_t)>& follow) {
    if (const auto can = requireComparable(a, b); !can) return can.error();
    Difference d;
    d.a = a.name();
    d.b = b.name();
    d.inputs = otherInputs(a.record(), b.record());
    d.frames = a.record().frames;
    auto framesA = a.frames(), framesB = b.frames();
    if (!framesA) return framesA.error();
    if (!framesB) return framesB.error();
    Comparison comparison(a.columns());
    FrameRow rowA, rowB;
    for (uint64_t done = 0;; follow(size_t(std::min(++done, d.frames)), size_t(d.frames))) {
        const auto moreA = framesA.value().next(rowA), moreB = framesB.value().next(rowB);
        if (!moreA) return moreA.error();
        if (!moreB) return moreB.error();
        if (!moreA.value() || !moreB.value()) break;
        if (rowA.number != rowB.number)
            return incomparable(a, b, "frame " + std::to_string(rowA.number) + " of one meets frame " + std::to_string(rowB.number) + " of the other");
        comparison.add(rowA, rowB);
    }
    const auto castersA = a.casterSums(), castersB = b.casterSums();
    if (!castersA) return castersA.error();
    if (!castersB) return castersB.error();
    comparison.addCasters(castersA.value(), castersB.value());
    comparison.into(d);
    if (const auto done = compareTimes(a, b, d); !done) return done.error();
    return d;
}

std::string toText(const Difference& d) {
    std::string out = "A  " + d.a + "\nB  " + d.b + "\n";
    char line[256];
    for (const OtherInput& input : d.inputs) {
        std::snprintf(line, sizeof line, "  %s: %s -> %s\n", input.name.c_str(), input.a.empty() ? "none" : input.a.c_str(),
                      input.b.empty() ? "none" : input.b.c_str());
        out += line;
    }
    if (d.differing == 0) {
        out += "\nNothing differs: all deterministic counters of all " + std::to_string(d.frames) + " frames are equal.\n";
    } else {
        std::snprintf(line, sizeof line, "\n%llu of %llu frames differ", static_cast<unsigned long long>(d.differing), static_cast<unsigned long long>(d.frames));
        out += line;
        out += d.look.empty() ? ", none in triangles or texels.\n\n" : "; most, frames " + listed(d.look) + ".\n\n";
        print(out, "By cause", d.causes);
        print(out, "By place of the eye (x, z) [m]", d.places);
        print(out, "By caster", d.casters);
        out += "Counters that differ, summed over the frames and cascades\n";
        for (const auto& [name, sum] : d.counters) print(out, name, sum, "");
    }
    out += "\nTimes, medians over a run's frames [ms], measured\n";
    for (const TimeChange& t : d.times) {
        std::snprintf(line, sizeof line, "  %-22s %10.4f %10.4f  %+.4f", t.name.c_str(), t.mean.a, t.mean.b, t.mean.change());
        out += line;
        if (t.half) {
            std::snprintf(line, sizeof line, " +- %.4f (95 %%), %zu and %zu runs%s\n", *t.half, t.runsA, t.runsB,
                          std::abs(t.mean.change()) <= *t.half ? ": no difference seen" : "");
            out += line;
        } else {
            out += "  (add each run to its file twice or more for an interval)\n";
        }
    }
    return out;
}

}  // namespace tools::report
