#include "tools/soak_command.h"

#include <cstdio>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "tools/difference_text.h"
#include "tools/input_hash.h"
#include "tools/progress.h"
#include "tools/results_store.h"
#include "tools/soak.h"

namespace tools {
namespace {

struct SoakOptions {
    std::string world, results;  ///< results: a file; empty: none
    SoakConfig soak;
    server::ShadowConfig shadow;
    gpu::DeviceConfig device;
};

void print(const SoakReport& r) {
    const auto n = [](uint64_t value) { return static_cast<unsigned long long>(value); };
    std::printf("frames     %llu; %llu spawns, %llu removals, %llu moves, %llu jumps\n", n(r.frames), n(r.spawns),
                n(r.removals), n(r.moves), n(r.jumps));
    std::printf("changes    %llu of the maps' settings, %llu of spot lights, %llu of the ground\n", n(r.reconfigurations),
                n(r.lightChanges), n(r.edits));
    std::printf("chunks     %llu arrivals, %llu departures\n", n(r.chunkArrivals), n(r.chunkDepartures));
    std::printf("sun        %llu steps, %llu of them redrawn whole\n", n(r.sunSteps), n(r.sunRedraws));
    std::printf("owed       %llu frames with a budget, %llu unknown texels summed, %llu sleeping cascades\n",
                n(r.limitedFrames), n(r.unknownTexels), n(r.sleepers));
    std::printf("verified   %llu frames, %llu texels compared, %llu left out as stale, %llu differ\n", n(r.verified),
                n(r.texels), n(r.stale), n(r.differing));
    std::printf("memory     %.1f MiB in the first half, %.1f MiB in the last (medians, %+.2f %%); at most %.1f MiB\n",
                double(r.firstHalfBytes) / 1048576, double(r.lastHalfBytes) / 1048576,
                r.firstHalfBytes > 0 ? 100 * (double(r.lastHalfBytes) / double(r.firstHalfBytes) - 1) : 0.0,
                double(r.mostBytes) / 1048576);
    std::printf("content    %.1f MiB of it in the first half, %.1f MiB in the last (medians): chunks, edited terrain, geometry\n",
                double(r.firstHalfContent) / 1048576, double(r.lastHalfContent) / 1048576);
    std::printf("plans      %016llx\n", n(r.planHash));
}

/// All of a report but what is measured, which comes last.
std::string summaryOf(const SoakReport& r) {
    return nlohmann::ordered_json{{"frames", r.frames}, {"spawns", r.spawns}, {"removals", r.removals}, {"moves", r.moves},
                                  {"jumps", r.jumps}, {"reconfigurations", r.reconfigurations}, {"light_changes", r.lightChanges},
                                  {"edits", r.edits}, {"chunk_arrivals", r.chunkArrivals}, {"chunk_departures", r.chunkDepartures},
                                  {"sun_steps", r.sunSteps}, {"sun_redraws", r.sunRedraws}, {"limited_frames", r.limitedFrames},
                                  {"sleepers", r.sleepers}, {"unknown_texels", r.unknownTexels},
                                  {"verified", {{"frames", r.verified}, {"texels", r.texels}, {"skipped_texels", r.stale},
                                                {"differing_texels", r.differing}}},
                                  {"plan_hash", hexOf(r.planHash)},
                                  {"memory", {{"first_half_bytes", r.firstHalfBytes}, {"last_half_bytes", r.lastHalfBytes},
                                              {"most_bytes", r.mostBytes}, {"first_half_content_bytes", r.firstHalfContent},
                                              {"last_half_content_bytes", r.lastHalfContent}}}}
        .dump();
}

/// A frame of a soak as results keep it: a soak compares maps without timing their redraw.
ReplayFrame frameOf(const server::ShadowSystem& system, const server::FrameReport& report, const glm::dvec3& eye, uint64_t number) {
    ReplayFrame frame;
    frame.number = number;
    frame.eye = eye;
    frame.report = report;
    frame.redraw = system.redrawCosts();
    frame.dearest = system.dearestCasters();
    return frame;
}

world::Result<int> runSoak(const SoakOptions& options) {
    if (options.soak.verifyEvery == 0 || options.soak.frames == 0)
        return world::Error{world::ErrorCode::kUsage, "--frames and --verify: give whole numbers of 1 or more"};
    auto store = world::WorldStore::open(options.world);
    if (!store) return store.error();
    auto device = gpu::Device::create(options.device);
    if (!device) return device.error();
    auto system = server::ShadowSystem::create(*device.value(), store.value(), options.shadow);
    if (!system) return system.error();
    std::optional<ResultsStore> kept;
    RunRecord run;
    if (!options.results.empty()) {
        auto begun = beginRecord("soak", store.value(), options.world, *device.value());
        if (!begun) return begun.error();
        run = std::move(begun.value());
        auto opened = ResultsStore::open(options.results);
        if (!opened) return opened.error();
        kept.emplace(std::move(opened.value()));
    }
    world::Result<SoakReport> report = SoakReport{};
    uint64_t frames = 0;
    {
        Progress progress("soak", std::cerr, stderrIsTerminal());
        report = soak(*system.value(), store.value(), options.soak,
                      [&](const server::FrameReport& frame, const glm::dvec3& eye) -> world::Result<world::Done> {
                          if (kept)
                              if (const auto added = kept->add(frameOf(*system.value(), frame, eye, frames)); !added) return added;
                          progress.at(size_t(++frames), size_t(options.soak.frames));
                          return world::Done{};
                      });
    }
    if (!report) return report.error();
    if (kept) {
        ReplayHead head;
        head.config = options.shadow;
        run.settings = settingsJson(head);
        run.name = "seed " + std::to_string(options.soak.seed) + ", at most " + std::to_string(options.soak.objects) + " objects";
        run.verdict = report.value().differing == 0 ? "pass" : "maps differ from their redraw";
        run.frames = report.value().frames;
        run.summary = summaryOf(report.value());
        if (const auto number = kept->commit(run.ended()); !number) return number.error();
    }
    print(report.value());
    for (const server::Difference& d : report.value().first) std::cout << toText(d) << '\n';
    const std::vector<std::string> messages = device.value()->validationMessages();
    for (const std::string& message : messages) std::cerr << message << '\n';
    if (!messages.empty())
        return world::Error{world::ErrorCode::kDevice,
                            std::to_string(messages.size()) + " validation messages, listed above"};
    return report.value().differing == 0 ? 0 : 1;
}

}  // namespace

Command addSoakCommand(CLI::App& app) {
    const auto options = std::make_shared<SoakOptions>();
    options->shadow.cascades = 3;
    options->shadow.side = 256;
    options->shadow.farDistance = 120;
    options->shadow.restSeconds = 1;
    options->shadow.movingSun = true;
    CLI::App* parser = app.add_subcommand("soak", "Live long on a small world, seeded, and compare maps on the way");
    parser->add_option("world", options->world, "world file")->required();
    parser->add_option("--frames", options->soak.frames, "frames to live");
    parser->add_option("--verify", options->soak.verifyEvery, "redraw and compare every texel of every Nth frame");
    parser->add_option("--seed", options->soak.seed, "seed of all that happens");
    parser->add_option("--objects", options->soak.objects, "most objects that live at once");
    parser->add_option("--cascades", options->shadow.cascades, "cascades, 1 to 8");
    parser->add_option("--resolution", options->shadow.side, "texels a side of each map, 64 to 8192");
    parser->add_option("--far", options->shadow.farDistance, "how far from the eye shadows reach [m]");
    parser->add_option("--guard-band", options->shadow.guardBand, "windows move in steps of this many texels");
    parser->add_option("--results", options->results, "add the life to this results file; gnomon report reads it");
    parser->add_option("--device", options->device.nameContains, "use the first device whose name contains this");
    parser->add_flag("--validation", options->device.validation, "Vulkan's core and synchronization validation");
    return {parser, [options] { return runSoak(*options); }};
}

}  // namespace tools
