#include "tools/bench_report.h"

#include <stdlib.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cstdarg>
#include <cstdio>
#include <filesystem>
#include <fstream>

#include "tools/machine.h"
#include "tools/summary.h"

namespace tools {
namespace {

constexpr double kDriveShare = 1.0 / 50, kTurnShare = 1.0 / 10;  // of a redraw
constexpr uint64_t kGoalInstances = 1'000'000;
constexpr double kStandingMs = 0.1, kFloors = 1.5;

double ratio(double part, double whole) { return whole > 0 ? part / whole : 0; }

double sum(const std::vector<double>& values) {
    double all = 0;
    for (const double v : values) all += v;
    return all;
}

/// Of one frame on average; 0 for none.
double each(double all, size_t frames) { return frames > 0 ? all / double(frames) : 0; }

/// "1/80.2", or "none" where nothing was drawn or compared.
std::string oneOver(double part, double whole) {
    if (!(part > 0 && whole > 0)) return "none";
    return format(whole / part < 1000 ? "1/%.1f" : "1/%.0f", whole / part);
}

std::string times(double part, double whole) { return whole > 0 ? format("%.2f", part / whole) : "none"; }

std::string spread(const std::vector<double>& values) {
    return values.empty() ? "-" : format("%.3f %.3f", median(values), quantile(values, 0.95));
}

/// Of a file /proc/PID/status [MiB].
double statusMiB(const std::string& file, const std::string& field) {
    std::ifstream status(file);
    for (std::string word; status >> word;) {
        double kib = 0;
        if (word == field + ":" && status >> kib) return kib / 1024;
    }
    return 0;
}

}  // namespace

std::string format(const char* pattern, ...) {
    char text[1024];
    va_list arguments;
    va_start(arguments, pattern);
    std::vsnprintf(text, sizeof text, pattern, arguments);
    va_end(arguments);
    return text;
}

std::string hostText() {
    double load[2] = {0, 0};
    const bool known = getloadavg(load, 2) == 2;
    return format("%zu threads, %s; load %s",
                  tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism),
                  processor().c_str(), known ? format("%.2f, %.2f", load[0], load[1]).c_str() : "unknown");
}

std::string machineText(const gpu::Device& device) {
    return device.name() + ", " + device.driver() + "; " + hostText();
}

uint64_t instancesOf(const world::WorldStore& store) {
    uint64_t instances = 0;
    for (const world::ChunkRecord& chunk : store.chunks()) instances += chunk.instances;
    return instances;
}

std::string worldText(const world::WorldStore& store) {
    const glm::dvec3 size = store.header().bounds.extent();
    return std::filesystem::path(store.path()).filename().string() +
           format(": %llu instances, %zu chunks, %.0f x %.0f m",
                  static_cast<unsigned long long>(instancesOf(store)), store.chunks().size(), size.x, size.z);
}

Memory memory(int process) {
    const std::string file = "/proc/" + (process > 0 ? std::to_string(process) : "self") + "/status";
    return {statusMiB(file, "VmRSS"), statusMiB(file, "VmHWM")};
}

std::string costTables(const std::vector<MotionCost>& costs) {
    std::string text = "ms a frame, median and 95th percentile\n";
    text += format("%-12s %6s  %15s  %15s  %15s  %7s  %17s\n", "motion", "frames", "update", "whole", "floor",
                   "redraws", "redraw");
    for (const MotionCost& c : costs)
        text += format("%-12s %6zu  %15s  %15s  %15s  %7zu  %17s\n", c.name.c_str(), c.frames(),
                       spread(c.update).c_str(), spread(c.whole).c_str(), spread(c.floor).c_str(),
                       c.redraw.size(), spread(c.redraw).c_str());

    text += "\nratios of medians, and of counts a frame\n";
    text += format("%-12s %13s %12s %12s %11s  %16s %13s\n", "motion", "update/redraw", "whole/redraw",
                   "update/floor", "whole/floor", "triangles/redraw", "texels/redraw");
    for (const MotionCost& c : costs) {
        const double update = median(c.update), whole = median(c.whole), floor = median(c.floor),
                     redraw = median(c.redraw);
        const auto count = [&](uint64_t Drawn::*what) {
            return oneOver(each(double(c.drawn.*what), c.frames()),
                           each(double(c.redrawn.*what), c.redraw.size()));
        };
        text +=
            format("%-12s %13s %12s %12s %11s  %16s %13s\n", c.name.c_str(), oneOver(update, redraw).c_str(),
                   oneOver(whole, redraw).c_str(), times(update, floor).c_str(), times(whole, floor).c_str(),
                   count(&Drawn::triangles).c_str(), count(&Drawn::texels).c_str());
    }

    text += "\ncounts a frame; the floor draws what gnomon draws\n";
    text += format("%-12s %11s  %16s %14s  %13s %13s\n", "motion", "submissions", "triangles", "redraw",
                   "texels", "redraw");
    for (const MotionCost& c : costs)
        text += format(
            "%-12s %11zu  %16.0f %14.0f  %13.0f %13.0f\n", c.name.c_str(), c.submissions,
            each(double(c.drawn.triangles), c.frames()), each(double(c.redrawn.triangles), c.redraw.size()),
            each(double(c.drawn.texels), c.frames()), each(double(c.redrawn.texels), c.redraw.size()));

    text += "\nwhere a frame's time goes, means in ms\n";
    text += format("%-12s %9s %12s %8s %8s %8s %8s %8s %8s %8s\n", "motion", "streaming", "certificates",
                   "sets", "plan", "record", "gpu", "rest", "whole", "floor");
    for (const MotionCost& c : costs) {
        const server::StageTimes& s = c.stages;
        const double whole = sum(c.whole),
                     rest = whole - s.streamMs - s.occlusionMs - s.setsMs - s.planMs - s.recordMs - c.gpuMs;
        const auto mean = [&c](double all) { return each(all, c.frames()); };
        text += format("%-12s %9.3f %12.3f %8.3f %8.3f %8.3f %8.3f %8.3f %8.3f %8.3f\n", c.name.c_str(),
                       mean(s.streamMs), mean(s.occlusionMs), mean(s.setsMs), mean(s.planMs),
                       mean(s.recordMs), mean(c.gpuMs), mean(rest), mean(whole), mean(sum(c.floor)));
    }
    return text;
}

std::vector<Goal> motionGoals(const std::vector<MotionCost>& costs, uint64_t instances) {
    std::vector<Goal> goals;
    for (const MotionCost& c : costs) {
        const double share = ratio(median(c.update), median(c.redraw));
        if (c.name == "driving")
            goals.push_back({format("driving: update at most 1/50 of a redraw, with %llu instances",
                                    static_cast<unsigned long long>(kGoalInstances)),
                             format("%s with %llu", oneOver(median(c.update), median(c.redraw)).c_str(),
                                    static_cast<unsigned long long>(instances)),
                             share <= kDriveShare});
        if (c.name == "turning")
            goals.push_back({"turning: update at most 1/10 of a redraw",
                             oneOver(median(c.update), median(c.redraw)), share <= kTurnShare});
        if (c.name == "standing")
            goals.push_back({"standing: nothing submitted, whole frame under 0.1 ms",
                             format("%zu submissions, %.4f ms", c.submissions, median(c.whole)),
                             c.submissions == 0 && median(c.whole) < kStandingMs});
        if (median(c.floor) > 0)
            goals.push_back({c.name + ": whole frame at most 1.5 floors",
                             times(median(c.whole), median(c.floor)),
                             ratio(median(c.whole), median(c.floor)) <= kFloors});
    }
    return goals;
}

std::string goalText(const std::vector<Goal>& goals) {
    std::string text;
    for (const Goal& goal : goals)
        text +=
            format("%-68s %-26s %s\n", goal.text.c_str(), goal.measured.c_str(), goal.met ? "met" : "missed");
    return text;
}

}  // namespace tools
