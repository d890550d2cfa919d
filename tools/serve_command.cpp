#include "tools/serve_command.h"

#include <CLI/CLI.hpp>
#include <absl/synchronization/mutex.h>

#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <nlohmann/json.hpp>

#include "server/http_server.h"
#include "server/library_log.h"
#include "server/live_board.h"
#include "server/local_host.h"
#include "server/service.h"
#include "server/worker_host.h"
#include "server/worker_loop.h"
#include "server/world_folder.h"
#include "tools/method_file.h"
#include "tools/option_file.h"
#include "tools/temporary_folder.h"

namespace tools {
namespace {

using world::Error;
using world::ErrorCode;
using world::Result;

struct ServeOptions {
    server::ServiceConfig service;
    server::SessionLimits session;
    std::string worlds;
    bool worker = false;  ///< it draws for the process that started it
    server::TlsFiles tls;
    std::string config, maps;
    int httpPort = -1;  ///< -1: no page
    gpu::DeviceConfig device;
    double messageMiB = 64, residentMiB = 1024, geometryMiB = 256, mapMiB = 1024, stopSeconds = 10;
};

/// One JSON object a line, on standard output.
void log(const server::ServiceEvent& event) {
    std::timespec now{};
    std::timespec_get(&now, TIME_UTC);
    char time[40];
    std::tm utc{};
    gmtime_r(&now.tv_sec, &utc);
    const size_t length = std::strftime(time, sizeof time, "%Y-%m-%dT%H:%M:%S", &utc);
    std::snprintf(time + length, sizeof time - length, ".%03ldZ", now.tv_nsec / 1'000'000);
    nlohmann::ordered_json line{{"time", time}, {"event", event.what}};
    if (event.session > 0) line["session"] = event.session;
    if (!event.detail.empty()) line["detail"] = event.detail;
    if (event.frames > 0) line["frames"] = event.frames;
    std::printf("%s\n", line.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace).c_str());
    std::fflush(stdout);
}

uint64_t bytesOf(double mebibytes) { return uint64_t(mebibytes * 1048576); }

/// As this process was called.
std::vector<std::string> ownCommandLine() {
    std::ifstream file("/proc/self/cmdline", std::ios::binary);
    const std::string all{std::istreambuf_iterator<char>(file), {}};
    std::vector<std::string> words;
    for (size_t at = 0; at < all.size();) {
        const size_t end = std::min(all.find('\0', at), all.size());
        words.push_back(all.substr(at, end - at));
        at = end + 1;
    }
    return words;
}

/// The front end: takes clients, and has another process draw for them.
Result<int> supervise(ServeOptions& options, const sigset_t& ends) {
    const auto folder = server::WorldFolder::create(options.worlds);
    if (!folder) return folder.error();
    const char* runtimes = std::getenv("XDG_RUNTIME_DIR");
    const TemporaryFolder runtime(runtimes && *runtimes ? std::filesystem::path(runtimes) : std::filesystem::temp_directory_path());
    if (runtime.path().empty()) return Error{ErrorCode::kIo, "serve: no temporary folder can be made; set TMPDIR"};
    server::WorkerConfig config;
    std::vector<std::string> words = ownCommandLine();
    words.front() = "/proc/self/exe";
    words.push_back("--worker");
    config.command = [words](uint64_t) { return words; };
    int page = 0;
    if (options.httpPort >= 0) {
        const auto listening = server::HttpServer::listen({.port = uint16_t(options.httpPort)});
        if (!listening) return listening.error();
        config.inherited = listening.value();
        page = server::HttpServer::portOf(config.inherited);
    }
    const auto worker = server::Worker::start(config, [](const std::string& what) { log({"worker", 0, what, 0}); });
    if (!worker) return worker.error();
    const auto host = server::makeWorkerHost(*worker.value(), [](uint64_t session, const std::string& what) {
        log({"worker", session, what, 0});
    });
    if (options.service.record.empty()) {
        options.service.record = runtime.path();
        options.service.keepRecordings = false;
    }
    const auto service = server::Service::start(*host, options.service, log);
    if (!service) return service.error();
    if (options.httpPort >= 0) log({"page", 0, "http://127.0.0.1:" + std::to_string(page) + "/", 0});
    int signal = 0;
    sigwait(&ends, &signal);
    service.value()->stop(std::chrono::milliseconds(int64_t(options.stopSeconds * 1e3)));
    return 0;
}

/// Draws for the process that started this one, until that ends.
Result<int> work(ServeOptions& options) {
    auto device = gpu::Device::create(options.device);
    if (!device) return device.error();
    server::LiveBoard board;
    const auto host = server::makeLocalHost(*device.value(), options.worlds, options.session, &board);
    if (!host) return host.error();
    std::unique_ptr<server::HttpServer> http;
    if (options.httpPort >= 0) {
        auto started = server::HttpServer::start(board, {.socket = server::kWorkerInherited});
        if (!started) return started.error();
        http = std::move(started.value());
    }
    board.setReady(true);
    const auto done = server::runWorker(*host.value(), server::kWorkerLine);
    if (!done) return done.error();
    return 0;
}

Result<int> runServe(ServeOptions& options, CLI::App& parser) {
    if (!options.config.empty())
        if (const auto read = readOptionFile(parser, options.config); !read) return read.error();
    if (options.worlds.empty()) return Error{ErrorCode::kUsage, "serve: give --worlds, the folder of the worlds to serve"};
    const int tlsGiven = !options.tls.certificate.empty() + !options.tls.key.empty() + !options.tls.authority.empty();
    if (tlsGiven != 0 && tlsGiven != 3) return Error{ErrorCode::kUsage, "TLS: give all three of --tls-certificate, --tls-key and --tls-clients"};
    if (tlsGiven == 3) options.service.tls = options.tls;
    options.service.messageBytes = bytesOf(options.messageMiB);
    options.session.residentBytes = bytesOf(options.residentMiB);
    options.session.geometryBytes = bytesOf(options.geometryMiB);
    options.session.mapBytes = bytesOf(options.mapMiB);

    if (!options.maps.empty()) {
        const auto method = methodFromWord(options.maps);
        if (!method) return method.error();
        if (const auto good = apply(method.value(), options.service.maps); !good) return good.error();
    }

    // Before any thread is made, so that all of them leave these signals to this one.
    sigset_t ends;
    sigemptyset(&ends);
    for (const int signal : {SIGTERM, SIGINT, SIGHUP}) sigaddset(&ends, signal);
    pthread_sigmask(SIG_BLOCK, &ends, nullptr);
    std::signal(SIGPIPE, SIG_IGN);
    absl::SetMutexDeadlockDetectionMode(absl::OnDeadlockCycle::kIgnore);  // gRPC's locks; Debian's build watches their order
    server::listenToLibraries([](const std::string& line) { log({"grpc", 0, line, 0}); });
    return options.worker ? work(options) : supervise(options, ends);
}

}  // namespace

Command addServeCommand(CLI::App& app) {
    const auto options = std::make_shared<ServeOptions>();
    CLI::App* parser = app.add_subcommand("serve", "Serve worlds to simulations over gRPC");
    const auto above = CLI::Range(1e-3, 1e9);
    parser->add_option("--config", options->config, "TOML file with any of these options as keys; the command line wins");
    parser->add_option("--worlds", options->worlds, "folder whose NAME.world files are served");
    parser->add_option("--listen", options->service.listen, "HOST:PORT, port 0 for any, or unix:PATH; beyond this machine with TLS only")->capture_default_str();
    parser->add_option("--tls-certificate", options->tls.certificate, "the server's certificate (PEM)");
    parser->add_option("--tls-key", options->tls.key, "its key (PEM)");
    parser->add_option("--tls-clients", options->tls.authority, "the authority that signs clients' certificates (PEM)");
    parser->add_option("--maps", options->maps, "the maps' settings where a session leaves them open: a file NAME.toml, as gnomon tune writes it, or gnomon:SETTING=VALUE");
    parser->add_option("--http", options->httpPort, "port of this machine for the live page, /healthz, /readyz and /metrics, 0 for any; none by default")
        ->check(CLI::Range(0, 65535));
    parser->add_option("--record", options->service.record, "folder for a recording of each session; none by default");
    parser->add_option("--share", options->service.share, "path of a Unix socket where clients on this host fetch the memory of their maps; none by default");
    parser->add_option("--operator", options->service.operatorFile, "file that gets a token for `gnomon ctl dump`, readable by this user alone; none by default");
    parser->add_option("--sessions", options->service.sessions, "open at the same time")->check(CLI::Range(1, 4096))->capture_default_str();
    parser->add_option("--objects", options->session.objects, "that a session may have")->capture_default_str();
    parser->add_option("--updates", options->session.updates, "of objects in one frame")->capture_default_str();
    parser->add_option("--edits", options->session.edits, "of the ground in one frame")->capture_default_str();
    parser->add_option("--spots", options->session.spots, "updates of spot lights in one frame")->capture_default_str();
    parser->add_option("--query-points", options->session.queryPoints, "of one QueryShadow")->capture_default_str();
    parser->add_option("--message-mib", options->messageMiB, "longest request [MiB]")->check(CLI::Range(0.001, 256.0))->capture_default_str();
    parser->add_option("--map-mib", options->mapMiB, "shadow maps of a session [MiB]")->check(above)->capture_default_str();
    parser->add_option("--resident-mib", options->residentMiB, "chunks and meshes of a session [MiB]")->check(above)->capture_default_str();
    parser->add_option("--geometry-mib", options->geometryMiB, "of these, on the GPU [MiB]")->check(above)->capture_default_str();
    parser->add_option("--idle-seconds", options->service.idleSeconds, "without a request a session ends [s]")->check(above)->capture_default_str();
    parser->add_option("--unread-seconds", options->service.unreadSeconds, "a reply waits for its reader [s]")->check(above)->capture_default_str();
    parser->add_option("--silent-seconds", options->service.silentSeconds, "a connection says nothing before it is asked for a sign of life, which may take as long [s]")->check(above)->capture_default_str();
    parser->add_option("--stop-seconds", options->stopSeconds, "a frame may go on after SIGTERM [s]")->check(CLI::Range(0.0, 3600.0))->capture_default_str();
    parser->add_flag("--worker", options->worker, "how the front end starts the process that draws")->group("");
    parser->add_option("--lose-device-after", options->device.loseAfter, "for tests: submissions until the device counts as lost")->group("");
    parser->add_option("--device", options->device.nameContains, "use the first device whose name contains this");
    return {parser, [options, parser] { return runServe(*options, *parser); }};
}

}  // namespace tools
