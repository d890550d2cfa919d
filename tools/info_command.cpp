#include "tools/info_command.h"

#include <tbb/parallel_for.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "world/store.h"

namespace tools {
namespace {

using world::Result;

struct InfoOptions {
    std::string world;
    bool check = false;
};

/// Triangles of one level of detail, over the whole world.
struct LevelTriangles {
    uint64_t placed = 0;  ///< of shared meshes, once for each instance
    uint64_t stored = 0;  ///< of shared meshes, once
    uint64_t terrain = 0;
};

LevelTriangles& levelOf(std::vector<LevelTriangles>& levels, size_t level) {
    if (levels.size() <= level) levels.resize(level + 1);
    return levels[level];
}

Result<std::vector<LevelTriangles>> countTriangles(const world::WorldStore& store) {
    const auto records = store.chunks();
    std::vector<std::vector<LevelTriangles>> byChunk(records.size());
    std::vector<std::optional<world::Error>> errors(records.size());
    tbb::parallel_for(size_t(0), records.size(), [&](size_t i) {
        const auto chunk = store.readChunk(records[i].key);
        if (!chunk) {
            errors[i] = chunk.error();
            return;
        }
        for (const world::Instance& instance : chunk.value().instances) {
            const auto& mesh = store.meshes()[instance.mesh].levels;
            for (size_t level = 0; level < mesh.size(); ++level)
                levelOf(byChunk[i], level).placed += mesh[level].triangles;
        }
        const auto& terrain = chunk.value().terrain.levels;
        for (size_t level = 0; level < terrain.size(); ++level)
            levelOf(byChunk[i], level).terrain += terrain[level].indices.size() / 3;
    });
    std::vector<LevelTriangles> levels;
    for (size_t i = 0; i < records.size(); ++i) {
        if (errors[i]) return *errors[i];
        for (size_t level = 0; level < byChunk[i].size(); ++level) {
            levelOf(levels, level).placed += byChunk[i][level].placed;
            levelOf(levels, level).terrain += byChunk[i][level].terrain;
        }
    }
    for (const world::MeshRecord& mesh : store.meshes())
        for (size_t level = 0; level < mesh.levels.size(); ++level)
            levelOf(levels, level).stored += mesh.levels[level].triangles;
    return levels;
}

using Count = unsigned long long;

void printHeader(const world::WorldStore& store, uint64_t contentHash) {
    const world::Header& header = store.header();
    Count instances = 0, terrains = 0;
    for (const world::ChunkRecord& chunk : store.chunks()) {
        instances += chunk.instances;
        terrains += chunk.terrain.empty() ? 0 : 1;
    }
    const world::Box& b = header.bounds;
    std::printf("%s: world of version %u, baked from %s\n", store.path().c_str(), header.version,
                header.source.c_str());
    std::printf("bounds    x %.3f to %.3f, y %.3f to %.3f, z %.3f to %.3f [m]\n", b.min.x, b.max.x, b.min.y,
                b.max.y, b.min.z, b.max.z);
    std::printf("chunks    %zu of %g m, %llu with terrain of %g m voxels\n", store.chunks().size(),
                header.chunkSize, terrains, header.voxel);
    std::printf("casters   %llu: %llu instances of %zu meshes, %llu terrains\n", instances + terrains,
                instances, store.meshes().size(), terrains);
    const glm::dvec3 s = header.sun;
    if (s == glm::dvec3(0)) {
        std::printf("sun       none of its own\n");
    } else {
        double azimuth = glm::degrees(std::atan2(-s.x, s.z));
        if (azimuth < 0) azimuth += 360;
        std::printf("sun       azimuth %.3f, elevation %.3f degrees; light travels (%.6f, %.6f, %.6f)\n",
                    azimuth, glm::degrees(std::asin(std::clamp(-s.y, -1.0, 1.0))), s.x, s.y, s.z);
    }
    std::printf("content   %016llx\n", static_cast<Count>(contentHash));
}

void printTriangles(const std::vector<LevelTriangles>& levels) {
    std::printf("\n%-12s %15s %15s %15s\n", "triangles", "meshes stored", "meshes placed", "terrain");
    for (size_t level = 0; level < levels.size(); ++level)
        std::printf("level %-6zu %15llu %15llu %15llu\n", level, static_cast<Count>(levels[level].stored),
                    static_cast<Count>(levels[level].placed), static_cast<Count>(levels[level].terrain));
}

void printBytes(const std::vector<world::BlobInfo>& blobs) {
    struct Kind {
        Count rows = 0, raw = 0, stored = 0;
    };
    std::map<world::BlobKind, Kind> kinds;
    Kind all;
    for (const world::BlobInfo& blob : blobs) {
        for (Kind* kind : {&kinds[blob.key.kind], &all}) {
            ++kind->rows;
            kind->raw += blob.rawBytes;
            kind->stored += blob.storedBytes;
        }
    }
    std::printf("\n%-16s %10s %15s %15s\n", "kind", "rows", "raw bytes", "stored bytes");
    for (const auto& [kind, sum] : kinds)
        std::printf("%-16s %10llu %15llu %15llu\n", world::toString(kind), sum.rows, sum.raw, sum.stored);
    std::printf("%-16s %10llu %15llu %15llu\n", "all", all.rows, all.raw, all.stored);
}

Result<int> runInfo(const InfoOptions& options) {
    const auto opened = world::WorldStore::open(options.world);
    if (!opened) return opened.error();
    const world::WorldStore& store = opened.value();
    if (options.check) {
        // First, since the figures below cannot be had from a broken world.
        const std::vector<world::Error> findings = store.check();
        for (const world::Error& finding : findings) std::printf("%s\n", finding.what.c_str());
        if (!findings.empty())
            return world::Error{world::ErrorCode::kBadData,
                                options.world + ": " + std::to_string(findings.size()) +
                                    " findings, listed above; bake the world again"};
    }
    const auto hash = store.contentHash();
    if (!hash) return hash.error();
    const auto blobs = store.listBlobs();
    if (!blobs) return blobs.error();
    const auto levels = countTriangles(store);
    if (!levels) return levels.error();
    printHeader(store, hash.value());
    printTriangles(levels.value());
    printBytes(blobs.value());
    if (options.check) std::printf("\nchecked: every checksum and invariant holds\n");
    return 0;
}

}  // namespace

Command addInfoCommand(CLI::App& app) {
    const auto options = std::make_shared<InfoOptions>();
    CLI::App* parser = app.add_subcommand("info", "Print what a world file holds");
    parser->add_option("world", options->world, "world file")->required();
    parser->add_flag("--check", options->check,
                     "verify every checksum and invariant; exit status 3 if any fails");
    return {parser, [options] { return runInfo(*options); }};
}

}  // namespace tools
