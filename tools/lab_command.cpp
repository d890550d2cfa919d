#include "tools/lab_command.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>
#include <string>
#include <utility>

#include "tools/input_hash.h"
#include "tools/lab/judge_all.h"
#include "tools/lab/session.h"
#include "tools/lab/suite.h"
#include "tools/method_file.h"
#include "tools/progress.h"
#include "tools/results_store.h"

namespace tools {
namespace {

using world::Error;
using world::ErrorCode;
using world::Result;

struct LabOptions {
    lab::SessionOptions session;
    std::string methods;
    std::string out;  ///< empty: NAME.lab
    std::string results;  ///< a results file; empty: none
    bool suite = false;
    bool occlusion = false;
};

Result<std::vector<culling::ShadowMethod>> methodsOf(const std::string& names) {
    std::vector<culling::ShadowMethod> methods;
    if (names.empty()) return culling::namedMethods();
    std::istringstream list(names);
    for (std::string name; std::getline(list, name, ',');) {
        auto method = methodFromWord(name);
        if (!method) return method.error();
        methods.push_back(std::move(method.value()));
    }
    return methods;
}

/// What goes into a results file when all methods are done.
struct Recording {
    ResultsStore store;
    RunRecord run;
    std::vector<lab::MethodRecord> methods;
};

/// None where no results were asked for.
Result<std::optional<Recording>> openRecording(const LabOptions& options, const lab::Session& session) {
    if (options.results.empty()) return std::optional<Recording>();
    auto run = beginRecord("lab", *session.store, options.session.world, *session.device);
    if (!run) return run.error();
    RunRecord& r = run.value();
    r.path = std::filesystem::path(options.session.path).filename().string();
    r.pathHash = hexOf(hashPoses(session.poses, 0));
    r.movers = std::filesystem::path(options.session.movers).filename().string();
    if (!session.movers.empty()) r.moversHash = hexOf(hashMovers(session.movers, 0));
    r.frames = session.poses.size();
    r.settings = nlohmann::ordered_json{{"far_m", session.setting->farDistance}, {"vertical_fov_rad", session.setting->verticalFov},
                                        {"width", session.run.width}, {"height", session.run.height}, {"every", session.run.every}}
                     .dump();
    r.summary = "{}";
    auto store = ResultsStore::open(options.results);
    if (!store) return store.error();
    return std::optional<Recording>(Recording{std::move(store.value()), std::move(r), {}});
}

Result<int64_t> record(Recording& recording) {
    for (const lab::MethodRecord& method : recording.methods)
        if (const auto added = recording.store.add(method); !added) return added.error();
    return recording.store.commit(recording.run.ended());
}

Result<int> runLab(const LabOptions& options) {
    if (options.session.world.empty() || options.session.path.empty())
        return Error{ErrorCode::kUsage, "lab: give a world file and a camera's --path, or --suite, which needs neither"};
    Result<std::vector<culling::ShadowMethod>> methods = std::vector<culling::ShadowMethod>();
    if (!options.occlusion || !options.methods.empty()) methods = methodsOf(options.methods);
    if (!methods) return methods.error();
    const auto session = lab::openSession(options.session);
    if (!session) return session.error();
    lab::Session& s = *session.value();
    s.run.methods = std::move(methods.value());
    s.run.sunRadius = lab::kSunRadius;
    s.setting->shadingTimed = true;
    std::optional<Progress> progress;
    const auto follow = [&](const std::string& name) -> lab::Follow {
        progress.emplace(name, std::cerr, stderrIsTerminal());
        return [&progress](size_t done, size_t total) { progress->at(done, total); };
    };
    auto recording = openRecording(options, s);
    if (!recording) return recording.error();
    bool headed = false;
    const auto show = [&](const lab::MethodRecord& method) {
        progress.reset();
        if (recording.value()) recording.value()->methods.push_back(method);
        if (!std::exchange(headed, true)) std::printf("%s\n", lab::tableHead().c_str());
        std::printf("%s\n", lab::tableRow(method).c_str());
        std::fflush(stdout);
    };
    const std::string& world = options.session.world;
    const std::string out = options.out.empty() ? lab::defaultFolder(world) : options.out;
    const lab::RunFiles files{world, options.session.path, options.session.movers};
    if (options.occlusion) {
        const auto records = lab::judgeOcclusion(*s.setting, files, s.poses, s.run, out, follow);
        progress.reset();
        if (!records) return records.error();
        std::printf("%s\n", lab::occlusionTable(records.value()).c_str());
        std::fflush(stdout);
    }
    if (options.methods.empty() && !options.occlusion) {
        const auto claims = lab::judgeSuite(*s.setting, files, s.poses, s.run, out, follow);
        progress.reset();
        if (!claims) return claims.error();
        const auto wrong = std::count_if(claims.value().begin(), claims.value().end(), [](const auto& c) { return c.wrong; });
        if (wrong > 0) std::cerr << "failure suite: " << wrong << " wrong verdicts; gnomon lab --suite tells them\n";
    }
    const auto page = lab::judgeAll(*s.setting, files, s.poses, s.run, out, show, follow);
    progress.reset();
    if (!page) return page.error();
    if (recording.value())
        if (const auto kept = record(*recording.value()); !kept) return kept.error();
    std::printf("\n%s shows them.\n", page.value().c_str());
    return 0;
}

/// Plays the failure suite: 1 if a verdict is wrong.
Result<int> runSuite(const gpu::DeviceConfig& config) {
    auto device = gpu::Device::create(config);
    if (!device) return device.error();
    bool sound = true;
    std::cout << lab::suiteHead();
    for (const lab::SuiteCase& c : lab::suiteCases()) {
        const auto results = lab::runCase(*device.value(), c);
        if (!results) return results.error();
        std::cout << lab::suiteRows(c, results.value()) << std::flush;
        for (const lab::ClaimResult& r : results.value()) sound = sound && !lab::wrong(r.verdict);
    }
    const std::vector<std::string> messages = device.value()->validationMessages();
    for (const std::string& message : messages) std::cerr << message << '\n';
    return sound && messages.empty() ? 0 : 1;
}

}  // namespace

Command addLabCommand(CLI::App& app) {
    const auto options = std::make_shared<LabOptions>();
    CLI::App* parser = app.add_subcommand("lab", "Judge shadow methods by ray tracing along a recorded path");
    lab::addSessionOptions(*parser, options->session);
    parser->add_option("--methods", options->methods,
                       "names, with commas between them, each with settings if you like: gnomon,gnomon:filter=box3:side=2048, "
                       "or files NAME.toml; all by default");
    parser->add_option("--out", options->out, "folder for lab.html and lab.sqlite; NAME.lab by default. What is there already "
                                              "is not run again");
    parser->add_option("--results", options->results, "add the run to this results file; gnomon report reads it");
    parser->add_flag("--occlusion", options->occlusion, "leave casters out of gnomon's maps as hidden, by 1 to 64 rays each and by proof, "
                                                        "and tell what that saves and breaks; without --methods no method is judged");
    // The suite needs no world, and takes of all options those of the device alone.
    parser->get_option("world")->required(false);
    parser->get_option("--path")->required(false);
    CLI::Option* suite = parser->add_flag("--suite", options->suite, "instead: run methods where they are known to fail, in small worlds of their own");
    for (CLI::Option* option : parser->get_options())
        if (const std::string name = option->get_name(); name != "--help" && name != "--device" && name != "--validation" && name != "--suite")
            suite->excludes(option);
    return {parser, [options] { return options->suite ? runSuite(options->session.device) : runLab(*options); }};
}

}  // namespace tools
