#include "tools/bake_command.h"

#include <tbb/global_control.h>

#include <CLI/CLI.hpp>
#include <cctype>
#include <charconv>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "tools/options.h"
#include "tools/progress.h"
#include "world/bake.h"
#include "world/dem.h"
#include "world/gltf.h"
#include "world/movers.h"
#include "world/path.h"
#include "world/procedural.h"
#include "world/procedural_path.h"
#include "world/store.h"

namespace tools {
namespace {

namespace fs = std::filesystem;
using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

struct BakeOptions {
    std::vector<std::string> sources;
    std::string output;
    std::string bounds, sun;          ///< as typed; empty: not given
    double chunkSize = 0, voxel = 0;  ///< [m]; 0: the source's own choice
    int threads = 0;                  ///< 0: all
};

constexpr const char* kProcedural = "procedural:";

Error usage(std::string what) { return {ErrorCode::kUsage, std::move(what)}; }

/// The seed of "procedural:SEED"; nothing for other sources.
std::optional<Result<uint64_t>> proceduralSeed(const std::string& source) {
    if (!source.starts_with(kProcedural)) return std::nullopt;
    const std::string text = source.substr(std::string(kProcedural).size());
    uint64_t seed = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), seed);
    if (error != std::errc() || end != text.data() + text.size())
        return usage(source + ": not a seed; give procedural:SEED with a whole number, as in procedural:7");
    return seed;
}

bool isGltf(const std::string& source) {
    std::string extension = fs::path(source).extension().string();
    for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    return extension == ".glb" || extension == ".gltf";
}

world::ProceduralOptions proceduralOptions(const BakeOptions& options, const std::optional<glm::dvec3>& sun) {
    world::ProceduralOptions procedural;
    if (options.chunkSize > 0) procedural.chunkSize = options.chunkSize;
    if (options.voxel > 0) procedural.voxel = options.voxel;
    procedural.sun = sun;
    return procedural;
}

Result<world::BakeSource> openSource(const BakeOptions& options) {
    std::optional<glm::dvec3> sun;
    if (!options.sun.empty()) {
        const auto parsed = parseSun(options.sun);
        if (!parsed) return parsed.error();
        sun = parsed.value();
    }
    std::optional<std::array<double, 4>> bounds;
    if (!options.bounds.empty()) {
        const auto parsed = parseBounds(options.bounds);
        if (!parsed) return parsed.error();
        bounds = parsed.value();
    }
    const std::string& first = options.sources.front();
    const auto seed = proceduralSeed(first);
    const bool gltf = !seed && isGltf(first);
    for (const std::string& source : options.sources)
        if (options.sources.size() > 1 && (proceduralSeed(source) || !isGltf(source)))
            return usage(source + ": only .glb and .gltf scenes can be put together; bake it alone");
    if (bounds && (seed || gltf))
        return usage("--bounds: only for elevation models; leave it out for " + first);
    if (options.voxel > 0 && gltf) return usage("--voxel: only for terrain; leave it out for " + first);
    if (seed) {
        if (!*seed) return seed->error();
        return world::openProcedural(seed->value(), proceduralOptions(options, sun));
    }
    if (gltf) return world::openGltf(options.sources, {options.chunkSize, sun});
    return world::openDem(first, {bounds, options.chunkSize, options.voxel, sun});
}

/// The built-in path and movers, written beside their final names and renamed by `publish`.
class Companions {
public:
    ~Companions() {
        std::error_code ignored;
        for (const auto& [partial, path] : files_) fs::remove(partial, ignored);
    }
    Result<Done> write(const std::string& world, uint64_t seed, const world::ProceduralOptions& options) {
        const fs::path stem = fs::path(world).replace_extension();
        const std::string path = stem.string() + ".tum", movers = stem.string() + ".movers.csv";
        files_ = {{path + ".partial", path}, {movers + ".partial", movers}};
        if (const auto done = world::writeTum(files_[0].first, world::proceduralPath(seed, options)); !done)
            return done.error();
        return world::writeMovers(files_[1].first, world::proceduralMovers(seed, options));
    }
    Result<Done> publish() {
        for (const auto& [partial, path] : files_) {
            std::error_code error;
            fs::rename(partial, path, error);
            if (error)
                return Error{ErrorCode::kIo,
                             path + ": " + error.message() + "; give a folder that can be written",
                             error.value()};
            std::cout << "wrote " << path << '\n';
        }
        return Done{};
    }

private:
    std::vector<std::pair<std::string, std::string>> files_;  ///< partial and final name
};

Result<int> runBake(const BakeOptions& options) {
    if (options.chunkSize < 0 || options.voxel < 0 || options.threads < 0)
        return usage("--chunk, --voxel, --threads: not negative; leave them out for the defaults");
    std::optional<tbb::global_control> limit;
    if (options.threads > 0)
        limit.emplace(tbb::global_control::max_allowed_parallelism, size_t(options.threads));

    const auto source = openSource(options);
    if (!source) return source.error();
    for (const std::string& warning : source.value().warnings) std::cerr << "warning: " << warning << '\n';

    Companions companions;
    if (const auto seed = proceduralSeed(options.sources.front())) {
        const world::ProceduralOptions procedural = proceduralOptions(options, std::nullopt);
        if (const auto done = companions.write(options.output, seed->value(), procedural); !done)
            return done.error();
    }
    world::BakeStats stats;
    {
        Progress progress("bake", std::cerr, stderrIsTerminal());
        const auto baked = world::bake(
            source.value(), options.output, [&](size_t done, size_t total) { progress.at(done, total); },
            [&](const std::string& line) { progress.say(line); });
        if (!baked) return baked.error();
        stats = baked.value();
    }
    if (const auto done = companions.publish(); !done) return done.error();

    const auto store = world::WorldStore::open(options.output);
    if (!store) return store.error();
    const auto hash = store.value().contentHash();
    if (!hash) return hash.error();
    std::error_code ignored;  // the file was opened a moment ago
    std::printf("%s: %zu chunks, %zu instances, %zu terrain triangles, %llu bytes, content %016llx\n",
                options.output.c_str(), stats.chunks, stats.instances, stats.terrainTriangles,
                static_cast<unsigned long long>(fs::file_size(options.output, ignored)),
                static_cast<unsigned long long>(hash.value()));
    return 0;
}

}  // namespace

Command addBakeCommand(CLI::App& app) {
    const auto options = std::make_shared<BakeOptions>();
    CLI::App* parser = app.add_subcommand("bake", "Bake a source into a world file");
    parser
        ->add_option("source", options->sources,
                     ".glb or .gltf scenes, the tiles of one world; procedural:SEED for the built-in world; or an "
                     "elevation model")
        ->required();
    parser->add_option("-o,--output", options->output, "world file to write")->required();
    parser->add_option("--bounds", options->bounds,
                       "XMIN,YMIN,XMAX,YMAX: part of an elevation model [its metres]");
    parser->add_option("--chunk", options->chunkSize, "edge of a chunk [m]");
    parser->add_option("--voxel", options->voxel, "edge of a terrain voxel [m]");
    parser->add_option("--sun", options->sun, "AZIMUTH,ELEVATION: the world's own sun [degrees]");
    parser->add_option("--threads", options->threads, "threads to use; all by default");
    return {parser, [options] { return runBake(*options); }};
}

}  // namespace tools
