// world/gltf.cpp — walks the node graph in doubles, and sorts what casts into chunk columns.

#include "world/gltf.h"

#include <tiny_gltf.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <glm/gtc/quaternion.hpp>
#include <limits>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <span>
#include <utility>

#include "world/codec.h"
#include "world/gltf_file.h"
#include "world/gltf_mesh.h"
#include "world/hash.h"

namespace world {
namespace {

namespace fs = std::filesystem;
using tinygltf::Model;

// 1.6 GB of indices: the bound for files that draw one index list in primitives without end.
constexpr size_t kMostTriangles = size_t{1} << 27;
constexpr double kFarHeight = 5000;  // [m] from the median: above the relief of any landscape seen at once

Error bad(std::string what) { return {ErrorCode::kBadData, std::move(what)}; }

/// pWorld = linear * p + translation.
struct Transform {
    glm::dmat3 linear{1};
    glm::dvec3 translation{0};
};

bool isFinite(const glm::dvec3& v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }
bool isFinite(const glm::dmat3& m) { return isFinite(m[0]) && isFinite(m[1]) && isFinite(m[2]); }

std::string nameOf(const Model& model, size_t node) {
    return "node " + std::to_string(node) + " '" + model.nodes[node].name + "'";
}

/// The node's own transform, from its matrix or its translation, rotation and scale.
Result<Transform> localOf(const tinygltf::Node& node) {
    const auto sized = [](const std::vector<double>& v, size_t size) {
        return v.empty() || v.size() == size;
    };
    if (!sized(node.matrix, 16) || !sized(node.translation, 3) || !sized(node.rotation, 4) ||
        !sized(node.scale, 3))
        return bad("its transform has the wrong number of values");
    Transform local;
    if (!node.matrix.empty()) {
        const std::vector<double>& m = node.matrix;
        if (m[3] != 0 || m[7] != 0 || m[11] != 0 || m[15] != 1)
            return bad("its matrix is not affine; the last row must be 0 0 0 1");
        local.linear = glm::dmat3(m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]);
        local.translation = {m[12], m[13], m[14]};
    } else {
        if (!node.rotation.empty()) {
            const glm::dquat q(node.rotation[3], node.rotation[0], node.rotation[1], node.rotation[2]);
            const double length = glm::length(q);
            // The specification wants unit length; files carry it rounded to floats or worse.
            if (!(std::abs(length - 1) <= 0.01)) return bad("its rotation is not a unit quaternion");
            local.linear = glm::mat3_cast(q / length);
        }
        if (!node.scale.empty()) {
            for (int axis = 0; axis < 3; ++axis) local.linear[axis] *= node.scale[static_cast<size_t>(axis)];
        }
        if (!node.translation.empty())
            local.translation = {node.translation[0], node.translation[1], node.translation[2]};
    }
    return local;
}

/// The parent of each node, or -1: a forest, or an error.
Result<std::vector<int>> parentsOf(const Model& model) {
    const size_t count = model.nodes.size();
    std::vector<int> parent(count, -1);
    for (size_t node = 0; node < count; ++node) {
        for (const int child : model.nodes[node].children) {
            if (child < 0 || static_cast<size_t>(child) >= count)
                return bad(nameOf(model, node) + ": its child " + std::to_string(child) + " does not exist");
            int& above = parent[static_cast<size_t>(child)];
            if (above != -1)
                return bad(nameOf(model, static_cast<size_t>(child)) +
                           " is a child twice; instance its mesh instead");
            above = static_cast<int>(node);
        }
    }
    // With one parent at most, whatever no root leads to hangs on a cycle.
    std::vector<size_t> reached;
    std::vector<bool> seen(count, false);
    for (size_t node = 0; node < count; ++node)
        if (parent[node] == -1) reached.push_back(node);
    for (size_t i = 0; i < reached.size(); ++i) {
        const size_t node = reached[i];
        seen[node] = true;
        for (const int child : model.nodes[node].children) reached.push_back(static_cast<size_t>(child));
    }
    for (size_t node = 0; node < count; ++node)
        if (!seen[node]) return bad(nameOf(model, node) + " is its own ancestor, or below one that is");
    return parent;
}

/// The nodes that the scene starts from.
Result<std::vector<size_t>> sceneRoots(const Model& model, const std::vector<int>& parent) {
    std::vector<size_t> roots;
    if (model.scenes.empty() && model.defaultScene == -1) {
        for (size_t node = 0; node < parent.size(); ++node)
            if (parent[node] == -1) roots.push_back(node);
        return roots;
    }
    const int scene = model.defaultScene == -1 ? 0 : model.defaultScene;
    if (scene < 0 || static_cast<size_t>(scene) >= model.scenes.size())
        return bad("scene " + std::to_string(scene) + " does not exist");
    std::vector<bool> listed(parent.size(), false);
    for (const int root : model.scenes[static_cast<size_t>(scene)].nodes) {
        const auto node = static_cast<size_t>(root);
        if (root < 0 || node >= parent.size())
            return bad("scene " + std::to_string(scene) + ": node " + std::to_string(root) +
                       " does not exist");
        if (listed[node] || parent[node] != -1)
            return bad(nameOf(model, node) + " is placed twice by scene " + std::to_string(scene));
        listed[node] = true;
        roots.push_back(node);
    }
    return roots;
}

struct Placed {
    size_t node = 0;
    Transform world;
};

/// Every node of the scene with its world transform, parents before children, in the file's order.
Result<std::vector<Placed>> placedNodes(const Model& model) {
    const Result<std::vector<int>> parent = parentsOf(model);
    if (!parent) return parent.error();
    const Result<std::vector<size_t>> roots = sceneRoots(model, parent.value());
    if (!roots) return roots.error();
    std::vector<Placed> placed, open;
    for (auto root = roots.value().rbegin(); root != roots.value().rend(); ++root)
        open.push_back({*root, {}});
    while (!open.empty()) {
        const auto [node, above] = open.back();
        open.pop_back();
        const Result<Transform> local = localOf(model.nodes[node]);
        if (!local) return bad(nameOf(model, node) + ": " + local.error().what);
        const Transform world{above.linear * local.value().linear,
                              above.linear * local.value().translation + above.translation};
        if (!isFinite(world.linear) || !isFinite(world.translation))
            return bad(nameOf(model, node) + ": its transform is not finite");
        placed.push_back({node, world});
        const std::vector<int>& children = model.nodes[node].children;
        for (auto child = children.rbegin(); child != children.rend(); ++child)
            open.push_back({static_cast<size_t>(*child), world});
    }
    return placed;
}

/// The extras of a node hold `flag` with this value.
bool hasFlag(const tinygltf::Node& node, const char* flag, bool value) {
    if (!node.extras.IsObject() || !node.extras.Has(flag)) return false;
    const tinygltf::Value& found = node.extras.Get(flag);
    return found.IsBool() && found.Get<bool>() == value;
}

/// What is worth telling the user, counted.
struct Findings {
    size_t flat = 0, triangles = 0, unlit = 0, blended = 0, partlyBlended = 0, billboards = 0, skinned = 0;
    size_t farUp = 0, farDown = 0, namesShared = 0;
    double medianHeight = 0;
};

std::vector<std::string> warningsFrom(const Findings& f, const Model& model) {
    std::vector<std::string> warnings;
    const auto tell = [&](size_t count, const std::string& what) {
        if (count != 0) warnings.push_back(std::to_string(count) + " " + what);
    };
    tell(f.flat, "of " + std::to_string(f.triangles) + " triangles stored have no area and are dropped");
    tell(f.blended, "nodes do not cast: all their materials are BLEND");
    tell(f.partlyBlended, "nodes cast only in part: some of their materials are BLEND");
    tell(f.unlit, "nodes do not cast: their extras say shadowPass: false");
    tell(f.billboards, "billboards cast as they stand in the file");
    tell(f.skinned, "skinned nodes are baked in the pose of their mesh");
    const std::string height = std::to_string(std::lround(f.medianHeight)) + " m; their depth range is kept";
    tell(f.farDown, "casters lie more than 5 km below the median height of " + height);
    tell(f.farUp, "casters lie more than 5 km above the median height of " + height);
    tell(f.namesShared, "casters share their name with another and have none in the world");
    for (const std::string& extension : model.extensionsUsed)
        if (changesGeometry(extension))
            warnings.push_back("the optional extension " + extension + " is ignored");
    return warnings;
}

/// The shared meshes of the scene, and which of them each glTF mesh became.
struct SharedMeshes {
    std::vector<Mesh> meshes;
    std::vector<uint32_t> idOf;  ///< by glTF mesh; kNone where nothing casts or no caster uses it
    std::vector<bool> blended;   ///< by glTF mesh: some primitives were left out
    std::vector<bool> onlyBlended;
};
constexpr uint32_t kNone = std::numeric_limits<uint32_t>::max();

Result<SharedMeshes> readMeshes(const Model& model, const std::vector<Placed>& casters, Findings& findings) {
    const size_t count = model.meshes.size();
    std::vector<bool> used(count, false);
    for (const Placed& caster : casters) used[static_cast<size_t>(model.nodes[caster.node].mesh)] = true;
    SharedMeshes shared{
        {}, std::vector<uint32_t>(count, kNone), std::vector<bool>(count), std::vector<bool>(count)};
    for (size_t m = 0; m < count; ++m) {
        if (!used[m]) continue;
        Result<GltfMesh> read = readGltfMesh(model, m, kMostTriangles - findings.triangles);
        if (!read) return read.error();
        GltfMesh& mesh = read.value();
        shared.blended[m] = mesh.blended != 0;
        shared.onlyBlended[m] = mesh.blended != 0 && mesh.casting == 0;
        findings.flat += mesh.flat;
        findings.triangles += mesh.flat;
        if (mesh.mesh.levels.empty()) continue;
        findings.triangles += mesh.mesh.levels[0].indices.size() / 3;
        shared.idOf[m] = static_cast<uint32_t>(shared.meshes.size());
        shared.meshes.push_back(std::move(mesh.mesh));
    }
    return shared;
}

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

/// The direction of the first directional light, or zero.
Result<glm::dvec3> lightOf(const Model& model, const std::vector<Placed>& placed) {
    for (const Placed& at : placed) {
        const auto& extensions = model.nodes[at.node].extensions;
        const auto found = extensions.find("KHR_lights_punctual");
        if (found == extensions.end() || !found->second.IsObject() || !found->second.Has("light")) continue;
        const tinygltf::Value& light = found->second.Get("light");
        const int index = light.IsInt() ? light.Get<int>() : -1;
        if (index < 0 || static_cast<size_t>(index) >= model.lights.size())
            return bad(nameOf(model, at.node) + ": its light does not exist");
        if (model.lights[static_cast<size_t>(index)].type != "directional") continue;
        const glm::dvec3 along = at.world.linear * glm::dvec3(0, 0, -1);
        const double length = glm::length(along);
        if (!(length > 0) || !std::isfinite(length))
            return bad(nameOf(model, at.node) + ": its light has no direction");
        return along / length;
    }
    return glm::dvec3(0);
}

/// `sun_direction` of the `scene.json` in `folder`: a convention of our example data. Zero without one.
Result<glm::dvec3> sceneFileSun(const fs::path& folder) {
    const fs::path file = folder / "scene.json";
    std::error_code failed;
    if (!fs::is_regular_file(file, failed)) return glm::dvec3(0);
    const auto malformed = [&](const std::string& why) {
        return inFile(file.string(), bad(why + "; correct it, or name the sun yourself"));
    };
    std::ifstream in(file, std::ios::binary);
    const auto root = nlohmann::json::parse(in, nullptr, false);
    if (root.is_discarded() || !root.is_object()) return malformed("not a JSON object");
    const auto sun = root.find("sun_direction");
    if (sun == root.end()) return glm::dvec3(0);
    if (!sun->is_array() || sun->size() != 3)
        return malformed("sun_direction is not a list of three numbers");
    glm::dvec3 along(0);
    for (int axis = 0; axis < 3; ++axis) {
        const auto& value = (*sun)[static_cast<size_t>(axis)];
        if (!value.is_number()) return malformed("sun_direction is not a list of three numbers");
        along[axis] = value.get<double>();
    }
    const double length = glm::length(along);
    if (!(length > 0) || !std::isfinite(length)) return malformed("sun_direction has no direction");
    return along / length;
}

struct Caster {
    std::string name;
    Instance instance;
    glm::dvec3 centre{0};  ///< of its world bounds [m]
};

/// The casters among the placed nodes, in their order.
Result<std::vector<Caster>> castersOf(const Model& model, const std::vector<Placed>& placed,
                                      std::vector<Mesh>& meshes, Findings& findings) {
    std::vector<Placed> wanted;
    for (const Placed& at : placed) {
        const tinygltf::Node& node = model.nodes[at.node];
        if (node.mesh == -1) continue;
        if (node.mesh < 0 || static_cast<size_t>(node.mesh) >= model.meshes.size())
            return bad(nameOf(model, at.node) + ": mesh " + std::to_string(node.mesh) + " does not exist");
        if (hasFlag(node, "shadowPass", false))
            ++findings.unlit;
        else
            wanted.push_back(at);
    }
    Result<SharedMeshes> read = readMeshes(model, wanted, findings);
    if (!read) return read.error();
    SharedMeshes& shared = read.value();

    std::vector<Caster> casters;
    for (const Placed& at : wanted) {
        const tinygltf::Node& node = model.nodes[at.node];
        const auto mesh = static_cast<size_t>(node.mesh);
        findings.blended += shared.onlyBlended[mesh];
        if (shared.idOf[mesh] == kNone) continue;
        findings.partlyBlended += shared.blended[mesh];
        findings.billboards += hasFlag(node, "billboard", true);
        findings.skinned += node.skin != -1;
        const Placement placement{glm::mat3(at.world.linear), at.world.translation};
        const Box& own = shared.meshes[shared.idOf[mesh]].bounds;
        const Box bounds = transformed(own, glm::dmat3(placement.linear), placement.translation);
        if (!isFinite(glm::dmat3(placement.linear)) || !isFinite(bounds.min) || !isFinite(bounds.max))
            return bad(nameOf(model, at.node) + ": its scale is too large");
        casters.push_back({node.name, {shared.idOf[mesh], placement}, bounds.centre()});
    }
    meshes = std::move(shared.meshes);
    return casters;
}

/// Names that several casters have find none of them: they are removed.
void keepUniqueNames(std::vector<Caster>& casters, Findings& findings) {
    std::map<std::string, size_t> uses;
    for (const Caster& caster : casters) ++uses[caster.name];
    for (Caster& caster : casters) {
        if (caster.name.empty() || uses[caster.name] == 1) continue;
        caster.name.clear();
        ++findings.namesShared;
    }
}

void findFarCasters(const std::vector<Caster>& casters, Findings& findings) {
    if (casters.empty()) return;
    std::vector<double> heights;
    for (const Caster& caster : casters) heights.push_back(caster.centre.y);
    findings.medianHeight = quantile(heights, 0.5);
    for (const double height : heights) {
        findings.farUp += height > findings.medianHeight + kFarHeight;
        findings.farDown += height < findings.medianHeight - kFarHeight;
    }
}

Result<BakeSource> sourceFrom(const Model& model, const fs::path& folder, const GltfOptions& options) {
    const Result<std::vector<Placed>> placed = placedNodes(model);
    if (!placed) return placed.error();
    BakeSource source;
    Findings findings;
    Result<std::vector<Caster>> read = castersOf(model, placed.value(), source.meshes, findings);
    if (!read) return read.error();
    std::vector<Caster>& casters = read.value();
    keepUniqueNames(casters, findings);
    findFarCasters(casters, findings);
    source.warnings = warningsFrom(findings, model);

    if (options.sun) {
        source.header.sun = glm::normalize(*options.sun);
    } else {
        Result<glm::dvec3> sun = lightOf(model, placed.value());
        if (sun && sun.value() == glm::dvec3(0)) sun = sceneFileSun(folder);
        if (!sun) return sun.error();
        source.header.sun = sun.value();
    }

    std::vector<glm::dvec3> centres;
    for (const Caster& caster : casters) centres.push_back(caster.centre);
    const double size = options.chunkSize > 0 ? options.chunkSize : chosenChunkSize(centres);
    source.header.chunkSize = size;
    const auto chunks = std::make_shared<std::map<ChunkKey, SourceChunk>>();
    for (Caster& caster : casters) {
        const double x = std::floor(caster.centre.x / size), z = std::floor(caster.centre.z / size);
        constexpr double kFar = std::numeric_limits<int32_t>::max();
        if (!(std::abs(x) < kFar && std::abs(z) < kFar))
            return bad("'" + caster.name + "' lies too far out for chunks of " + std::to_string(size) +
                       " m; choose larger ones");
        SourceChunk& chunk = (*chunks)[{static_cast<int32_t>(x), 0, static_cast<int32_t>(z)}];
        chunk.instances.push_back(caster.instance);
        chunk.names.push_back(std::move(caster.name));
    }
    for (const auto& [key, chunk] : *chunks) {
        source.chunks.push_back(key);
        source.contents = hashBytes(encodeInstances(chunk.instances), source.contents);
        for (const std::string& name : chunk.names)
            source.contents = hashValues(std::span<const char>(name.c_str(), name.size() + 1), source.contents);
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

Result<BakeSource> openGltf(const std::string& path, const GltfOptions& options) {
    if (!(options.chunkSize >= 0) || !std::isfinite(options.chunkSize))
        return Error{ErrorCode::kUsage, "the chunk size must be above 0 m"};
    if (options.sun) {
        const double length = glm::length(*options.sun);
        if (!(length > 0) || !std::isfinite(length))
            return Error{ErrorCode::kUsage, "the sun has no direction"};
    }
    const Result<std::shared_ptr<const Model>> model = readGltfFile(path);
    if (!model) return model.error();
    Result<BakeSource> source = sourceFrom(*model.value(), fs::path(path).parent_path(), options);
    if (!source) return inFile(path, source.error());
    source.value().header.source = fs::path(path).filename().string();
    return source;
}

}  // namespace world
