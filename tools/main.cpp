// tools/main.cpp — the `gnomon` command. Exit status: 0 done, 1 maps differ, 2 usage, 3 data or machine.
#include <CLI/CLI.hpp>
#include <malloc.h>

#include <iostream>

#include "tools/bake_command.h"
#include "tools/ctl_command.h"
#include "tools/edit_command.h"
#include "tools/info_command.h"
#include "tools/lab_command.h"
#include "tools/options.h"
#include "tools/replay_command.h"
#include "tools/report_command.h"
#include "tools/serve_command.h"
#include "tools/soak_command.h"
#include "tools/stress_command.h"
#include "tools/sweep_command.h"
#include "tools/tune_command.h"

namespace {

/// Larger blocks get pages of their own, and give them back when they are freed. It is what glibc begins with, but there
/// the first large block that is freed raises it, and from then on maps, meshes and reads leave holes between small blocks
/// that stay: in a soak of a world whose ground is edited, half of the heap, and more with time.
constexpr int kLargeBlock = 128 << 10;

}  // namespace

int main(int argc, char** argv) {
    mallopt(M_MMAP_THRESHOLD, kLargeBlock);
    CLI::App app("Gnomon: cached shadow maps for streaming open worlds", "gnomon");
    app.require_subcommand(1);
    app.failure_message([](const CLI::App*, const CLI::Error& error) {
        return "gnomon: " + std::string(error.what()) + "; --help lists the options\n";
    });
    const tools::Command commands[] = {tools::addBakeCommand(app), tools::addInfoCommand(app),
                                       tools::addReplayCommand(app), tools::addSoakCommand(app),
                                       tools::addStressCommand(app), tools::addEditCommand(app),
                                       tools::addLabCommand(app), tools::addTuneCommand(app),
                                       tools::addReportCommand(app), tools::addServeCommand(app),
                                       tools::addCtlCommand(app), tools::addSweepCommand(app)};
    try {
        app.parse(argc, argv);
    } catch (const CLI::ParseError& error) {
        return app.exit(error) == 0 ? 0 : 2;
    }
    for (const tools::Command& command : commands) {
        if (!command.parser->parsed()) continue;
        const auto status = command.run();
        if (status) return status.value();
        std::cout.flush();
        std::cerr << "gnomon: " << status.error().what << '\n';
        return tools::exitStatus(status.error().code);
    }
    return 2;
}
