#include "tools/lab_command.h"

#include <algorithm>
#include <cstdio>
#include <iostream>
#include <memory>
#include <optional>
#include <sstream>
#include <string>

#include "tools/lab/session.h"
#include "tools/method_file.h"
#include "tools/progress.h"

namespace tools {
namespace {

using world::Result;

struct LabOptions {
    lab::SessionOptions session;
    std::string methods;
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
    const auto session = lab::openSession(options.session);
    if (!session) return session.error();
    const lab::Session& s = *session.value();
    const auto truth = lab::truthOf(s, options.session);
    if (!truth) return truth.error();
    printHead();
    std::optional<Progress> progress;
    const auto follow = [&](const culling::ShadowMethod& method) {
        progress.emplace(method.name, std::cerr, stderrIsTerminal());
        return [&progress](size_t done, size_t total) { progress->at(done, total); };
    };
    for (const culling::ShadowMethod& method : methods.value()) {
        const auto result = lab::judgeMethod(*s.setting, s.poses, truth.value(), method, follow(method));
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
    lab::addSessionOptions(*parser, options->session);
    parser->add_option("--methods", options->methods,
                       "names, with commas between them, each with settings if you like: gnomon,gnomon:filter=box3:side=2048, "
                       "or files NAME.toml; all by default");
    return {parser, [options] { return runLab(*options); }};
}

}  // namespace tools
