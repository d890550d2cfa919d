#include "tools/replay.h"

#include <chrono>
#include <cmath>
#include <cstdio>
#include <glm/gtc/constants.hpp>
#include <thread>
#include <utility>

#include "culling/light_space.h"
#include "tools/dump.h"

namespace tools {
namespace {

constexpr double kMostFrames = 1e7;

world::Error usage(std::string what) { return {world::ErrorCode::kUsage, std::move(what)}; }

std::string extent(double minX, double minZ, double maxX, double maxZ) {
    char text[128];
    std::snprintf(text, sizeof text, "x %.0f to %.0f, z %.0f to %.0f", minX, maxX, minZ, maxZ);
    return text;
}

world::Error atFrame(uint64_t number, const world::Error& error) {
    return {error.code, "frame " + std::to_string(number) + ": " + error.what, error.native};
}

world::Result<std::vector<MapHashes>> mapHashes(server::ShadowSystem& system) {
    std::vector<MapHashes> hashes;
    for (int c = 0; c < system.cascades(); ++c) {
        const auto cache = system.mapHash(c, gpu::MapKind::kCache);
        if (!cache) return cache.error();
        const auto working = system.mapHash(c, gpu::MapKind::kWorking);
        if (!working) return working.error();
        hashes.push_back({cache.value(), working.value()});
    }
    return hashes;
}

/// Where a camera's poses lead from a frame on.
std::vector<server::AheadEye> aheadOn(const ReplayInput& input, const std::vector<world::Pose>& poses, size_t index) {
    std::vector<server::AheadEye> ahead;
    for (size_t k = index + 1; k < poses.size(); ++k) {
        const double seconds = input.poses[k].time - input.poses[index].time;
        if (seconds > kForesight) break;
        if (ahead.empty() || seconds >= ahead.back().seconds + kForesight / 16)
            ahead.push_back({seconds, poses[k].position});
    }
    return ahead;
}

/// One step of the loop, up to the finished frame.
world::Result<ReplayFrame> step(server::ShadowSystem& system, const ReplayInput& input, size_t index,
                                MoverFeed* movers, Dump* dump) {
    const world::Pose& pose = input.poses[index];
    ReplayFrame frame;
    frame.number = input.firstNumber + index;
    frame.eye = pose.position;
    const bool dumped = dump && dump->wants(index);
    if (dumped) {
        if (const auto read = dump->before(system); !read) return read.error();
    }

    std::vector<server::Camera> others;
    server::FrameInput frameInput = camerasAt(input, index, others);
    if (input.daySeconds > 0) {
        const double share = (pose.time - input.poses.front().time) / input.daySeconds;
        frameInput.sun = sunOfDay(std::min(share, 1.0));
    }
    if (movers) frameInput.objects = movers->at(pose.time);
    std::vector<std::vector<server::AheadEye>> ahead;
    if (input.foresight) {
        ahead.push_back(aheadOn(input, input.poses, index));
        for (const auto& poses : input.others) ahead.push_back(aheadOn(input, poses, index));
        frameInput.camera.ahead = ahead[0];
        for (size_t k = 0; k < others.size(); ++k) others[k].ahead = ahead[k + 1];
    }
    const auto start = std::chrono::steady_clock::now();
    auto report = system.advance(frameInput);
    if (report)
        if (const auto finished = system.finish(report.value()); !finished) return finished.error();
    frame.advanceMs =
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
    if (!report) return report.error();
    frame.report = std::move(report.value());
    frame.redraw = system.redrawCosts();
    if (input.dearest) frame.dearest = system.dearestCasters();

    const bool verified = dumped || frame.number % input.verifyEvery == 0;
    if (verified) {
        auto verify = system.verify();
        if (!verify) return verify.error();
        frame.verify = std::move(verify.value());
    }
    if (dumped) {
        if (const auto drawn = dump->after(system, frame); !drawn) return drawn.error();
    }
    if (verified || index + 1 == input.poses.size()) {
        auto hashes = mapHashes(system);
        if (!hashes) return hashes.error();
        frame.hashes = std::move(hashes.value());
    }
    return frame;
}

}  // namespace

glm::dvec3 sunOfDay(double share) {
    const double height = 5 + 55 * std::sin(glm::pi<double>() * share);
    return culling::sunFromAngles(glm::radians(90 + 180 * share), glm::radians(height));
}

server::FrameInput camerasAt(const ReplayInput& input, size_t index, std::vector<server::Camera>& others) {
    const auto camera = [&](const world::Pose& pose) {
        return server::Camera{pose.position, pose.orientation, input.verticalFov, kAspect, {}};
    };
    others.clear();
    for (const auto& poses : input.others) others.push_back(camera(poses[index]));
    server::FrameInput frame;
    frame.time = input.poses[index].time;
    frame.camera = camera(input.poses[index]);
    frame.others = others;
    return frame;
}

gpu::CascadeTimes timesOf(const gpu::GpuTimes& times, size_t cascade) {
    return cascade < times.cascades.size() ? times.cascades[cascade] : gpu::CascadeTimes{};
}

world::Result<std::vector<world::Pose>> replayPoses(const std::vector<world::Pose>& path, double fps,
                                                    const std::optional<FrameRange>& range) {
    if (!std::isfinite(fps) || fps < 0) return usage("--fps: not a rate; give frames per second above 0");
    const double first = path.front().time, duration = path.back().time - first;
    if (duration * fps > kMostFrames) return usage("--fps: more than 10 million frames; give a lower rate");
    // The last pose counts although duration * fps may come out a rounding below a whole number.
    const uint64_t count =
        fps > 0 ? static_cast<uint64_t>(std::floor(duration * fps + 1e-6)) + 1 : path.size();
    const FrameRange cut = range.value_or(FrameRange{0, count});
    if (cut.end > count)
        return usage("--frames " + std::to_string(cut.begin) + ":" + std::to_string(cut.end) +
                     ": the replay has " + std::to_string(count) +
                     " frames; give a range within 0:" + std::to_string(count));
    std::vector<world::Pose> poses;
    poses.reserve(cut.end - cut.begin);
    for (uint64_t k = cut.begin; k < cut.end; ++k) {
        const double time = first + static_cast<double>(k) / fps;
        poses.push_back(fps > 0 ? world::poseAt(path, time) : path[k]);
        if (fps > 0) poses.back().time = time;  // ascends also where the pose is held
    }
    return poses;
}

world::Result<world::Done> requirePathInWorld(const std::vector<world::Pose>& poses, const world::Box& bounds,
                                              double farDistance) {
    world::Box path;
    for (const world::Pose& pose : poses) {
        const glm::dvec3 p = pose.position;
        if (p.x >= bounds.min.x - farDistance && p.x <= bounds.max.x + farDistance &&
            p.z >= bounds.min.z - farDistance && p.z <= bounds.max.z + farDistance)
            return world::Done{};
        path.add(p);
    }
    return usage("path: no pose comes within " + std::to_string(std::lround(farDistance)) +
                 " m of the world: the path spans " + extent(path.min.x, path.min.z, path.max.x, path.max.z) +
                 " [m], the world " + extent(bounds.min.x, bounds.min.z, bounds.max.x, bounds.max.z) +
                 "; give a path that was recorded in this world");
}

uint64_t samplingStep(uint64_t frames) { return std::max<uint64_t>(1, frames / 60); }

world::Result<world::Done> replay(
    server::ShadowSystem& system, const ReplayInput& input, MoverFeed* movers, Dump* dump,
    const std::function<world::Result<world::Done>(const ReplayFrame&)>& onFrame) {
    CHECK(!input.poses.empty() && input.verifyEvery > 0);
    const auto start = std::chrono::steady_clock::now();
    for (size_t i = 0; i < input.poses.size(); ++i) {
        if (input.live)
            std::this_thread::sleep_until(
                start + std::chrono::duration_cast<std::chrono::steady_clock::duration>(
                            std::chrono::duration<double>(input.poses[i].time - input.poses[0].time)));
        const auto frame = step(system, input, i, movers, dump);
        if (!frame) return atFrame(input.firstNumber + i, frame.error());
        if (const auto done = onFrame(frame.value()); !done) return done.error();
    }
    return world::Done{};
}

}  // namespace tools
