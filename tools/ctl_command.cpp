#include "tools/ctl_command.h"

#include <CLI/CLI.hpp>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <map>
#include <memory>
#include <thread>

#include "server/client.h"
#include "tools/image.h"

namespace tools {
namespace {

namespace v1 = gnomon::v1;
using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

constexpr double kReachSeconds = 5;    // a server that is there answers at once
constexpr double kAnswerSeconds = 30;  // a map waits for the frames of others

struct CtlOptions {
    std::string server = "127.0.0.1:50471";
    server::TlsFiles tls;
    std::string operatorFile;
    std::string session;  ///< a number, or a secret; of `tail` empty: all
    uint32_t cascade = 0;
    bool working = false;
    std::string output;
    uint64_t lines = 0;  ///< of `tail`; 0: until it is stopped
};

Error at(const CtlOptions& options, const Error& error) { return {error.code, options.server + ": " + error.what, error.native}; }

/// A server that answers.
Result<server::Client> reach(const CtlOptions& options) {
    const int given = !options.tls.certificate.empty() + !options.tls.key.empty() + !options.tls.authority.empty();
    ::setenv("GRPC_VERBOSITY", "NONE", 0);  // one line says what is wrong, not one each try
    if (given != 0 && given != 3) return Error{ErrorCode::kUsage, "TLS: give all three of --ca, --cert and --key"};
    auto client = given == 3 ? server::Client::connect(options.server, options.tls) : server::Client::connect(options.server);
    if (!client) return client.error();
    client.value().setPatience(kAnswerSeconds);
    if (const auto healthy = client.value().healthy(kReachSeconds); !healthy)
        return Error{healthy.error().code, options.server + ": " + healthy.error().what +
                                               (given == 3 ? "; give its address as --server, and certificates that it accepts and whose authority signed its own"
                                                           : "; start `gnomon serve`, give its address as --server, and --ca, --cert and --key if it asks for TLS")};
    return client;
}

Result<int> health(const CtlOptions& options) {
    auto client = reach(options);
    if (!client) return client.error();
    const auto worlds = client.value().worlds();
    if (!worlds) return at(options, worlds.error());
    const auto sessions = client.value().sessions();
    if (!sessions) return at(options, sessions.error());
    std::printf("%s serves: worlds %zu, sessions %zu\n", options.server.c_str(), worlds.value().size(), sessions.value().size());
    return 0;
}

Result<int> worlds(const CtlOptions& options) {
    auto client = reach(options);
    if (!client) return client.error();
    const auto names = client.value().worlds();
    if (!names) return at(options, names.error());
    for (const std::string& name : names.value()) std::printf("%s\n", name.c_str());
    return 0;
}

double each(double sum, uint64_t frames) { return frames == 0 ? 0 : sum / double(frames); }

Result<int> sessions(const CtlOptions& options) {
    auto client = reach(options);
    if (!client) return client.error();
    const auto open = client.value().sessions();
    if (!open) return at(options, open.error());
    std::printf("%8s %10s %10s %10s %10s %14s %12s %8s  %s\n", "session", "open s", "frames", "ms/frame", "wait ms", "triangles/frame",
                "resident MiB", "errors", "world");
    for (const v1::SessionInfo& s : open.value())
        std::printf("%8llu %10.1f %10llu %10.3f %10.3f %15.0f %12.1f %8llu  %s\n", static_cast<unsigned long long>(s.number()), s.open_seconds(),
                    static_cast<unsigned long long>(s.frames()), each(s.advance_ms(), s.frames()), each(s.wait_ms(), s.frames()),
                    each(double(s.statics().triangles() + s.active().triangles()), s.frames()), double(s.resident_bytes()) / 1048576,
                    static_cast<unsigned long long>(s.errors()), s.world().c_str());
    return 0;
}

bool isNumber(const std::string& text) {
    return !text.empty() && text.size() < 20 && std::all_of(text.begin(), text.end(), [](char c) { return c >= '0' && c <= '9'; });
}

/// By what the server lets a session be asked: its secret, or its number and the operator's token.
Result<std::string> keyOf(const CtlOptions& options) {
    if (!isNumber(options.session)) return options.session;
    if (options.operatorFile.empty())
        return Error{ErrorCode::kUsage, "session " + options.session + ": by number it needs --operator, the file that `gnomon serve --operator` wrote; "
                                        "else give the session's secret"};
    std::ifstream in(options.operatorFile);
    std::string token;
    if (!(in >> token))
        return Error{ErrorCode::kNotFound, options.operatorFile + ": no token can be read; it is there while `gnomon serve --operator` runs, for its user"};
    return options.session + "@" + token;
}

/// A map in the order of its window, from its low corner.
struct WindowMap {
    std::vector<float> depths;
    int side = 0;
};

Result<WindowMap> windowOf(const std::vector<v1::DepthTile>& tiles) {
    WindowMap map;
    for (const v1::DepthTile& t : tiles) map.side = std::max({map.side, int(std::min(t.x() + t.width(), 8192u)), int(std::min(t.y() + t.height(), 8192u))});
    const Error broken{ErrorCode::kBadData, "the map came in tiles that do not fit each other"};
    if (tiles.empty() || !tiles.front().has_cascade()) return broken;
    const int64_t side = map.side;
    const auto wrapped = [side](int64_t stored, int64_t corner) { return size_t(((stored - corner) % side + side) % side); };
    map.depths.resize(size_t(side * side));
    for (const v1::DepthTile& t : tiles) {
        if (uint64_t(t.x()) + t.width() > uint64_t(side) || uint64_t(t.y()) + t.height() > uint64_t(side) ||
            t.depths().size() != size_t(t.width()) * t.height() * sizeof(float))
            return broken;
        for (uint32_t j = 0; j < t.height(); ++j)
            for (uint32_t i = 0; i < t.width(); ++i)
                std::memcpy(&map.depths[wrapped(t.y() + j, tiles.front().cascade().window_y()) * size_t(side) +
                                        wrapped(t.x() + i, tiles.front().cascade().window_x())],
                            t.depths().data() + (size_t(j) * t.width() + i) * sizeof(float), sizeof(float));
    }
    return map;
}

/// Debevec's portable float map: one number a pixel, rows from the bottom up.
Result<Done> writePfm(const WindowMap& map, const std::string& path) {
    std::ofstream out(path, std::ios::binary);
    out << "Pf\n" << map.side << ' ' << map.side << "\n-1.0\n";
    for (int y = map.side - 1; y >= 0; --y)
        out.write(reinterpret_cast<const char*>(&map.depths[size_t(y) * size_t(map.side)]), std::streamsize(size_t(map.side) * sizeof(float)));
    out.close();
    if (out) return Done{};
    return Error{ErrorCode::kIo, path + ": cannot be written; make room or give another --output"};
}

Result<int> dump(const CtlOptions& options) {
    const bool png = options.output.ends_with(".png");
    if (!png && !options.output.ends_with(".pfm")) return Error{ErrorCode::kUsage, options.output + ": neither .png (16 bits) nor .pfm (floats); end it in one of them"};
    const auto key = keyOf(options);
    if (!key) return key.error();
    auto client = reach(options);
    if (!client) return client.error();
    v1::GetDepthMapRequest request;
    request.set_session(key.value());
    request.set_cascade(options.cascade);
    request.set_working(options.working);
    const auto tiles = client.value().depthMap(request);
    if (!tiles) return at(options, tiles.error());
    const auto map = windowOf(tiles.value());
    if (!map) return at(options, map.error());
    const auto written = png ? writeDepthPng(map.value().depths, map.value().side, options.output) : writePfm(map.value(), options.output);
    if (!written) return written.error();
    const v1::Cascade& c = tiles.value().front().cascade();
    std::printf("%s: %d x %d texels of %g m from (%lld, %lld), depths %g m + %g m * d, after frame %llu\n", options.output.c_str(), map.value().side,
                map.value().side, c.texel(), static_cast<long long>(c.window_x()), static_cast<long long>(c.window_y()), c.depth_near(), c.depth_range(),
                static_cast<unsigned long long>(tiles.value().front().frame()));
    return 0;
}

/// What sessions did between two looks.
struct Pace {
    uint64_t sessions = 0, frames = 0, texels = 0, triangles = 0, errors = 0;
    double advanceMs = 0, waitMs = 0;
};

Pace paceOf(const std::vector<v1::SessionInfo>& now, const std::map<uint64_t, v1::SessionInfo>& before) {
    Pace pace;
    for (const v1::SessionInfo& s : now) {
        const auto found = before.find(s.number());
        const v1::SessionInfo old = found == before.end() ? v1::SessionInfo() : found->second;
        ++pace.sessions;
        pace.frames += s.frames() - old.frames();
        pace.texels += s.statics().texels() + s.active().texels() - old.statics().texels() - old.active().texels();
        pace.triangles += s.statics().triangles() + s.active().triangles() - old.statics().triangles() - old.active().triangles();
        pace.errors += s.errors() - old.errors();
        pace.advanceMs += s.advance_ms() - old.advance_ms();
        pace.waitMs += s.wait_ms() - old.wait_ms();
    }
    return pace;
}

Result<int> tail(const CtlOptions& options) {
    using Clock = std::chrono::steady_clock;
    if (!options.session.empty() && !isNumber(options.session))
        return Error{ErrorCode::kUsage, "session " + options.session + ": not a number; `gnomon ctl sessions` lists them"};
    const uint64_t only = options.session.empty() ? 0 : std::stoull(options.session);
    auto client = reach(options);
    if (!client) return client.error();
    const auto look = [&]() -> Result<std::vector<v1::SessionInfo>> {
        auto open = client.value().sessions();
        if (!open) return at(options, open.error());
        if (only > 0) std::erase_if(open.value(), [only](const v1::SessionInfo& s) { return s.number() != only; });
        return open;
    };
    auto open = look();
    if (!open) return open.error();
    if (only > 0 && open.value().empty())
        return Error{ErrorCode::kNotFound, options.server + ": session " + options.session + " is not open; `gnomon ctl sessions` lists those that are"};
    std::printf("%8s %10s %10s %10s %14s %16s %8s\n", "sessions", "frames/s", "ms/frame", "wait ms", "texels/frame", "triangles/frame", "errors");
    Clock::time_point then = Clock::now();
    for (uint64_t line = 0; options.lines == 0 || line < options.lines; ++line) {
        std::fflush(stdout);
        std::map<uint64_t, v1::SessionInfo> before;
        for (v1::SessionInfo& s : open.value()) before[s.number()] = std::move(s);
        std::this_thread::sleep_until(then + std::chrono::seconds(1));
        open = look();
        if (!open) return open.error();
        const double seconds = std::chrono::duration<double>(Clock::now() - then).count();
        then = Clock::now();
        if (only > 0 && open.value().empty()) break;  // it has ended
        const Pace pace = paceOf(open.value(), before);
        std::printf("%8llu %10.1f %10.3f %10.3f %14.0f %16.0f %8llu\n", static_cast<unsigned long long>(pace.sessions), double(pace.frames) / seconds,
                    each(pace.advanceMs, pace.frames), each(pace.waitMs, pace.frames), each(double(pace.texels), pace.frames),
                    each(double(pace.triangles), pace.frames), static_cast<unsigned long long>(pace.errors));
    }
    return 0;
}

}  // namespace

Command addCtlCommand(CLI::App& app) {
    const auto options = std::make_shared<CtlOptions>();
    CLI::App* parser = app.add_subcommand("ctl", "Look after a server that runs");
    parser->require_subcommand(1);
    parser->add_option("--server", options->server, "HOST:PORT or unix:PATH")->capture_default_str();
    parser->add_option("--ca", options->tls.authority, "with TLS: the authority that signed the server's certificate (PEM)");
    parser->add_option("--cert", options->tls.certificate, "the certificate to show (PEM)");
    parser->add_option("--key", options->tls.key, "its key (PEM)");
    const auto add = [&](const char* name, const char* what) { return parser->add_subcommand(name, what)->fallthrough(); };
    CLI::App* healthParser = add("health", "Whether it serves");
    CLI::App* worldsParser = add("worlds", "The worlds that it serves");
    CLI::App* sessionsParser = add("sessions", "The sessions that are open");
    CLI::App* dumpParser = add("dump", "One cascade's depths as a picture: its window, the low corner at the top left");
    dumpParser->add_option("session", options->session, "its secret, or with --operator its number")->required();
    dumpParser->add_option("cascade", options->cascade, "camera by camera, from 0")->required();
    dumpParser->add_option("-o,--output", options->output, "NAME.png, 16 bits a texel, or NAME.pfm, floats")->required();
    dumpParser->add_option("--operator", options->operatorFile, "the file that gnomon serve --operator wrote");
    dumpParser->add_flag("--working", options->working, "with active casters");
    CLI::App* tailParser = add("tail", "A line of statistics a second");
    tailParser->add_option("session", options->session, "its number; all by default");
    tailParser->add_option("--lines", options->lines, "so many, then end");
    return {parser, [=]() -> Result<int> {
                if (healthParser->parsed()) return health(*options);
                if (worldsParser->parsed()) return worlds(*options);
                if (sessionsParser->parsed()) return sessions(*options);
                return dumpParser->parsed() ? dump(*options) : tail(*options);
            }};
}

}  // namespace tools
