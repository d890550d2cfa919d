#include "tools/tune_command.h"

#include <cstdio>
#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>

#include "tools/lab/session.h"
#include "tools/lab/tune.h"
#include "tools/method_file.h"
#include "tools/options.h"
#include "tools/output_folder.h"
#include "tools/progress.h"

namespace tools {
namespace {

using culling::ShadowMethod;
using world::Error;
using world::ErrorCode;
using world::Result;

struct TuneOptions {
    lab::SessionOptions session;
    lab::TuneLimits limits;
    std::string start = "gnomon", out;
    size_t trials = 40;
};

Result<int> runTune(const TuneOptions& options) {
    constexpr double kAny = std::numeric_limits<double>::infinity();
    if (options.limits.error == kAny && options.limits.instability == kAny && options.limits.cost == kAny)
        return Error{ErrorCode::kUsage, "nothing is limited; give --max-error, --max-instability or --max-cost"};
    const auto start = methodFromWord(options.start);
    if (!start) return start.error();
    if (start.value().keep != culling::Keep::kCached)
        return Error{ErrorCode::kUsage, "method " + options.start + " keeps no cache; tune begins with gnomon, or settings of it"};
    const auto session = lab::openSession(options.session);
    if (!session) return session.error();
    const lab::Session& s = *session.value();
    if (const auto room = lab::requireRoom(*s.setting, start.value()); !room) return room.error();
    auto truths = lab::openTruths(lab::defaultFolder(options.session.world));
    if (!truths) return truths.error();
    std::optional<Progress> progress(std::in_place, "truth", std::cerr, stderrIsTerminal());
    const auto truth = lab::traceTruth(*s.setting, s.poses, lab::judgedFrames(s.poses.size(), s.run.every), s.run, truths.value(),
                                       [&](size_t done, size_t total) { progress->at(done, total); });
    for (const std::string& line : truths.value().damage()) progress->say(line);
    if (!truth) return truth.error();
    progress.emplace("tune", std::cerr, stderrIsTerminal());
    size_t tried = 0;
    const auto tuned = lab::tune(start.value(), options.limits, options.trials, [&](const ShadowMethod& method) -> Result<lab::Trial> {
        const auto result = lab::judgeMethod(*s.setting, s.poses, truth.value(), method, [](size_t, size_t) {});
        if (!result) return result.error();
        progress->at(++tried, options.trials);
        return lab::trialOf(result.value());
    });
    if (!tuned) return tuned.error();
    progress.reset();
    const std::string text = lab::tuneText(tuned.value(), options.limits);
    std::cout << text;
    if (!tuned.value().met) return 1;
    const std::string out = options.out.empty() ? std::filesystem::path(options.session.world).stem().string() + ".toml" : options.out;
    const ShadowMethod& best = tuned.value().trials[tuned.value().best].method;
    if (const auto written = writeText(out, methodFileText(best, "gnomon", "Tuned on " + options.session.path + ".\n" + text)); !written)
        return written.error();
    std::cout << out << " has it; gnomon lab --methods, gnomon replay --config and gnomon serve --maps take it\n";
    return 0;
}

}  // namespace

Command addTuneCommand(CLI::App& app) {
    const auto options = std::make_shared<TuneOptions>();
    CLI::App* parser = app.add_subcommand("tune", "Find the cheapest settings of the maps that keep stated limits along a path");
    lab::addSessionOptions(*parser, options->session);
    const auto limit = within(0, 1e12);
    parser->add_option("--max-error", options->limits.error, "false lit and false shadow [% of the pixels that face the sun]")->check(limit);
    parser->add_option("--max-instability", options->limits.instability, "flips per million points")->check(limit);
    parser->add_option("--max-cost", options->limits.cost,
                       "triangles a frame, 11 texels redrawn counted as one; alone, the least error is sought")->check(limit);
    parser->add_option("--start", options->start, "settings to begin with");
    parser->add_option("--trials", options->trials, "most configurations to try")->check(CLI::Range(1, 10000));
    parser->add_option("--out,-o", options->out, "file for the answer; NAME.toml by default");
    return {parser, [options] { return runTune(*options); }};
}

}  // namespace tools
