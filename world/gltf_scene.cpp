// world/gltf_scene.cpp — walks the node graph in doubles.

#include "world/gltf_scene.h"

#include <tiny_gltf.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <glm/gtc/quaternion.hpp>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <utility>

#include "world/gltf_file.h"
#include "world/gltf_mesh.h"

namespace world {
namespace {

namespace fs = std::filesystem;
using tinygltf::Model;

// 1.6 GB of indices: the bound for files that draw one index list in primitives without end.
constexpr size_t kMostTriangles = size_t{1} << 27;

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

/// The casters among the placed nodes, in their order.
Result<std::vector<GltfCaster>> castersOf(const Model& model, const std::vector<Placed>& placed,
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

    std::vector<GltfCaster> casters;
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

Result<GltfScene> sceneFrom(const Model& model, const fs::path& folder, bool wantSun) {
    const Result<std::vector<Placed>> placed = placedNodes(model);
    if (!placed) return placed.error();
    GltfScene scene;
    Findings findings;
    Result<std::vector<GltfCaster>> casters = castersOf(model, placed.value(), scene.meshes, findings);
    if (!casters) return casters.error();
    scene.casters = std::move(casters.value());
    scene.warnings = warningsFrom(findings, model);
    if (wantSun) {
        Result<glm::dvec3> sun = lightOf(model, placed.value());
        if (sun && sun.value() == glm::dvec3(0)) sun = sceneFileSun(folder);
        if (!sun) return sun.error();
        scene.sun = sun.value();
    }
    return scene;
}

}  // namespace

Result<GltfScene> readGltfScene(const std::string& path, bool wantSun) {
    const Result<std::shared_ptr<const Model>> model = readGltfFile(path);
    if (!model) return model.error();
    Result<GltfScene> scene = sceneFrom(*model.value(), fs::path(path).parent_path(), wantSun);
    if (!scene) return inFile(path, scene.error());
    return scene;
}

}  // namespace world
