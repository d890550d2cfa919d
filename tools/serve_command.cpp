#include "tools/serve_command.h"

#include <CLI/CLI.hpp>

#include <csignal>
#include <cstdio>
#include <ctime>
#include <memory>
#include <nlohmann/json.hpp>

#include "server/http_server.h"
#include "server/live_board.h"
#include "server/service.h"
#include "tools/method_file.h"
#include "tools/option_file.h"

namespace tools {
namespace {

using world::Error;
using world::ErrorCode;
using world::Result;

struct ServeOptions {
    server::ServiceConfig service;
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

Result<int> runServe(ServeOptions& options, CLI::App& parser) {
    if (!options.config.empty())
        if (const auto read = readOptionFile(parser, options.config); !read) return read.error();
    if (options.service.worlds.empty()) return Error{ErrorCode::kUsage, "serve: give --worlds, the folder of the worlds to serve"};
    const int tlsGiven = !options.tls.certificate.empty() + !options.tls.key.empty() + !options.tls.authority.empty();
    if (tlsGiven != 0 && tlsGiven != 3) return Error{ErrorCode::kUsage, "TLS: give all three of --tls-certificate, --tls-key and --tls-clients"};
    if (tlsGiven == 3) options.service.tls = options.tls;
    options.service.messageBytes = bytesOf(options.messageMiB);
    options.service.session.residentBytes = bytesOf(options.residentMiB);
    options.service.session.geometryBytes = bytesOf(options.geometryMiB);
    options.service.session.mapBytes = bytesOf(options.mapMiB);

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

    auto device = gpu::Device::create(options.device);
    if (!device) return device.error();
    server::LiveBoard board;
    options.service.board = &board;
    const auto service = server::Service::start(*device.value(), options.service, log);
    if (!service) return service.error();
    std::unique_ptr<server::HttpServer> http;
    if (options.httpPort >= 0) {
        auto started = server::HttpServer::start(board, {.port = uint16_t(options.httpPort)});
        if (!started) return started.error();
        http = std::move(started.value());
        log({"page", 0, "http://127.0.0.1:" + std::to_string(http->port()) + "/", 0});
    }
    int signal = 0;
    sigwait(&ends, &signal);
    service.value()->stop(std::chrono::milliseconds(int64_t(options.stopSeconds * 1e3)));
    return 0;
}

}  // namespace

Command addServeCommand(CLI::App& app) {
    const auto options = std::make_shared<ServeOptions>();
    CLI::App* parser = app.add_subcommand("serve", "Serve worlds to simulations over gRPC");
    const auto above = CLI::Range(1e-3, 1e9);
    parser->add_option("--config", options->config, "TOML file with any of these options as keys; the command line wins");
    parser->add_option("--worlds", options->service.worlds, "folder whose NAME.world files are served");
    parser->add_option("--listen", options->service.listen, "HOST:PORT, port 0 for any, or unix:PATH; beyond this machine with TLS only")->capture_default_str();
    parser->add_option("--tls-certificate", options->tls.certificate, "the server's certificate (PEM)");
    parser->add_option("--tls-key", options->tls.key, "its key (PEM)");
    parser->add_option("--tls-clients", options->tls.authority, "the authority that signs clients' certificates (PEM)");
    parser->add_option("--maps", options->maps, "the maps' settings where a session leaves them open: a file NAME.toml, as gnomon tune writes it, or gnomon:SETTING=VALUE");
    parser->add_option("--http", options->httpPort, "port of this machine for the live page, /healthz, /readyz and /metrics, 0 for any; none by default")
        ->check(CLI::Range(0, 65535));
    parser->add_option("--record", options->service.record, "folder for a recording of each session; none by default");
    parser->add_option("--sessions", options->service.sessions, "open at the same time")->check(CLI::Range(1, 4096))->capture_default_str();
    parser->add_option("--objects", options->service.session.objects, "that a session may have")->capture_default_str();
    parser->add_option("--updates", options->service.session.updates, "of objects in one frame")->capture_default_str();
    parser->add_option("--edits", options->service.session.edits, "of the ground in one frame")->capture_default_str();
    parser->add_option("--query-points", options->service.queryPoints, "of one QueryShadow")->capture_default_str();
    parser->add_option("--message-mib", options->messageMiB, "longest request [MiB]")->check(CLI::Range(0.001, 256.0))->capture_default_str();
    parser->add_option("--map-mib", options->mapMiB, "shadow maps of a session [MiB]")->check(above)->capture_default_str();
    parser->add_option("--resident-mib", options->residentMiB, "chunks and meshes of a session [MiB]")->check(above)->capture_default_str();
    parser->add_option("--geometry-mib", options->geometryMiB, "of these, on the GPU [MiB]")->check(above)->capture_default_str();
    parser->add_option("--idle-seconds", options->service.idleSeconds, "without a request a session ends [s]")->check(above)->capture_default_str();
    parser->add_option("--unread-seconds", options->service.unreadSeconds, "a reply waits for its reader [s]")->check(above)->capture_default_str();
    parser->add_option("--stop-seconds", options->stopSeconds, "a frame may go on after SIGTERM [s]")->check(CLI::Range(0.0, 3600.0))->capture_default_str();
    parser->add_option("--device", options->device.nameContains, "use the first device whose name contains this");
    return {parser, [options, parser] { return runServe(*options, *parser); }};
}

}  // namespace tools
