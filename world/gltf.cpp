// world/gltf.cpp — sorts what casts in one or several files into chunk columns.

#include "world/gltf.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <limits>
#include <map>
#include <memory>
#include <utility>

#include "world/codec.h"
#include "world/gltf_file.h"
#include "world/gltf_scene.h"
#include "world/hash.h"

namespace world {
namespace {

namespace fs = std::filesystem;

constexpr double kFarHeight = 5000;  // [m] from the median: above the relief of any landscape seen at once

/// One of the files.
struct Tile {
    std::string path;
    GltfScene scene;
};

/// The value below which a fraction of `values` lies; `values` is not empty and is reordered.
double quantile(std::vector<double>& values, double fraction) {
    const auto at = static_cast<std::ptrdiff_t>(fraction * static_cast<double>(values.size() - 1));
    std::nth_element(values.begin(), values.begin() + at, values.end());
    return values[static_cast<size_t>(at)];
}

/// A power of two [m] for which a chunk holds about 64 casters: enough to be worth a row and a read,
/// few enough that what comes and goes with a moving camera is a small part of what it sees. The
/// density is that of the region with nine tenths of the casters in x and in z, which a skybox or a far
/// island does not stretch. It gives 128 m for kart tracks and 4096 m for an island of 100 km.
double chosenChunkSize(const std::vector<glm::dvec3>& centres) {
    constexpr double kCasters = 64, kOutside = 0.05, kSmallest = 32, kLargest = 4096;
    if (centres.empty()) return kSmallest;
    const auto within = [&](int axis) {
        std::vector<double> values;
        for (const glm::dvec3& centre : centres) values.push_back(centre[axis]);
        return std::pair(quantile(values, kOutside), quantile(values, 1 - kOutside));
    };
    const auto [left, right] = within(0);
    const auto [back, front] = within(2);
    size_t inside = 0;
    for (const glm::dvec3& c : centres) inside += c.x >= left && c.x <= right && c.z >= back && c.z <= front;
    const double area = std::max(right - left, 1.0) * std::max(front - back, 1.0);
    const double edge = std::sqrt(area * kCasters / static_cast<double>(std::max<size_t>(inside, 1)));
    return std::exp2(std::round(std::log2(std::clamp(edge, kSmallest, kLargest))));
}

std::map<std::string, size_t> usesOfNames(std::span<const Tile> tiles) {
    std::map<std::string, size_t> uses;
    for (const Tile& tile : tiles)
        for (const GltfCaster& caster : tile.scene.casters) ++uses[caster.name];
    uses.erase("");
    return uses;
}

/// Names that several casters have find none of them: they are removed. Returns how many casters lost theirs.
size_t dropSharedNames(std::span<Tile> tiles) {
    const std::map<std::string, size_t> uses = usesOfNames(tiles);
    size_t lost = 0;
    for (Tile& tile : tiles)
        for (GltfCaster& caster : tile.scene.casters) {
            if (caster.name.empty() || uses.at(caster.name) == 1) continue;
            caster.name.clear();
            ++lost;
        }
    return lost;
}

/// A name that casters of several files have gets the file's in front.
void makeNamesUnique(std::span<Tile> tiles, std::vector<std::string>& warnings) {
    size_t lost = 0, longer = 0;
    for (size_t t = 0; t < tiles.size(); ++t) lost += dropSharedNames(tiles.subspan(t, 1));
    const std::map<std::string, size_t> uses = usesOfNames(tiles);
    for (Tile& tile : tiles)
        for (GltfCaster& caster : tile.scene.casters) {
            if (caster.name.empty() || uses.at(caster.name) == 1) continue;
            caster.name = fs::path(tile.path).stem().string() + "/" + caster.name;
            ++longer;
        }
    lost += dropSharedNames(tiles);
    if (lost != 0)
        warnings.push_back(std::to_string(lost) +
                           " casters share their name with another and have none in the world");
    if (longer != 0)
        warnings.push_back(std::to_string(longer) +
                           " casters share their name with one of another file and are called FILE/NAME");
}

void warnOfFarCasters(const std::vector<glm::dvec3>& centres, std::vector<std::string>& warnings) {
    if (centres.empty()) return;
    std::vector<double> heights;
    for (const glm::dvec3& centre : centres) heights.push_back(centre.y);
    const double median = quantile(heights, 0.5);
    size_t up = 0, down = 0;
    for (const double height : heights) {
        up += height > median + kFarHeight;
        down += height < median - kFarHeight;
    }
    const std::string where =
        " the median height of " + std::to_string(std::lround(median)) + " m; their depth range is kept";
    if (down != 0) warnings.push_back(std::to_string(down) + " casters lie more than 5 km below" + where);
    if (up != 0) warnings.push_back(std::to_string(up) + " casters lie more than 5 km above" + where);
}

using Chunks = std::map<ChunkKey, SourceChunk>;

/// Moves the tile's casters into their chunks of `size` [m]; its meshes count from `firstMesh`.
Result<Done> sortInto(Chunks& chunks, Tile& tile, double size, uint32_t firstMesh) {
    for (GltfCaster& caster : tile.scene.casters) {
        const double x = std::floor(caster.centre.x / size), z = std::floor(caster.centre.z / size);
        constexpr double kFar = std::numeric_limits<int32_t>::max();
        if (!(std::abs(x) < kFar && std::abs(z) < kFar))
            return inFile(tile.path,
                          {ErrorCode::kBadData, "'" + caster.name + "' lies too far out for chunks of " +
                                                    std::to_string(size) + " m; choose larger ones"});
        SourceChunk& chunk = chunks[{static_cast<int32_t>(x), 0, static_cast<int32_t>(z)}];
        caster.instance.mesh += firstMesh;
        chunk.instances.push_back(caster.instance);
        chunk.names.push_back(std::move(caster.name));
    }
    return Done{};
}

Result<BakeSource> sourceFrom(std::vector<Tile> tiles, const GltfOptions& options) {
    BakeSource source;
    source.header.source = fs::path(tiles.front().path).filename().string();
    if (tiles.size() > 1) source.header.source += " and " + std::to_string(tiles.size() - 1) + " more";
    std::vector<glm::dvec3> centres;
    for (const Tile& tile : tiles) {
        const std::string file = tiles.size() == 1 ? "" : fs::path(tile.path).filename().string() + ": ";
        for (const std::string& warning : tile.scene.warnings) source.warnings.push_back(file + warning);
        for (const GltfCaster& caster : tile.scene.casters) centres.push_back(caster.centre);
        if (source.header.sun == glm::dvec3(0)) source.header.sun = tile.scene.sun;
    }
    if (options.sun) source.header.sun = glm::normalize(*options.sun);
    makeNamesUnique(tiles, source.warnings);
    warnOfFarCasters(centres, source.warnings);
    source.header.chunkSize = options.chunkSize > 0 ? options.chunkSize : chosenChunkSize(centres);

    const auto chunks = std::make_shared<Chunks>();
    for (Tile& tile : tiles) {
        const Result<Done> sorted =
            sortInto(*chunks, tile, source.header.chunkSize, static_cast<uint32_t>(source.meshes.size()));
        if (!sorted) return sorted.error();
        std::move(tile.scene.meshes.begin(), tile.scene.meshes.end(), std::back_inserter(source.meshes));
    }
    for (const auto& [key, chunk] : *chunks) {
        source.chunks.push_back(key);
        source.contents = hashBytes(encodeInstances(chunk.instances), source.contents);
        for (const std::string& name : chunk.names)
            source.contents =
                hashValues(std::span<const char>(name.c_str(), name.size() + 1), source.contents);
    }
    source.make = [chunks](ChunkKey key) -> Result<SourceChunk> {
        const auto found = chunks->find(key);
        if (found == chunks->end())
            return Error{ErrorCode::kNotFound, "the glTF source has no chunk " + toString(key)};
        return found->second;
    };
    return source;
}

}  // namespace

Result<BakeSource> openGltf(std::span<const std::string> paths, const GltfOptions& options) {
    CHECK(!paths.empty());
    if (!(options.chunkSize >= 0) || !std::isfinite(options.chunkSize))
        return Error{ErrorCode::kUsage, "the chunk size must be above 0 m"};
    if (options.sun) {
        const double length = glm::length(*options.sun);
        if (!(length > 0) || !std::isfinite(length))
            return Error{ErrorCode::kUsage, "the sun has no direction"};
    }
    std::vector<Tile> tiles;
    for (const std::string& path : paths) {
        if (std::any_of(tiles.begin(), tiles.end(), [&](const Tile& tile) { return tile.path == path; }))
            return Error{ErrorCode::kUsage, path + ": is named twice; leave one out"};
        Result<GltfScene> scene = readGltfScene(path, !options.sun);
        if (!scene) return scene.error();
        tiles.push_back({path, std::move(scene.value())});
    }
    return sourceFrom(std::move(tiles), options);
}

}  // namespace world
