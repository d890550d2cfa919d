#include "tools/stress_command.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <memory>
#include <optional>
#include <string>

#include "tools/frames_csv.h"
#include "tools/input_hash.h"
#include "tools/output_folder.h"
#include "tools/progress.h"
#include "tools/results_store.h"
#include "tools/stress.h"

namespace tools {
namespace {

using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

struct StressOptions {
    std::string world, path, out, clock = "virtual";
    std::vector<std::string> cases;  ///< empty: all
    uint64_t compareEvery = 10;
    std::string results;     ///< a results file; empty: none
    bool prefetch = false, list = false;
    StressPlan plan;
    gpu::DeviceConfig device;
};

Error usage(std::string what) { return {ErrorCode::kUsage, std::move(what)}; }

/// Those that were asked for, in the order in which they are listed.
Result<std::vector<StressCase>> chosen(const StressOptions& options, const world::WorldStore& store) {
    std::vector<StressCase> all = options.prefetch ? prefetchCases(store, options.plan) : stressCases(store, options.plan);
    std::string names;
    for (const StressCase& c : all) names += (names.empty() ? "" : ", ") + c.name;
    for (const std::string& name : options.cases)
        if (std::none_of(all.begin(), all.end(), [&](const StressCase& c) { return c.name == name; }))
            return usage("--case " + name + ": there is none of that name; there are " + names);
    if (!options.cases.empty())
        std::erase_if(all, [&](const StressCase& c) {
            return std::find(options.cases.begin(), options.cases.end(), c.name) == options.cases.end();
        });
    return all;
}

/// The case's frames.csv, beside its result.
Result<StressResult> play(gpu::Device& device, const world::WorldStore& store, const StressCase& c,
                          const StressNeed& need, uint64_t compareEvery, const OutputFolder& folder, ResultsStore* kept) {
    const std::vector<FrameColumn> columns = frameColumns();
    const std::string path = folder.pathFor(c.name + ".frames.csv");
    std::ofstream csv(path, std::ios::binary);
    csv << csvHeader(columns);
    Progress progress("stress " + c.name, std::cerr, stderrIsTerminal());
    auto result = runStress(device, store, c, need, compareEvery, [&](const ReplayFrame& frame) -> Result<Done> {
        csv << csvRows(columns, frame);
        if (kept)
            if (const auto added = kept->add(frame); !added) return added;
        progress.at(size_t(frame.number) + 1, c.poses.size());
        return Done{};
    });
    csv.close();
    if (result && !csv) return Error{ErrorCode::kIo, path + ": cannot be written; make room or give another --out"};
    return result;
}

/// Adds a case to the results file, as a run of its own.
Result<Done> record(ResultsStore& kept, RunRecord run, const StressCase& c, const StressResult& result) {
    run.name = c.name;
    uint64_t poses = hashPoses(c.poses, 0);
    for (const auto& other : c.others) poses = hashPoses(other, poses);
    run.pathHash = hexOf(poses);
    run.verdict = result.failures.empty() ? "pass" : "";
    for (const std::string& failure : result.failures) run.verdict += (run.verdict.empty() ? "" : "; ") + failure;
    ReplayHead head;
    head.world = run.world;
    head.worldHash = run.worldHash;
    head.source = run.source;
    head.config = result.config;
    head.texels = result.texels;
    head.splits = result.splits;
    head.device = run.device;
    head.driver = run.driver;
    head.threads = run.threads;
    endRecord(run, head, result.summary);
    const auto number = kept.commit(run);
    if (!number) return number.error();
    return Done{};
}

Result<int> runStressCommand(StressOptions options) {
    if (!(options.plan.seconds > 0 && options.plan.seconds <= 3600))
        return usage("--seconds: give more than 0 and at most 3600");
    if (options.compareEvery == 0) return usage("--compare: give a whole number of 1 or more");
    const auto store = world::WorldStore::open(options.world);
    if (!store) return store.error();
    if (!options.path.empty()) {
        auto path = world::readTum(options.path);
        if (!path) return path.error();
        options.plan.path = std::move(path.value());
    }
    options.plan.config.streaming.clock = options.clock == "live" ? world::Clock::kLive : world::Clock::kVirtual;
    if (options.plan.config.sun == glm::dvec3(0) && store.value().header().sun == glm::dvec3(0))
        options.plan.config.sun = glm::dvec3(0.5, -1, 0.3);
    auto cases = chosen(options, store.value());
    if (!cases) return cases.error();
    if (options.list) {
        for (const StressCase& c : cases.value()) std::printf("%-20s %s\n", c.name.c_str(), c.what.c_str());
        return 0;
    }
    const auto device = gpu::Device::create(options.device);
    if (!device) return device.error();
    const std::string folder =
        options.out.empty() ? std::filesystem::path(options.world).stem().string() + ".stress" : options.out;
    auto results = OutputFolder::create(folder);
    if (!results) return results.error();
    std::optional<ResultsStore> kept;
    if (!options.results.empty()) {
        auto opened = ResultsStore::open(options.results);
        if (!opened) return opened.error();
        kept.emplace(std::move(opened.value()));
    }

    std::vector<StressResult> done;
    for (StressCase& c : cases.value()) {
        RunRecord run;
        if (kept) {
            c.dearest = true;
            auto begun = beginRecord("stress", store.value(), options.world, *device.value());
            if (!begun) return begun.error();
            run = std::move(begun.value());
        }
        StressNeed need;
        if (c.needs()) {
            const auto measured = measureNeed(*device.value(), store.value(), c);
            if (!measured) return measured.error();
            need = measured.value();
        }
        auto result = play(*device.value(), store.value(), c, need, options.compareEvery, results.value(), kept ? &*kept : nullptr);
        if (!result) return result.error();
        if (kept)
            if (const auto added = record(*kept, run, c, result.value()); !added) return added.error();
        done.push_back(std::move(result.value()));
    }
    const std::string name = std::filesystem::path(options.world).filename().string();
    if (const auto written = results.value().write("stress.json", stressJson(done, name, options.plan.seed)); !written)
        return written.error();
    if (options.prefetch)
        if (const auto drawn = results.value().write("prefetch.svg", prefetchChart(done)); !drawn) return drawn.error();
    if (const auto committed = results.value().commit(); !committed) return committed.error();
    std::cout << stressTable(done) << "\n" << folder << "/stress.json holds all of it\n";
    if (options.prefetch) std::cout << folder << "/prefetch.svg draws it\n";
    const std::vector<std::string> messages = device.value()->validationMessages();
    for (const std::string& message : messages) std::cerr << message << '\n';
    if (!messages.empty())
        return Error{ErrorCode::kDevice, std::to_string(messages.size()) + " validation messages, listed above"};
    return std::all_of(done.begin(), done.end(), [](const StressResult& r) { return r.failures.empty(); }) ? 0 : 1;
}

}  // namespace

Command addStressCommand(CLI::App& app) {
    const auto options = std::make_shared<StressOptions>();
    CLI::App* parser = app.add_subcommand("stress", "Put the streaming of a world through named cases, and judge it");
    parser->add_option("world", options->world, "world file")->required();
    parser->add_option("--path", options->path, "camera path, TUM trajectory: a case of its own");
    parser->add_option("--case", options->cases, "name of a case; may be given again; all by default")
        ->allow_extra_args(false);
    parser->add_flag("--list", options->list, "print the cases and stop");
    parser->add_flag("--prefetch", options->prefetch,
                     "instead: a winding flight without prefetch, by speed, and with its way known beforehand");
    parser->add_option("--seconds", options->plan.seconds, "motion of each case [s]");
    parser->add_option("--seed", options->plan.seed, "of jumps and of the virtual disk");
    parser->add_option("--compare", options->compareEvery,
                       "hold every Nth frame against a system that has the world in memory");
    parser->add_option("--clock", options->clock, "virtual: a modelled disk, the same every time; live: the real one")
        ->check(CLI::IsMember({"virtual", "live"}));
    server::ShadowConfig& shadow = options->plan.config;
    parser->add_option("--cascades", shadow.cascades, "cascades, 1 to 8");
    parser->add_option("--resolution", shadow.side, "texels a side of each map, 64 to 8192");
    parser->add_option("--far", shadow.farDistance, "how far from the eye shadows reach [m]");
    parser->add_option("--out", options->out, "folder for stress.json and each case's frames.csv; NAME.stress by default");
    parser->add_option("--results", options->results, "add each case to this results file; gnomon report reads it");
    parser->add_option("--device", options->device.nameContains, "use the first device whose name contains this");
    parser->add_flag("--validation", options->device.validation, "Vulkan's core and synchronization validation");
    return {parser, [options] { return runStressCommand(*options); }};
}

}  // namespace tools
