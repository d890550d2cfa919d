#include "tools/lab_command.h"

#include <cstdio>
#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>
#include <sstream>
#include <string>

#include "tools/lab/run.h"
#include "tools/method_file.h"
#include "tools/options.h"
#include "tools/progress.h"
#include "tools/replay.h"

namespace tools {
namespace {

using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

struct LabOptions {
    std::string world, path, movers, frames, sun, methods;
    double fps = 0, farDistance = 600, fov = 60;
    lab::RunConfig run;
    gpu::DeviceConfig device;
};

Result<std::vector<culling::ShadowMethod>> methodsOf(const std::string& names) {
    std::vector<culling::ShadowMethod> methods;
    if (names.empty()) {
        for (culling::ShadowMethod& method : culling::namedMethods())
            if (method.keep != culling::Keep::kScrolled) methods.push_back(std::move(method));
        return methods;
    }
    std::istringstream list(names);
    for (std::string name; std::getline(list, name, ',');) {
        auto method = methodFromWord(name);
        if (!method) return method.error();
        methods.push_back(std::move(method.value()));
    }
    return methods;
}

Result<std::vector<world::Pose>> posesOf(const LabOptions& options) {
    std::optional<FrameRange> range;
    if (!options.frames.empty()) {
        const auto parsed = parseFrameRange(options.frames);
        if (!parsed) return parsed.error();
        range = parsed.value();
    }
    const auto path = world::readTum(options.path);
    if (!path) return path.error();
    return replayPoses(path.value(), options.fps, range);
}

void printHead() {
    std::printf("%-18s %10s %10s %9s %9s | %9s %9s %9s %9s %9s | %10s | %6s %6s %6s %7s\n", "method", "triangles", "texels",
                "draws", "ms", "lit %", "at edges", "shadow %", "at edges", "mean off", "flips/M", "p50", "p99", "used %",
                "no map %");
}

void print(const lab::MethodResult& r) {
    const lab::Measures& m = r.measures;
    const double frames = double(r.frames);
    const auto share = [&](uint64_t n) { return 100 * m.share(n); };
    std::vector<double> ms = r.ms;
    std::nth_element(ms.begin(), ms.begin() + std::ptrdiff_t(ms.size() / 2), ms.end());
    std::printf("%-18s %10.0f %10.0f %9.0f %9.2f | %9.4f %9.4f %9.4f %9.4f %9.5f | %10.1f | %6.2f %6.2f %6.2f %7.3f\n",
                r.method.name.c_str(), double(r.cost.triangles) / frames, double(r.cost.texels) / frames,
                double(r.cost.draws) / frames, ms[ms.size() / 2], share(m.falseLit.all()), share(m.falseLit.atEdges),
                share(m.falseShadow.all()), share(m.falseShadow.atEdges), m.difference / double(m.pixels),
                m.flipsPerMillion(), m.texelRatio(0.5), m.texelRatio(0.99), 100 * m.usedShare / double(m.frames),
                share(m.unanswered));
}

Result<int> runLab(const LabOptions& options) {
    auto methods = methodsOf(options.methods);
    if (!methods) return methods.error();
    const auto poses = posesOf(options);
    if (!poses) return poses.error();
    if (poses.value().size() < 2) return Error{ErrorCode::kUsage, options.path + ": one frame; points are followed from frame to frame, give two or more"};
    std::vector<world::MoverTrack> tracks;
    if (!options.movers.empty()) {
        auto read = world::readMovers(options.movers);
        if (!read) return read.error();
        tracks = std::move(read.value());
    }
    auto store = world::WorldStore::open(options.world);
    if (!store) return store.error();
    if (const auto in = requirePathInWorld(poses.value(), store.value().header().bounds, options.farDistance); !in)
        return Error{in.error().code, options.path + ": " + in.error().what};
    glm::dvec3 sun = store.value().header().sun;
    if (!options.sun.empty()) {
        const auto parsed = parseSun(options.sun);
        if (!parsed) return parsed.error();
        sun = parsed.value();
    }
    const auto light = culling::makeLightSpace(sun);
    if (!light) return light.error();
    auto device = gpu::Device::create(options.device);
    if (!device) return device.error();
    auto scene = lab::Scene::load(store.value(), poses.value(), options.farDistance, light.value(), tracks);
    if (!scene) return scene.error();
    const lab::Setting setting{*device.value(), store.value(), scene.value(), tracks, light.value(), options.farDistance,
                               glm::radians(options.fov)};
    std::optional<Progress> progress;
    const auto follow = [&](const std::string& name) {
        progress.emplace(name, std::cerr, stderrIsTerminal());
        return [&progress](size_t done, size_t total) { progress->at(done, total); };
    };
    auto kept = TruthStore::open(std::filesystem::path(options.world).stem().string() + ".truth");
    if (!kept) return kept.error();
    const auto truth = lab::traceTruth(setting, poses.value(), lab::judgedFrames(poses.value().size(), options.run.every),
                                       options.run, kept.value(), follow("truth"));
    progress.reset();
    for (const std::string& line : kept.value().damage()) std::cerr << line << '\n';
    if (!truth) return truth.error();
    printHead();
    for (const culling::ShadowMethod& method : methods.value()) {
        const auto result = lab::judgeMethod(setting, poses.value(), truth.value(), method, follow(method.name));
        progress.reset();
        if (!result) return result.error();
        print(result.value());
        std::fflush(stdout);
    }
    return 0;
}

}  // namespace

Command addLabCommand(CLI::App& app) {
    const auto options = std::make_shared<LabOptions>();
    CLI::App* parser = app.add_subcommand("lab", "Judge shadow methods by ray tracing along a recorded path");
    parser->add_option("world", options->world, "world file")->required();
    parser->add_option("--path", options->path, "camera path, TUM trajectory")->required();
    parser->add_option("--movers", options->movers, "recorded motion of objects, CSV");
    parser->add_option("--methods", options->methods, "names, with commas between them, each with settings if you like: gnomon,gnomon:filter=box3:side=2048, or files NAME.toml; all by default");
    parser->add_option("--frames", options->frames, "FIRST:END, frame numbers to play");
    parser->add_option("--fps", options->fps, "resample the path to this rate; its own times by default");
    parser->add_option("--every", options->run.every, "judge every Nth frame and the one after it; some 16 times by default");
    parser->add_option("--far", options->farDistance, "how far from the eye shadows reach [m]");
    parser->add_option("--fov", options->fov, "the camera's vertical field of view [degrees], at 16:9")
        ->check(CLI::Range(1.0, 170.0));
    parser->add_option("--sun", options->sun, "AZIMUTH,ELEVATION of the sun [degrees]; the world's own by default");
    parser->add_option("--device", options->device.nameContains, "use the first device whose name contains this");
    parser->add_flag("--validation", options->device.validation, "Vulkan's core and synchronization validation");
    return {parser, [options] { return runLab(*options); }};
}

}  // namespace tools
