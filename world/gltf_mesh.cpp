// world/gltf_mesh.cpp — the library checks no accessor against its buffer; each is, here, before a byte
// is read.

#include "world/gltf_mesh.h"

#include <tiny_gltf.h>

#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "world/clusters.h"
#include "world/hash.h"

namespace world {
namespace {

constexpr size_t kMostVertices = size_t{1} << 27;  // of one mesh before welding: 1.6 GB

Error bad(std::string what) { return {ErrorCode::kBadData, std::move(what)}; }

/// Elements of an accessor that lie inside their buffer.
struct View {
    const unsigned char* data = nullptr;
    size_t stride = 0, count = 0;
};

/// The view of accessor `index`, whose elements are `type` of `componentBytes` each.
Result<View> viewOf(const tinygltf::Model& model, int index, int type, size_t componentBytes) {
    const std::string name = "accessor " + std::to_string(index);
    if (index < 0 || static_cast<size_t>(index) >= model.accessors.size())
        return bad(name + " does not exist");
    const tinygltf::Accessor& accessor = model.accessors[static_cast<size_t>(index)];
    if (accessor.sparse.isSparse) return bad(name + " is sparse, which is not supported; export it dense");
    if (accessor.type != type) return bad(name + " has the wrong type");
    if (accessor.bufferView < 0 || static_cast<size_t>(accessor.bufferView) >= model.bufferViews.size())
        return bad(name + " has no buffer view; export it without compression");
    const tinygltf::BufferView& view = model.bufferViews[static_cast<size_t>(accessor.bufferView)];
    if (view.buffer < 0 || static_cast<size_t>(view.buffer) >= model.buffers.size())
        return bad(name + ": its buffer does not exist");
    const size_t size = model.buffers[static_cast<size_t>(view.buffer)].data.size();
    if (view.byteOffset > size || view.byteLength > size - view.byteOffset)
        return bad(name + ": buffer view " + std::to_string(accessor.bufferView) + " runs past its buffer");

    const size_t element = componentBytes * (type == TINYGLTF_TYPE_VEC3 ? 3 : 1);
    const size_t stride = view.byteStride == 0 ? element : view.byteStride;
    if (stride < element) return bad(name + ": its elements overlap (byteStride too small)");
    if (accessor.count == 0) return View{};
    // Divided instead of multiplied: a count of 2^63 must not wrap.
    const size_t length = view.byteLength;
    if (accessor.byteOffset > length || element > length - accessor.byteOffset ||
        accessor.count - 1 > (length - accessor.byteOffset - element) / stride)
        return bad(name + " runs past its buffer view");
    const unsigned char* data = model.buffers[static_cast<size_t>(view.buffer)].data.data();
    return View{data + view.byteOffset + accessor.byteOffset, stride, accessor.count};
}

/// The data of a primitive, all of it inside its buffers.
struct Corners {
    View positions;
    View indices;
    size_t indexBytes = 0;  ///< 1, 2 or 4; 0 without indices: 0, 1, 2, ... up to the last position

    size_t count() const { return indexBytes == 0 ? positions.count : indices.count; }
};

int positionsOf(const tinygltf::Primitive& primitive) {
    const auto found = primitive.attributes.find("POSITION");
    return found == primitive.attributes.end() ? -1 : found->second;
}

Result<Corners> cornersOf(const tinygltf::Model& model, const tinygltf::Primitive& primitive) {
    const int positions = positionsOf(primitive);
    if (positions == -1) return bad("has no POSITION attribute");
    const Result<View> points = viewOf(model, positions, TINYGLTF_TYPE_VEC3, sizeof(float));
    if (!points) return points.error();
    if (model.accessors[static_cast<size_t>(positions)].componentType != TINYGLTF_COMPONENT_TYPE_FLOAT)
        return bad("POSITION accessor " + std::to_string(positions) +
                   " is not of floats; export it without quantization");
    Corners corners{points.value(), {}, 0};
    if (primitive.indices == -1) return corners;

    const std::string name = "index accessor " + std::to_string(primitive.indices);
    if (primitive.indices < 0 || static_cast<size_t>(primitive.indices) >= model.accessors.size())
        return bad(name + " does not exist");
    const int component = model.accessors[static_cast<size_t>(primitive.indices)].componentType;
    if (component == TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE) corners.indexBytes = 1;
    if (component == TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT) corners.indexBytes = 2;
    if (component == TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT) corners.indexBytes = 4;
    if (corners.indexBytes == 0) return bad(name + " is not of unsigned 8, 16 or 32 bit numbers");
    const Result<View> indices = viewOf(model, primitive.indices, TINYGLTF_TYPE_SCALAR, corners.indexBytes);
    if (!indices) return indices.error();
    corners.indices = indices.value();
    return corners;
}

size_t triangleCount(int mode, size_t corners) {
    if (mode == TINYGLTF_MODE_TRIANGLES) return corners / 3;
    return corners < 3 ? 0 : corners - 2;
}

Result<Done> appendPositions(const View& view, std::vector<glm::vec3>& positions) {
    positions.reserve(positions.size() + view.count);
    for (size_t i = 0; i < view.count; ++i) {
        std::array<float, 3> p;
        std::memcpy(p.data(), view.data + i * view.stride, sizeof p);
        if (!std::isfinite(p[0]) || !std::isfinite(p[1]) || !std::isfinite(p[2]))
            return bad("element " + std::to_string(i) + " is not finite");
        positions.emplace_back(p[0], p[1], p[2]);
    }
    return Done{};
}

/// The vertices of a primitive in drawing order.
Result<std::vector<uint32_t>> drawOrder(const Corners& corners) {
    const size_t vertices = corners.positions.count, count = corners.count();
    std::vector<uint32_t> order(count);
    for (size_t i = 0; i < count; ++i) {
        if (corners.indexBytes == 0) {
            order[i] = static_cast<uint32_t>(i);
            continue;
        }
        const unsigned char* at = corners.indices.data + i * corners.indices.stride;
        uint32_t vertex = 0;
        for (size_t b = 0; b < corners.indexBytes; ++b) vertex |= static_cast<uint32_t>(at[b]) << (8 * b);
        if (vertex >= vertices)
            return bad("element " + std::to_string(i) + " names vertex " + std::to_string(vertex) + " of " +
                       std::to_string(vertices));
        order[i] = vertex;
    }
    return order;
}

/// Calls `emit(a, b, c)` for each triangle of `order`, wound as the specification says (3.7.2.1).
template <class Emit>
void eachTriangle(int mode, const std::vector<uint32_t>& order, const Emit& emit) {
    const size_t count = triangleCount(mode, order.size());
    for (size_t i = 0; i < count; ++i) {
        if (mode == TINYGLTF_MODE_TRIANGLES) emit(order[3 * i], order[3 * i + 1], order[3 * i + 2]);
        if (mode == TINYGLTF_MODE_TRIANGLE_STRIP) emit(order[i], order[i + 1 + i % 2], order[i + 2 - i % 2]);
        if (mode == TINYGLTF_MODE_TRIANGLE_FAN) emit(order[i + 1], order[i + 2], order[0]);
    }
}

struct BitsHash {
    size_t operator()(const std::array<uint32_t, 3>& bits) const {
        return hashValues(std::span<const uint32_t>(bits));
    }
};

/// Drops vertices that no triangle uses, and gives equal positions one number: exporters split vertices
/// by normals and texture coordinates, which cast no shadow, and every vertex drawn is paid for.
void weld(MeshLevel& level) {
    constexpr uint32_t kUnseen = std::numeric_limits<uint32_t>::max();
    std::vector<uint32_t> moved(level.positions.size(), kUnseen);
    std::unordered_map<std::array<uint32_t, 3>, uint32_t, BitsHash> known;
    std::vector<glm::vec3> positions;
    for (uint32_t& index : level.indices) {
        if (moved[index] == kUnseen) {
            const glm::vec3 p = level.positions[index] + 0.0f;  // -0 becomes 0
            const std::array<uint32_t, 3> bits{std::bit_cast<uint32_t>(p.x), std::bit_cast<uint32_t>(p.y),
                                               std::bit_cast<uint32_t>(p.z)};
            const auto [at, fresh] = known.try_emplace(bits, static_cast<uint32_t>(positions.size()));
            if (fresh) positions.push_back(p);
            moved[index] = at->second;
        }
        index = moved[index];
    }
    level.positions = std::move(positions);
}

/// Whether the primitive casts, by its mode and material; counts it.
Result<bool> casts(const tinygltf::Model& model, const tinygltf::Primitive& primitive, GltfMesh& out) {
    const int mode = primitive.mode;
    if (mode < TINYGLTF_MODE_POINTS || mode > TINYGLTF_MODE_TRIANGLE_FAN)
        return bad("unknown mode " + std::to_string(mode));
    if (mode < TINYGLTF_MODE_TRIANGLES) return false;
    if (primitive.material != -1) {
        if (primitive.material < 0 || static_cast<size_t>(primitive.material) >= model.materials.size())
            return bad("material " + std::to_string(primitive.material) + " does not exist");
        const std::string& alpha = model.materials[static_cast<size_t>(primitive.material)].alphaMode;
        if (alpha == "BLEND") {
            ++out.blended;
            return false;
        }
        if (alpha != "OPAQUE" && alpha != "MASK")
            return bad("material " + std::to_string(primitive.material) + " has the unknown alphaMode '" +
                       alpha + "'");
    }
    ++out.casting;
    return true;
}

}  // namespace

Result<GltfMesh> readGltfMesh(const tinygltf::Model& model, size_t index, size_t mostTriangles) {
    CHECK(index < model.meshes.size());
    const tinygltf::Mesh& source = model.meshes[index];
    const auto named = [&](size_t primitive, const Error& error) {
        return Error{error.code, "mesh " + std::to_string(index) + " '" + source.name + "', primitive " +
                                     std::to_string(primitive) + ": " + error.what};
    };
    // What is there is counted before any of it is stored: a small file can draw one index list in as
    // many primitives as it likes.
    GltfMesh out;
    std::vector<std::pair<size_t, Corners>> casting;
    std::map<int, size_t> firstVertex;  // by accessor: primitives often share one vertex list
    size_t vertices = 0, triangles = 0;
    for (size_t p = 0; p < source.primitives.size(); ++p) {
        const tinygltf::Primitive& primitive = source.primitives[p];
        const Result<bool> wanted = casts(model, primitive, out);
        if (!wanted) return named(p, wanted.error());
        if (!wanted.value()) continue;
        const Result<Corners> corners = cornersOf(model, primitive);
        if (!corners) return named(p, corners.error());
        casting.emplace_back(p, corners.value());
        if (firstVertex.try_emplace(positionsOf(primitive), vertices).second)
            vertices += corners.value().positions.count;
        triangles += triangleCount(primitive.mode, corners.value().count());
        if (vertices > kMostVertices || triangles > mostTriangles)
            return named(
                p, {ErrorCode::kLimit, "more vertices or triangles than one world takes; split the file"});
    }

    MeshLevel level;
    level.indices.reserve(triangles * 3);
    for (const auto& [p, corners] : casting) {
        const tinygltf::Primitive& primitive = source.primitives[p];
        const auto first = static_cast<uint32_t>(firstVertex.at(positionsOf(primitive)));
        if (first == level.positions.size()) {
            const Result<Done> appended = appendPositions(corners.positions, level.positions);
            if (!appended)
                return named(p, bad("POSITION accessor " + std::to_string(positionsOf(primitive)) + ": " +
                                    appended.error().what));
        }
        const Result<std::vector<uint32_t>> order = drawOrder(corners);
        if (!order)
            return named(
                p, bad("index accessor " + std::to_string(primitive.indices) + ": " + order.error().what));
        eachTriangle(primitive.mode, order.value(), [&](uint32_t a, uint32_t b, uint32_t c) {
            a += first, b += first, c += first;
            if (hasArea(level.positions[a], level.positions[b], level.positions[c]))
                level.indices.insert(level.indices.end(), {a, b, c});
            else
                ++out.flat;
        });
    }
    if (level.indices.empty()) return out;
    level.indices.shrink_to_fit();
    weld(level);
    for (const glm::vec3& p : level.positions) out.mesh.bounds.add(glm::dvec3(p));
    out.mesh.levels.push_back(std::move(level));
    return out;
}

}  // namespace world
