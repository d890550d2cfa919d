// Source: Khronos, "glTF 2.0 Specification", 2021, sections 3.6 (buffers) and 4.4 (binary form).
#include "tools/yardstick.h"

#include <bit>
#include <glm/glm.hpp>
#include <glm/gtc/constants.hpp>
#include <nlohmann/json.hpp>

#include "tools/output_folder.h"
#include "world/noise.h"

namespace tools {
namespace {

using Json = nlohmann::ordered_json;

static_assert(std::endian::native == std::endian::little, "glTF's buffers are little-endian");

constexpr int kFloat = 5126, kUint = 5125, kVertices = 34962, kIndices = 34963;  // of the specification

/// Stands on the ground, however it is scaled.
const std::vector<glm::vec3> kBoxPoints{{-.5f, 0, -.5f}, {.5f, 0, -.5f}, {.5f, 1, -.5f}, {-.5f, 1, -.5f},
                                        {-.5f, 0, .5f},  {.5f, 0, .5f},  {.5f, 1, .5f},  {-.5f, 1, .5f}};
const std::vector<uint32_t> kBoxIndices{0, 2, 1, 0, 3, 2, 4, 5, 6, 4, 6, 7, 0, 1, 5, 0, 5, 4,
                                        3, 6, 2, 3, 7, 6, 0, 4, 7, 0, 7, 3, 1, 2, 6, 1, 6, 5};

class Glb {
public:
    /// The number of a new mesh.
    size_t addMesh(const std::vector<glm::vec3>& positions, const std::vector<uint32_t>& indices) {
        glm::vec3 low = positions.front(), high = positions.front();
        for (const glm::vec3& p : positions) {
            low = glm::min(low, p);
            high = glm::max(high, p);
        }
        Json points =
            accessor(positions.data(), positions.size(), sizeof positions[0], kVertices, kFloat, "VEC3");
        points["min"] = Json::array({low.x, low.y, low.z});
        points["max"] = Json::array({high.x, high.y, high.z});
        accessors_.push_back(points);
        accessors_.push_back(
            accessor(indices.data(), indices.size(), sizeof indices[0], kIndices, kUint, "SCALAR"));
        const size_t last = accessors_.size() - 1;
        const Json primitive{{"attributes", {{"POSITION", last - 1}}}, {"indices", last}};
        meshes_.push_back({{"primitives", Json::array({primitive})}});
        return meshes_.size() - 1;
    }
    void addNode(Json node) { nodes_.push_back(std::move(node)); }

    std::string bytes() const {
        Json roots = Json::array();
        for (size_t k = 0; k < nodes_.size(); ++k) roots.push_back(k);
        const Json root{{"asset", {{"version", "2.0"}, {"generator", "gnomon yardstick"}}},
                        {"scene", 0},
                        {"scenes", Json::array({Json{{"nodes", roots}}})},
                        {"nodes", nodes_},
                        {"meshes", meshes_},
                        {"accessors", accessors_},
                        {"bufferViews", views_},
                        {"buffers", Json::array({Json{{"byteLength", buffer_.size()}}})}};
        std::string json = root.dump();
        json.resize((json.size() + 3) / 4 * 4, ' ');
        std::string out = "glTF";
        word(out, 2);
        word(out, 12 + 8 + json.size() + 8 + buffer_.size());
        word(out, json.size());
        out += "JSON" + json;
        word(out, buffer_.size());
        return out + std::string("BIN\0", 4) + buffer_;
    }

private:
    /// All elements are multiples of four bytes, and so are the views' offsets.
    Json accessor(const void* data, size_t count, size_t size, int target, int component, const char* type) {
        views_.push_back({{"buffer", 0},
                          {"byteOffset", buffer_.size()},
                          {"byteLength", count * size},
                          {"target", target}});
        buffer_.append(static_cast<const char*>(data), count * size);
        return {{"bufferView", views_.size() - 1},
                {"componentType", component},
                {"count", count},
                {"type", type}};
    }
    static void word(std::string& out, size_t value) {
        for (int i = 0; i < 4; ++i) out += static_cast<char>(value >> (8 * i) & 0xff);
    }

    Json nodes_ = Json::array(), meshes_ = Json::array(), accessors_ = Json::array(), views_ = Json::array();
    std::string buffer_;
};

size_t addGround(Glb& glb) {
    constexpr uint32_t kSide = kYardstickGround + 1;
    std::vector<glm::vec3> positions;
    std::vector<uint32_t> indices;
    for (uint32_t i = 0; i < kSide; ++i)
        for (uint32_t k = 0; k < kSide; ++k)
            positions.emplace_back((double(i) / kYardstickGround - 0.5) * kYardstickEdge, 0,
                                   (double(k) / kYardstickGround - 0.5) * kYardstickEdge);
    for (uint32_t i = 0; i < kYardstickGround; ++i)
        for (uint32_t k = 0; k < kYardstickGround; ++k) {
            const uint32_t a = i * kSide + k, b = a + kSide;
            indices.insert(indices.end(), {a, a + 1, b, b, a + 1, b + 1});
        }
    return glb.addMesh(positions, indices);
}

}  // namespace

world::Result<world::Done> writeYardstick(const std::string& path, uint32_t seed) {
    Glb glb;
    glb.addNode({{"name", "ground"}, {"mesh", addGround(glb)}});
    const size_t box = glb.addMesh(kBoxPoints, kBoxIndices);
    for (uint32_t n = 0; n < kYardstickBoxes; ++n) {
        const auto unit = [&](int what) { return world::hashUnit(int32_t(n), what, 0, seed); };
        const double turn = glm::two_pi<double>() * unit(0) / 2;  // half of the angle: a quaternion
        glb.addNode({{"mesh", box},
                     {"translation", {(unit(1) - 0.5) * kYardstickEdge, 0, (unit(2) - 0.5) * kYardstickEdge}},
                     {"rotation", {0, std::sin(turn), 0, std::cos(turn)}},
                     {"scale", {1 + 5 * unit(3), 1 + 11 * unit(4), 1 + 5 * unit(5)}}});
    }
    return writeText(path, glb.bytes());
}

glm::dvec3 yardstickSun() { return glm::normalize(glm::dvec3(-0.709406, -0.573576, -0.409576)); }

std::vector<world::Pose> yardstickTrack() {
    constexpr double kSpeed = 15, kSeconds = 30, kHeight = 1.7;
    const glm::dquat alongX = glm::angleAxis(-glm::half_pi<double>(), glm::dvec3(0, 1, 0));
    return {{0, {-kSpeed * kSeconds / 2, kHeight, 0}, alongX},
            {kSeconds, {kSpeed * kSeconds / 2, kHeight, 0}, alongX}};
}

}  // namespace tools
