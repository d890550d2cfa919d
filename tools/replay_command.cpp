#include "tools/replay_command.h"

#include <tbb/global_control.h>
#include <tbb/info.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <memory>
#include <optional>
#include <string>

#include "server/recording.h"
#include "tools/difference_text.h"
#include "tools/dump.h"
#include "tools/frames_csv.h"
#include "tools/input_hash.h"
#include "tools/method_file.h"
#include "tools/options.h"
#include "tools/output_folder.h"
#include "tools/progress.h"
#include "tools/replay.h"
#include "tools/replay_recording.h"
#include "tools/results_store.h"
#include "tools/summary.h"
#include "world/movers.h"
#include "world/path.h"
#include "world/store.h"

namespace tools {
namespace {

namespace fs = std::filesystem;
using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

struct ReplayOptions {
    std::string world, path, movers;
    std::string sun, frames, verify, config;  ///< as typed; empty: not given
    std::vector<std::string> spots;   ///< as typed
    std::string method = "gnomon", occlusion = "exact", clock = "lockstep";
    double fps = 0;   ///< 0: the path's own times
    double day = 0;   ///< [s]; 0: the sun stands still
    double fov = 0;   ///< vertical [degrees]; 0: not known
    double sunStep = 0.5;  ///< [degrees]
    int depthBits = 32;
    uint64_t budgetTexels = 0, budgetTriangles = 0;  ///< 0: none
    int threads = 0;  ///< 0: all
    server::ShadowConfig shadow;
    uint64_t gpuBudget = 512, memoryBudget = 4096;  ///< [MiB]
    double diskLatencyMs = 4, diskBandwidthMB = 200;
    gpu::DeviceConfig device;
    std::string dump, out;  ///< empty: no pictures; NAME.replay
    std::string worlds;     ///< of a recording
    bool compare = false;
    std::vector<uint64_t> dumpFrames;  ///< numbers; empty: 8, spread evenly
    std::string results;               ///< a results file; empty: none
};

/// What drawing into cache maps may take in a frame of the live clock, unless another budget is given [ms]: half of
/// the time between a recording's frames. A start, a jump, or much that arrives at once then takes several of them. With
/// a quarter, what the built-in path owes from its start is never paid (docs/benchmarks.md).
constexpr double kLiveBudgetMs = 16;

Error usage(std::string what) { return {ErrorCode::kUsage, std::move(what)}; }

/// The system's configuration as the options say it; ranges of the numbers are the system's to test.
Result<server::ShadowConfig> shadowConfig(const ReplayOptions& options) {
    server::ShadowConfig config = options.shadow;
    if (!options.sun.empty()) {
        const auto sun = parseSun(options.sun);
        if (!sun) return sun.error();
        config.sun = sun.value();
    }
    if (options.day > 0) {
        if (!options.sun.empty()) return usage("--day moves the sun from a place of its own; leave out --sun");
        config.movingSun = true;
        config.sun = sunOfDay(0);
    }
    config.method = options.method == "redraw" ? server::Method::kRedraw : server::Method::kGnomon;
    config.occlusion = options.occlusion == "exact";
    config.format = options.depthBits == 16 ? gpu::DepthFormat::kD16 : gpu::DepthFormat::kD32;
    if (!options.config.empty()) {
        const auto method = methodFromWord(options.config);
        if (!method) return method.error();
        if (const auto good = apply(method.value(), config); !good) return good.error();
    }
    config.sunMotion.step = glm::radians(options.sunStep);
    if (options.budgetTexels > 0) config.budget.texels = options.budgetTexels;
    if (options.budgetTriangles > 0) config.budget.triangles = options.budgetTriangles;
    config.streaming.clock = options.clock == "live"      ? world::Clock::kLive
                             : options.clock == "virtual" ? world::Clock::kVirtual
                                                          : world::Clock::kLockStep;
    if (config.streaming.clock == world::Clock::kLive && config.budget.ms == 0 && options.budgetTexels == 0 &&
        options.budgetTriangles == 0)
        config.budget.ms = kLiveBudgetMs;
    config.streaming.disk.latency = options.diskLatencyMs / 1e3;
    config.streaming.disk.bandwidth = options.diskBandwidthMB * 1e6;
    config.geometryBytes = options.gpuBudget << 20;
    config.residentBytes = options.memoryBudget << 20;
    return config;
}

/// What differs, for people: texel, both depths and the casters there.
void printDifferences(const ReplayFrame& frame, Progress& progress) {
    progress.say("frame " + std::to_string(frame.number) + ": " + std::to_string(frame.verify->differing) +
                 " texels differ from the redraw");
    for (const server::Difference& d : frame.verify->first) progress.say(toText(d));
}

/// Everything that a run needs, opened and checked before the first frame.
struct Run {
    std::unique_ptr<gpu::Device> device;
    std::optional<world::WorldStore> store;
    std::unique_ptr<server::ShadowSystem> system;
    ReplayInput input;
    std::optional<MoverFeed> movers;
    std::string moversHash;  ///< empty: none
    int64_t number = 0;      ///< in the results file, when it is there
    ReplayHead head;
};

std::string nameOf(const std::string& path) { return fs::path(path).filename().string(); }

Result<Done> openInput(const ReplayOptions& options, double farDistance, Run& run) {
    auto store = world::WorldStore::open(options.world);
    if (!store) return store.error();
    run.store.emplace(std::move(store.value()));
    std::optional<FrameRange> range;
    if (!options.frames.empty()) {
        const auto parsed = parseFrameRange(options.frames);
        if (!parsed) return parsed.error();
        range = parsed.value();
    }
    const auto path = world::readTum(options.path);
    if (!path) return path.error();
    auto poses = replayPoses(path.value(), options.fps, range);
    if (!poses) return poses.error();
    run.input.poses = std::move(poses.value());
    run.input.firstNumber = range ? range->begin : 0;
    run.input.verifyEvery = samplingStep(run.input.poses.size());
    run.input.daySeconds = options.day;
    run.input.live = options.clock == "live";
    run.input.verticalFov = glm::radians(options.fov);
    if (!options.verify.empty()) {
        const auto every = parseCount("--verify", options.verify);
        if (!every) return every.error();
        run.input.verifyEvery = every.value();
    }
    const auto inWorld = requirePathInWorld(run.input.poses, run.store->header().bounds, farDistance);
    if (!inWorld) return Error{inWorld.error().code, options.path + ": " + inWorld.error().what};
    return Done{};
}

Result<std::vector<culling::SpotLight>> spotLights(const ReplayOptions& options) {
    std::vector<culling::SpotLight> spots;
    for (const std::string& text : options.spots) {
        const auto spot = parseSpot(text);
        if (!spot) return spot.error();
        spots.push_back(spot.value());
    }
    return spots;
}

Result<Done> openSystem(const ReplayOptions& options, const server::ShadowConfig& config,
                        const std::vector<culling::SpotLight>& spots, Run& run) {
    std::vector<world::MoverTrack> tracks;
    if (!options.movers.empty()) {
        auto read = world::readMovers(options.movers);
        if (!read) return read.error();
        tracks = std::move(read.value());
        run.moversHash = hexOf(hashMovers(tracks, 0));
    }
    auto device = gpu::Device::create(options.device);
    if (!device) return device.error();
    run.device = std::move(device.value());
    auto system = server::ShadowSystem::create(*run.device, *run.store, config);
    if (!system) return system.error();
    run.system = std::move(system.value());
    for (const culling::SpotLight& spot : spots)
        if (const auto added = run.system->addSpot(spot); !added) return added.error();
    if (tracks.empty()) return Done{};
    auto feed = MoverFeed::create(*run.system, std::move(tracks));
    if (!feed) return Error{feed.error().code, options.movers + ": " + feed.error().what};
    run.movers.emplace(std::move(feed.value()));
    return Done{};
}

Result<Done> describe(const ReplayOptions& options, const std::vector<culling::SpotLight>& spots, Run& run) {
    const auto hash = run.store->contentHash();
    if (!hash) return hash.error();
    char text[20];
    std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(hash.value()));
    run.head = {
        .world = nameOf(options.world),
        .worldHash = text,
        .source = run.store->header().source,
        .path = nameOf(options.path),
        .movers = nameOf(options.movers),
        .config = run.system->config(),
        .spots = spots,
        .verticalFov = run.input.verticalFov,
        .daySeconds = run.input.daySeconds,
        .texels = {},
        .splits = {},
        .device = run.device->name(),
        .driver = run.device->driver(),
        .threads = int(tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism))};
    return Done{};
}

/// Pictures of a replay: of the frames that were asked for. kUsage for one that is not played.
Result<Dump> dumpOf(const ReplayOptions& options, const Run& run, const OutputFolder& folder) {
    if (options.dumpFrames.empty()) return Dump(folder, run.input.poses.size());
    std::vector<size_t> wanted;
    for (const uint64_t frame : options.dumpFrames) {
        const uint64_t first = run.input.firstNumber, end = first + run.input.poses.size();
        if (frame < first || frame >= end)
            return usage("--dump-frames " + std::to_string(frame) + ": the replay plays frames " + std::to_string(first) + " to " +
                         std::to_string(end - 1) + "; give some of these");
        wanted.push_back(frame - first);
    }
    return Dump(folder, std::move(wanted));
}

/// The run under way in a results file.
struct Recording {
    ResultsStore store;
    RunRecord record;
};

/// None where no results were asked for.
Result<std::optional<Recording>> openRecording(const ReplayOptions& options, Run& run) {
    if (options.results.empty()) return std::optional<Recording>();
    auto record = beginRecord("replay", *run.store, options.world, *run.device);
    if (!record) return record.error();
    record.value().path = run.head.path;
    record.value().pathHash = hexOf(hashPoses(run.input.poses, 0));
    record.value().movers = run.head.movers;
    record.value().moversHash = run.moversHash;
    auto store = ResultsStore::open(options.results);
    if (!store) return store.error();
    run.input.dearest = true;
    return std::optional<Recording>(Recording{std::move(store.value()), std::move(record.value())});
}

/// Adds the run to the results file. Its number there.
Result<int64_t> record(Recording& recording, const Run& run, const Summary& summary, Dump* dump) {
    if (dump)
        for (const DumpedPicture& picture : dump->takeSmall())
            if (const auto done = recording.store.add(picture); !done) return done.error();
    endRecord(recording.record, run.head, summary);
    return recording.store.commit(recording.record);
}

/// Plays the run and writes its results, all or none.
Result<Summary> play(const ReplayOptions& options, Run& run) {
    const std::string folder =
        options.out.empty() ? fs::path(options.world).stem().string() + ".replay" : options.out;
    auto results = OutputFolder::create(folder);
    if (!results) return results.error();
    std::optional<OutputFolder> pictures;
    std::optional<Dump> dump;
    if (!options.dump.empty()) {
        auto created = OutputFolder::create(options.dump);
        if (!created) return created.error();
        pictures.emplace(std::move(created.value()));
        auto wanted = dumpOf(options, run, *pictures);
        if (!wanted) return wanted.error();
        dump.emplace(std::move(wanted.value()));
    }
    auto recording = openRecording(options, run);
    if (!recording) return recording.error();
    const std::vector<FrameColumn> columns = frameColumns();
    std::ofstream csv(results.value().pathFor("frames.csv"), std::ios::binary);
    csv << csvHeader(columns);

    Summary summary;
    {
        Progress progress("replay", std::cerr, stderrIsTerminal());
        const auto done = replay(
            *run.system, run.input, run.movers ? &*run.movers : nullptr, dump ? &*dump : nullptr,
            [&](const ReplayFrame& frame) -> Result<Done> {
                summary.add(frame);
                csv << csvRows(columns, frame);
                if (!csv)
                    return Error{ErrorCode::kIo, folder +
                                                     "/frames.csv: cannot be written; make room or give "
                                                     "another --out"};
                for (const Error& error : frame.report.errors)
                    progress.say("frame " + std::to_string(frame.number) + ": " + error.what);
                if (frame.verify && frame.verify->differing > 0) printDifferences(frame, progress);
                if (recording.value())
                    if (const auto kept = recording.value()->store.add(frame); !kept) return kept;
                progress.at(size_t(summary.frames), run.input.poses.size());
                return Done{};
            });
        if (!done) return done.error();
    }
    csv.close();
    if (!csv)
        return Error{ErrorCode::kIo,
                     folder + "/frames.csv: cannot be written; make room or give another --out"};
    for (int c = 0; c < run.system->cascades(); ++c) {
        run.head.texels.push_back(run.system->view(c).texel);
        run.head.splits.push_back(run.system->view(c).split);
    }
    if (const auto done = results.value().write("summary.json", toJson(run.head, summary)); !done)
        return done.error();
    if (recording.value()) {
        const auto number = record(*recording.value(), run, summary, dump ? &*dump : nullptr);
        if (!number) return number.error();
        run.number = number.value();
    }
    if (const auto done = results.value().commit(); !done) return done.error();
    if (pictures) {
        if (const auto done = pictures->commit(); !done) return done.error();
    }
    return summary;
}

Result<int> runReplay(const ReplayOptions& options) {
    if (options.threads < 0) return usage("--threads: not negative; leave it out to use all");
    std::optional<tbb::global_control> limit;
    if (options.threads > 0)
        limit.emplace(tbb::global_control::max_allowed_parallelism, size_t(options.threads));
    if (options.world.ends_with(server::kRecordingEnding))
        return replayRecording({options.world, options.worlds, options.compare, options.device});
    if (options.path.empty()) return usage("--path is required: the camera path to play");
    const auto config = shadowConfig(options);
    if (!config) return config.error();
    const auto spots = spotLights(options);
    if (!spots) return spots.error();

    Run run;
    if (const auto done = openInput(options, config.value().farDistance, run); !done) return done.error();
    if (const auto done = openSystem(options, config.value(), spots.value(), run); !done) return done.error();
    if (const auto done = describe(options, spots.value(), run); !done) return done.error();
    const auto summary = play(options, run);
    if (!summary) return summary.error();
    std::cout << toText(run.head, summary.value());
    if (run.number > 0) std::cout << options.results << '#' << run.number << " holds the run; gnomon report shows it\n";
    const std::vector<std::string> messages = run.device->validationMessages();
    for (const std::string& message : messages) std::cerr << message << '\n';
    if (!messages.empty())
        return Error{ErrorCode::kDevice,
                     std::to_string(messages.size()) + " validation messages, listed above"};
    return summary.value().differingTexels == 0 ? 0 : 1;
}

void addSystemOptions(CLI::App& parser, ReplayOptions& options) {
    parser.add_option("--sun", options.sun,
                      "AZIMUTH,ELEVATION of the sun [degrees]; the world's own by default");
    parser.add_option("--day", options.day, "the sun runs from morning to evening in so many seconds")
        ->check(CLI::Range(1.0, 1e6));
    parser.add_option("--sun-step", options.sunStep, "angle between the sun's directions [degrees]")
        ->check(CLI::Range(0.01, 10.0));
    parser.add_option("--method", options.method, "gnomon, or redraw: everything drawn whole in each frame")
        ->check(CLI::IsMember({"gnomon", "redraw"}));
    CLI::Option* config = parser.add_option(
        "--config", options.config, "the maps' settings: a file NAME.toml, as gnomon tune writes it, or gnomon:SETTING=VALUE");
    parser.add_option("--cascades", options.shadow.cascades, "cascades, 1 to 8");
    parser.add_option("--resolution", options.shadow.side, "texels a side of each map, 64 to 8192");
    parser.add_option("--far", options.shadow.farDistance, "how far from the eye shadows reach [m]");
    parser.add_option("--guard-band", options.shadow.guardBand, "windows move in steps of this many texels");
    parser.add_option("--level-error", options.shadow.levelError,
                      "draw the coarsest level of detail that is off by at most so many texels; 0.5 by default");
    parser.add_option("--smallest-caster", options.shadow.smallestCaster,
                      "leave casters of less than so many texels out of a cascade; 0, the default, keeps all");
    parser.add_option("--depth", options.depthBits, "bits of a texel's depth, 16 or 32")
        ->check(CLI::IsMember({16, 32}));
    parser.add_option("--fov", options.fov,
                      "the camera's vertical field of view [degrees], at 16:9: cascades that serve nothing in view sleep")
        ->check(CLI::Range(0.0, 179.0));
    parser.add_option("--budget-texels", options.budgetTexels, "most texels that a frame redraws; the rest waits")
        ->check(CLI::Range(uint64_t(1), uint64_t(1) << 40));
    parser.add_option("--budget-triangles", options.budgetTriangles, "most static triangles that a frame draws")
        ->check(CLI::Range(uint64_t(1), uint64_t(1) << 40));
    parser.add_option("--budget-ms", options.shadow.budget.ms,
                      "most time that the GPU's part may take [ms], by measure; with --clock live 16, if no budget is given");
    parser.add_option("--spot", options.spots,
                      "X,Y,Z,DX,DY,DZ,ANGLE,RANGE of a spot light [m, degrees from axis to edge]; may be given again")
        ->allow_extra_args(false);
    parser.add_option("--occlusion", options.occlusion, "off, or exact: skip casters proven hidden")
        ->check(CLI::IsMember({"off", "exact"}));
    parser.add_option("--rays", options.shadow.raysPerCluster, "most rays to prove one cluster hidden");
    for (const char* other : {"--cascades", "--resolution", "--guard-band", "--level-error", "--depth", "--occlusion", "--rays"})
        config->excludes(parser.get_option(other));
    parser.add_option("--clock", options.clock,
                      "lockstep: frames wait for chunks; virtual: a modelled disk is late, the same way every time; "
                      "live: frames keep the path's time, chunks come when they are read")
        ->check(CLI::IsMember({"lockstep", "virtual", "live"}));
    parser.add_option("--disk-seed", options.shadow.streaming.disk.seed, "of the virtual disk");
    parser.add_option("--disk-latency", options.diskLatencyMs, "of the virtual disk, median [ms]");
    parser.add_option("--disk-bandwidth", options.diskBandwidthMB, "of the virtual disk [decoded MB/s]");
    parser.add_option("--gpu-budget", options.gpuBudget, "geometry on the GPU [MiB]")
        ->check(CLI::Range(uint64_t(1), uint64_t(1) << 30));
    parser.add_option("--memory-budget", options.memoryBudget, "decoded chunks and meshes [MiB]")
        ->check(CLI::Range(uint64_t(1), uint64_t(1) << 30));
    parser.add_option("--device", options.device.nameContains,
                      "use the first device whose name contains this");
    parser.add_flag("--validation", options.device.validation,
                    "Vulkan's core and synchronization validation");
    parser.add_option("--threads", options.threads, "threads to use; all by default");
}

}  // namespace

Command addReplayCommand(CLI::App& app) {
    const auto options = std::make_shared<ReplayOptions>();
    CLI::App* parser = app.add_subcommand("replay", "Play a recorded path through a world");
    parser->add_option("world", options->world, "world file, or a session's recording NAME.gnomonrec")->required();
    parser->add_option("--path", options->path, "camera path, TUM trajectory; needed with a world");
    parser->add_option("--worlds", options->worlds, "folder of a recording's world; the recording's own by default");
    parser->add_flag("--compare", options->compare, "with a recording: stop at the first reply that differs from the recorded one");
    parser->add_option("--movers", options->movers, "recorded motion of objects, CSV");
    parser->add_option("--frames", options->frames, "FIRST:END, frame numbers to play");
    parser->add_option("--fps", options->fps, "resample the path to this rate; its own times by default");
    parser->add_flag("--verify{1}", options->verify, "=N: redraw and compare every texel of every Nth frame");
    CLI::Option* dump = parser->add_option("--dump", options->dump, "folder for pictures of 8 frames");
    parser->add_option("--dump-frames", options->dumpFrames, "N,N,...: pictures of these frames instead")->delimiter(',')->needs(dump);
    parser->add_option("--out", options->out,
                       "folder for frames.csv and summary.json; NAME.replay by default");
    parser->add_option("--results", options->results, "add the run to this results file; gnomon report reads it");
    addSystemOptions(*parser, *options);
    return {parser, [options] { return runReplay(*options); }};
}

}  // namespace tools
