#include "tools/lab/session.h"

#include <filesystem>

#include "tools/options.h"
#include "tools/replay.h"

namespace tools::lab {
namespace {

using world::Error;
using world::ErrorCode;
using world::Result;

Result<std::vector<world::Pose>> posesOf(const SessionOptions& options) {
    std::optional<FrameRange> range;
    if (!options.frames.empty()) {
        const auto parsed = parseFrameRange(options.frames);
        if (!parsed) return parsed.error();
        range = parsed.value();
    }
    const auto path = world::readTum(options.path);
    if (!path) return path.error();
    auto poses = replayPoses(path.value(), options.fps, range);
    if (poses && poses.value().size() < 2)
        return Error{ErrorCode::kUsage, options.path + ": one frame; points are followed from frame to frame, give two or more"};
    return poses;
}

}  // namespace

void addSessionOptions(CLI::App& parser, SessionOptions& options) {
    parser.add_option("world", options.world, "world file")->required();
    parser.add_option("--path", options.path, "camera path, TUM trajectory")->required();
    parser.add_option("--movers", options.movers, "recorded motion of objects, CSV");
    parser.add_option("--frames", options.frames, "FIRST:END, frame numbers to play");
    parser.add_option("--fps", options.fps, "resample the path to this rate; its own times by default");
    parser.add_option("--every", options.every, "judge every Nth frame and the one after it; some 16 times by default")
        ->check(CLI::Range(uint64_t(0), uint64_t(1) << 40));
    parser.add_option("--far", options.farDistance, "how far from the eye shadows reach [m]")->check(within(1, 1e5));
    parser.add_option("--fov", options.fov, "the camera's vertical field of view [degrees], at 16:9")
        ->check(within(1, 170));
    parser.add_option("--sun", options.sun, "AZIMUTH,ELEVATION of the sun [degrees]; the world's own by default");
    parser.add_option("--device", options.device.nameContains, "use the first device whose name contains this");
    parser.add_flag("--validation", options.device.validation, "Vulkan's core and synchronization validation");
}

Result<std::unique_ptr<Session>> openSession(const SessionOptions& options) {
    auto session = std::make_unique<Session>();
    Session& s = *session;
    s.run.every = options.every;
    auto poses = posesOf(options);
    if (!poses) return poses.error();
    s.poses = std::move(poses.value());
    if (!options.movers.empty()) {
        auto read = world::readMovers(options.movers);
        if (!read) return read.error();
        s.movers = std::move(read.value());
    }
    auto store = world::WorldStore::open(options.world);
    if (!store) return store.error();
    s.store.emplace(std::move(store.value()));
    if (const auto in = requirePathInWorld(s.poses, s.store->header().bounds, options.farDistance); !in)
        return Error{in.error().code, options.path + ": " + in.error().what};
    glm::dvec3 sun = s.store->header().sun;
    if (!options.sun.empty()) {
        const auto parsed = parseSun(options.sun);
        if (!parsed) return parsed.error();
        sun = parsed.value();
    }
    const auto light = culling::makeLightSpace(sun);
    if (!light) return light.error();
    auto device = gpu::Device::create(options.device);
    if (!device) return device.error();
    s.device = std::move(device.value());
    auto scene = Scene::load(*s.store, s.poses, options.farDistance, light.value(), s.movers);
    if (!scene) return scene.error();
    s.scene.emplace(std::move(scene.value()));
    s.setting.emplace(Setting{*s.device, *s.store, *s.scene, s.movers, light.value(), options.farDistance,
                              glm::radians(options.fov)});
    return session;
}

Result<TruthStore> openTruths(const std::string& folder) {
    std::error_code failed;
    std::filesystem::create_directories(folder, failed);
    if (failed) return Error{ErrorCode::kIo, folder + ": cannot be made: " + failed.message() + "; give another --out"};
    return TruthStore::open((std::filesystem::path(folder) / "truth.sqlite").string());
}

std::string defaultFolder(const std::string& world) { return std::filesystem::path(world).stem().string() + ".lab"; }

}  // namespace tools::lab
