#include "tools/report_command.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "tools/image.h"
#include "tools/output_folder.h"
#include "tools/progress.h"
#include "tools/report/apng.h"
#include "tools/report/difference.h"
#include "tools/report/exports.h"
#include "tools/report/gate.h"
#include "tools/report/page.h"

namespace tools {
namespace {

using report::RunFile;
using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

constexpr double kPictureSeconds = 0.8;  ///< that a frame of an animation is shown

struct ReportOptions {
    std::vector<std::string> runs;
    std::string output, rules, exported;  ///< empty: none
    bool difference = false;
};

Error usage(std::string what) { return {ErrorCode::kUsage, std::move(what)}; }

Result<Done> writeBytes(const std::string& path, const std::vector<std::byte>& bytes) {
    return writeText(path, std::string(reinterpret_cast<const char*>(bytes.data()), bytes.size()));
}

/// All cascades of a frame one under the other, frame after frame.
Result<std::vector<std::byte>> animation(RunFile& run) {
    const auto pictures = run.pictures();
    if (!pictures) return pictures.error();
    std::map<uint64_t, RgbImage> frames;
    for (const DumpedPicture& picture : pictures.value()) {
        const auto image = imageOf(picture.png);
        if (!image) return Error{image.error().code, run.name() + ": " + image.error().what};
        RgbImage& all = frames[picture.frame];
        if (all.height > 0 && all.width != image.value().width)
            return Error{ErrorCode::kBadData, run.name() + ": pictures of frame " + std::to_string(picture.frame) + " are of several sizes; run again with --dump"};
        all.width = image.value().width;
        all.height += image.value().height;
        all.pixels.insert(all.pixels.end(), image.value().pixels.begin(), image.value().pixels.end());
    }
    std::vector<std::vector<std::byte>> pngs;
    for (const auto& [frame, image] : frames) {
        auto png = pngOf(image);
        if (!png) return png.error();
        pngs.push_back(std::move(png.value()));
    }
    auto bytes = report::animated(pngs, kPictureSeconds);
    if (!bytes) return Error{bytes.error().code, run.name() + ": " + bytes.error().what};
    return bytes;
}

Result<Done> writeCsvFile(RunFile& run, const std::string& path, const report::Follow& follow) {
    const std::string partial = path + ".partial";
    std::ofstream out(partial, std::ios::binary);
    const auto written = report::writeCsv(run, out, follow);
    out.close();
    std::error_code error;
    if (written && out) std::filesystem::rename(partial, path, error);
    if (written && out && !error) return Done{};
    std::filesystem::remove(partial, error);
    return written ? Error{ErrorCode::kIo, path + ": cannot be written; make room or give another file"} : written.error();
}

Result<Done> writeExport(RunFile& run, const std::string& path, const report::Follow& follow) {
    if (path.ends_with(".csv")) return writeCsvFile(run, path, follow);
    if (path.ends_with(".json.gz")) return report::writeTimeline(run, path, follow);
    if (path.ends_with(".json")) {
        const auto json = report::benchmarkJson(run, follow);
        return json ? writeText(path, json.value()) : json.error();
    }
    if (path.ends_with(".png")) {
        const auto bytes = animation(run);
        return bytes ? writeBytes(path, bytes.value()) : bytes.error();
    }
    return usage("--export " + path + ": its end says what it is; give .csv for the frames' rows, .json for a benchmark's figures, .json.gz "
                 "for a timeline, .png for an animation of the pictures");
}

/// What is to be said of the page.
Result<std::string> writePage(std::vector<RunFile>& runs, const std::string& path, const report::Follow& follow) {
    const auto page = report::reportPage(runs, follow);
    if (!page) return page.error();
    if (const auto done = writeText(path, page.value().html); !done) return done.error();
    std::string said = path + " shows it\n";
    for (const auto& [run, frames] : page.value().unpictured) {
        said += run + ": for pictures of its dearest frames give the replay --dump FOLDER --dump-frames ";
        for (size_t k = 0; k < frames.size(); ++k) {
            if (k > 0) said += ',';
            said += std::to_string(frames[k]);
        }
        said += '\n';
    }
    return said;
}

Result<int> runReport(const ReportOptions& options) {
    std::vector<RunFile> runs;
    for (const std::string& word : options.runs) {
        auto run = RunFile::open(word);
        if (!run) return run.error();
        runs.push_back(std::move(run.value()));
    }
    if (options.difference && runs.size() != 2) return usage("--diff: give two runs, the one before first");
    if (!options.rules.empty() && !options.difference && runs.size() != 1) return usage("--gate: give one run, or two with --diff");
    if (!options.exported.empty() && runs.size() != 1) return usage("--export: give one run");
    std::optional<std::vector<report::Rule>> rules;
    if (!options.rules.empty()) {
        auto read = report::readRules(options.rules, runs.front().columns());
        if (!read) return read.error();
        rules = std::move(read.value());
    }
    std::optional<Progress> progress;
    const double start = steadySeconds();
    const auto follow = [&](size_t done, size_t total) {
        if (!progress && steadySeconds() < start + 1) return;  // done before anybody looks
        if (!progress) progress.emplace("report", std::cerr, stderrIsTerminal());
        progress->at(done, total);
    };
    std::string said;
    if (options.difference) {
        const auto difference = report::compare(runs[0], runs[1], follow);
        if (!difference) return difference.error();
        said += report::toText(difference.value());
    }
    bool kept = true;
    if (rules) {
        const auto verdicts = report::judge(*rules, runs.back(), options.difference ? &runs.front() : nullptr);
        if (!verdicts) return verdicts.error();
        said += (said.empty() ? "" : "\n") + report::toText(verdicts.value());
        for (const report::Verdict& v : verdicts.value()) kept = kept && v.kept;
    }
    if (!options.exported.empty()) {
        if (const auto done = writeExport(runs.front(), options.exported, follow); !done) return done.error();
        said += options.exported + " holds it\n";
    }
    const bool asked = options.difference || rules || !options.exported.empty();
    const std::string page = options.output.empty() && !asked ? "report.html" : options.output;
    if (!page.empty()) {
        const auto written = writePage(runs, page, follow);
        if (!written) return written.error();
        said += written.value();
    }
    progress.reset();
    std::cout << said;
    return kept ? 0 : 1;
}

}  // namespace

Command addReportCommand(CLI::App& app) {
    const auto options = std::make_shared<ReportOptions>();
    CLI::App* parser = app.add_subcommand("report", "Show, compare, judge or export runs that --results kept");
    parser->add_option("runs", options->runs, "FILE for its newest run, FILE#NUMBER for another")->required();
    parser->add_option("-o,--output", options->output, "the page; report.html by default, unless something else is asked for");
    parser->add_flag("--diff", options->difference, "two runs of one path: what got dearer or cheaper by cause, place and caster");
    parser->add_option("--gate", options->rules,
                       "rules, or a file of them, as in 'triangles.p99 <= 1.05x; unknown_texels.max == 0': exit status 1 if one is broken. "
                       "An x asks for --diff: a multiple of the first run");
    parser->add_option("--export", options->exported,
                       "FILE.csv: the frames' rows; FILE.json: figures as Google Benchmark writes them; FILE.json.gz: a timeline for Perfetto; "
                       "FILE.png: an animation of the pictures");
    return {parser, [options] { return runReport(*options); }};
}

}  // namespace tools
