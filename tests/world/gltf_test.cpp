// tests/world/gltf_test.cpp — what a glTF scene says is what the source casts.

#include "world/gltf.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <glm/gtc/quaternion.hpp>
#include <limits>
#include <map>
#include <random>
#include <tuple>

#include "tests/world/gltf_builder.h"

namespace world {
namespace {

using Json = GltfBuilder::Json;
using Corners = std::array<std::array<float, 3>, 3>;

Result<BakeSource> open(const GltfBuilder& builder, const GltfOptions& options = {.chunkSize = 100}) {
    const TempFolder folder;
    return openGltf(folder.write("world.glb", builder.glb()), options);
}

std::vector<Corners> trianglesOf(const Mesh& mesh) {
    std::vector<Corners> triangles;
    const MeshLevel& level = mesh.levels[0];
    for (size_t i = 0; i < level.indices.size(); i += 3) {
        Corners corners;
        for (size_t k = 0; k < 3; ++k) {
            const glm::vec3& p = level.positions[level.indices[i + k]];
            corners[k] = {p.x, p.y, p.z};
        }
        // The first corner does not matter, the turn does.
        std::rotate(corners.begin(), std::min_element(corners.begin(), corners.end()), corners.end());
        triangles.push_back(corners);
    }
    std::sort(triangles.begin(), triangles.end());
    return triangles;
}

bool warns(const BakeSource& source, const std::string& text) {
    return std::any_of(source.warnings.begin(), source.warnings.end(),
                       [&](const std::string& warning) { return warning.find(text) != std::string::npos; });
}

TEST(Gltf, ReadsEveryKindOfTriangle) {
    // The same fan of triangles told in every way: a regular polygon about its first vertex.
    std::vector<glm::vec3> points{{0, 0, 0}};
    for (int i = 0; i < 7; ++i) points.emplace_back(std::cos(i * 0.8f), std::sin(i * 0.8f), 0);
    std::vector<uint8_t> list, fan;
    for (uint8_t i = 0; i < 8; ++i) fan.push_back(i);
    for (uint8_t i = 1; i < 7; ++i) list.insert(list.end(), {0, i, static_cast<uint8_t>(i + 1)});
    std::vector<glm::vec3> flat;
    for (const uint8_t i : list) flat.push_back(points[i]);
    const std::vector<uint16_t> wide(list.begin(), list.end());
    const std::vector<uint32_t> wider(list.begin(), list.end());

    std::vector<std::vector<Corners>> found;
    for (const int way : {0, 1, 2, 3, 4, 5}) {
        GltfBuilder b;
        const int p = b.positions(points, way == 1 ? 8 : 0);
        Json primitive;
        if (way == 0) primitive = GltfBuilder::primitive(p, b.indices(list));
        if (way == 1) primitive = GltfBuilder::primitive(p, b.indices(wide));
        if (way == 2) primitive = GltfBuilder::primitive(p, b.indices(wider));
        if (way == 3) primitive = GltfBuilder::primitive(b.positions(flat));
        if (way == 4) primitive = GltfBuilder::primitive(p, b.indices(fan), 6);
        if (way == 5) primitive = GltfBuilder::primitive(p, -1, 6);
        b.node({{"mesh", b.mesh({primitive})}});
        const Result<BakeSource> source = open(b);
        ASSERT_TRUE(source) << way << ": " << source.error().what;
        expectSound(source.value());
        ASSERT_EQ(source.value().meshes.size(), 1u) << way;
        EXPECT_EQ(source.value().meshes[0].levels[0].positions.size(), 8u) << way;  // equal ones are welded
        found.push_back(trianglesOf(source.value().meshes[0]));
        EXPECT_EQ(found.back().size(), 6u) << way;
        EXPECT_EQ(found.back(), found.front()) << way;
    }
}

TEST(Gltf, TurnsStripsAsTheSpecificationSays) {
    GltfBuilder b;
    const std::vector<glm::vec3> points{{0, 0, 0}, {0, 1, 0}, {1, 0, 0}, {1, 1, 0}, {2, 0, 0}, {2, 1, 0}};
    const int p = b.positions(points);
    b.node({{"mesh", b.mesh({GltfBuilder::primitive(p, -1, 5)})}});
    b.node({{"mesh", b.mesh({GltfBuilder::primitive(
                         p, b.indices(std::vector<uint8_t>{0, 1, 2, 1, 3, 2, 2, 3, 4, 3, 5, 4}))})}});
    const Result<BakeSource> source = open(b);
    ASSERT_TRUE(source) << source.error().what;
    EXPECT_EQ(trianglesOf(source.value().meshes[0]), trianglesOf(source.value().meshes[1]));
}

TEST(Gltf, JoinsThePrimitivesOfAMesh) {
    GltfBuilder b;
    const int shared = b.positions({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {9, 9, 9}});
    const int own = b.positions({{5, 0, 0}, {6, 0, 0}, {5, 1, 0}});
    const int mesh = b.mesh({GltfBuilder::primitive(shared, b.indices(std::vector<uint8_t>{0, 1, 2})),
                             GltfBuilder::primitive(own),
                             GltfBuilder::primitive(shared, b.indices(std::vector<uint8_t>{0, 2, 3})),
                             GltfBuilder::primitive(shared, -1, 0),    // points
                             GltfBuilder::primitive(shared, -1, 3)});  // lines
    b.node({{"mesh", mesh}});
    const Result<BakeSource> source = open(b);
    ASSERT_TRUE(source) << source.error().what;
    expectSound(source.value());
    ASSERT_EQ(source.value().meshes.size(), 1u);
    const MeshLevel& level = source.value().meshes[0].levels[0];
    EXPECT_EQ(level.indices.size(), 9u);
    EXPECT_EQ(level.positions.size(), 7u);  // (9, 9, 9) is not used
}

TEST(Gltf, LeavesOutWhatDoesNotCast) {
    GltfBuilder b;
    const int opaque = b.material("OPAQUE"), mask = b.material("MASK"), blend = b.material("BLEND");
    const int p = b.positions({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {2, 0, 0}});
    const auto with = [&](int material, std::vector<uint8_t> corners) {
        Json out = GltfBuilder::primitive(p, b.indices(corners));
        if (material >= 0) out["material"] = material;
        return out;
    };
    const int glass = b.mesh({with(blend, {0, 1, 2})});
    const int window = b.mesh({with(blend, {0, 1, 2}), with(mask, {0, 2, 3}), with(opaque, {0, 1, 2})});
    const int flat = b.mesh({with(-1, {0, 1, 3, 1, 1, 2})});
    const int partlyFlat = b.mesh({with(-1, {0, 1, 3, 0, 1, 2})});
    b.node({{"mesh", glass}, {"name", "glass"}});
    b.node({{"mesh", window}, {"name", "window"}});
    b.node({{"mesh", flat}, {"name", "flat"}});
    b.node({{"mesh", partlyFlat}, {"name", "part"}});
    b.node({{"mesh", window}, {"name", "unlit"}, {"extras", {{"shadowPass", false}}}, {"children", {5}}});
    b.node({{"mesh", window},
            {"name", "child of unlit"},
            {"extras", {{"shadowPass", true}, {"billboard", true}}}});
    const Result<BakeSource> source = open(b);
    ASSERT_TRUE(source) << source.error().what;
    expectSound(source.value());
    std::map<std::string, size_t> triangles;
    for (const Listed& at : listAll(source.value()))
        triangles[at.name] = source.value().meshes[at.instance.mesh].levels[0].indices.size() / 3;
    const std::map<std::string, size_t> expected{{"window", 2}, {"part", 1}, {"child of unlit", 2}};
    EXPECT_EQ(triangles, expected);
    EXPECT_EQ(source.value().meshes.size(), 2u);
    EXPECT_TRUE(warns(source.value(), "3 of 6 triangles stored have no area"));
    EXPECT_TRUE(warns(source.value(), "1 nodes do not cast: all their materials are BLEND"));
    EXPECT_TRUE(warns(source.value(), "2 nodes cast only in part"));
    EXPECT_TRUE(warns(source.value(), "1 nodes do not cast: their extras say shadowPass: false"));
    EXPECT_TRUE(warns(source.value(), "1 billboards cast as they stand"));
}

TEST(Gltf, KeepsSharedMeshesAndUniqueNames) {
    GltfBuilder b;
    const int mesh = b.triangleMesh(), other = b.triangleMesh();
    b.node({{"mesh", mesh}, {"name", "twice"}});
    b.node({{"mesh", mesh}, {"name", "twice"}, {"translation", {1, 0, 0}}});
    b.node({{"mesh", other}, {"name", "once"}});
    b.node({{"mesh", mesh}});
    b.node({{"name", "once"}});  // without a mesh: nobody else's name
    const Result<BakeSource> source = open(b);
    ASSERT_TRUE(source) << source.error().what;
    expectSound(source.value());
    EXPECT_EQ(source.value().meshes.size(), 2u);
    std::multiset<std::string> names;
    for (const Listed& at : listAll(source.value())) names.insert(at.name);
    EXPECT_EQ(names, (std::multiset<std::string>{"", "", "", "once"}));
    EXPECT_TRUE(warns(source.value(), "2 casters share their name"));
    EXPECT_EQ(source.value().header.source, "world.glb");
}

TEST(Gltf, PutsTilesTogetherAsIfTheyWereOneFile) {
    std::mt19937 rng(61);
    std::uniform_real_distribution<double> place(-300, 300);
    GltfBuilder whole;
    std::array<GltfBuilder, 3> parts;
    for (int n = 0; n < 60; ++n) {
        GltfBuilder& part = parts[rng() % 3];
        const std::vector<glm::vec3> points = {{0, 0, 0}, {1, float(n), 0}, {0, 1, 2}};
        Json node{{"translation", {place(rng), place(rng), place(rng)}}, {"name", std::to_string(n)}};
        for (GltfBuilder* b : {&whole, &part}) {
            node["mesh"] = b->mesh({GltfBuilder::primitive(b->positions(points))});
            b->node(node);
        }
    }
    const TempFolder folder;
    std::vector<std::string> paths;
    for (size_t i = 0; i < parts.size(); ++i)
        paths.push_back(folder.write("tile" + std::to_string(i) + ".glb", parts[i].glb()));
    for (const double size : {0.0, 50.0}) {
        const Result<BakeSource> one = open(whole, {.chunkSize = size}),
                                 tiled = openGltf(paths, {.chunkSize = size});
        ASSERT_TRUE(one && tiled);
        expectSound(tiled.value());
        EXPECT_EQ(tiled.value().header.chunkSize, one.value().header.chunkSize);
        EXPECT_EQ(tiled.value().header.source, "tile0.glb and 2 more");
        EXPECT_EQ(tiled.value().chunks, one.value().chunks);
        EXPECT_TRUE(tiled.value().warnings.empty());
        const auto all = [](const BakeSource& source) {
            std::map<std::string, std::tuple<ChunkKey, double, std::vector<Corners>>> casters;
            for (const ChunkKey key : source.chunks) {
                const SourceChunk chunk = source.make(key).value();
                for (size_t i = 0; i < chunk.instances.size(); ++i)
                    casters[chunk.names[i]] = {key, chunk.instances[i].placement.translation.x,
                                               trianglesOf(source.meshes[chunk.instances[i].mesh])};
            }
            return casters;
        };
        EXPECT_EQ(all(tiled.value()).size(), 60u);
        EXPECT_EQ(all(tiled.value()), all(one.value()));
    }
}

TEST(Gltf, TellsEqualNamesOfTilesApart) {
    const auto scene = [](const std::vector<const char*>& names) {
        GltfBuilder b;
        const int mesh = b.triangleMesh();
        for (const char* name : names) b.node({{"mesh", mesh}, {"name", name}});
        return b.glb();
    };
    const TempFolder folder;
    const std::vector<std::string> paths = {
        folder.write("east.glb", scene({"tree", "car", "twice", "twice"})),
        folder.write("west.glb", scene({"tree", "boat", "twice"})),
        folder.write("more/west.glb", scene({"tree", "east/tree"}))};
    const auto namesOf = [&](size_t files) {
        const Result<BakeSource> source = openGltf(std::span(paths).first(files), {});
        EXPECT_TRUE(source) << source.error().what;
        std::multiset<std::string> names;
        for (const Listed& at : listAll(source.value()))
            if (!at.name.empty()) names.insert(at.name);
        return names;
    };
    using Names = std::multiset<std::string>;
    EXPECT_EQ(namesOf(2), (Names{"east/tree", "west/tree", "car", "boat", "twice"}));
    // Files of one name in two folders, and a name that looks like one that was made: nobody is found
    // wrongly.
    EXPECT_EQ(namesOf(3), (Names{"car", "boat", "twice"}));
    const std::vector<std::string> same = {paths[0], paths[0]};
    const Result<BakeSource> twice = openGltf(same, {});
    ASSERT_FALSE(twice);
    EXPECT_EQ(twice.error().code, ErrorCode::kUsage);
}

TEST(Gltf, TakesTheSunOfTheFirstTileThatHasOne) {
    GltfBuilder dark, lit;
    dark.node({{"mesh", dark.triangleMesh()}});
    lit.node({{"mesh", lit.triangleMesh()}});
    const TempFolder folder;
    const std::vector<std::string> paths = {folder.write("dark.glb", dark.glb()),
                                            folder.write("lit/lit.glb", lit.glb()),
                                            folder.write("other/other.glb", lit.glb())};
    folder.write("lit/scene.json", R"({"sun_direction": [0, -2, 0]})");
    folder.write("other/scene.json", R"({"sun_direction": [1, 0, 0]})");
    EXPECT_EQ(openGltf(paths, {}).value().header.sun, glm::dvec3(0, -1, 0));
    EXPECT_EQ(openGltf(paths, {.sun = glm::dvec3(0, 0, 3)}).value().header.sun, glm::dvec3(0, 0, 1));
}

TEST(Gltf, ComposesTransformsInDoubles) {
    std::mt19937 rng(6);
    std::uniform_real_distribution<double> unit(-1, 1), place(-1e6, 1e6);  // 1000 km out
    for (int round = 0; round < 50; ++round) {
        GltfBuilder b;
        const int mesh = b.triangleMesh();
        glm::dmat4 expected(1);
        constexpr int kDeep = 6;
        for (int depth = 0; depth < kDeep; ++depth) {
            glm::dmat4 local(1);
            Json node;
            if (rng() % 2 == 0) {
                const glm::dquat q = glm::normalize(glm::dquat(unit(rng), unit(rng), unit(rng), unit(rng)));
                const glm::dvec3 s(1 + unit(rng) / 2, -1 + unit(rng) / 2, depth == 3 ? 0 : 1 + unit(rng) / 2);
                const glm::dvec3 t(place(rng), place(rng), place(rng));
                local = glm::mat4_cast(q);
                for (int axis = 0; axis < 3; ++axis) local[axis] *= s[axis];
                local[3] = glm::dvec4(t, 1);
                node = {{"rotation", {q.x, q.y, q.z, q.w}},
                        {"scale", {s.x, s.y, s.z}},
                        {"translation", {t.x, t.y, t.z}}};
            } else {
                for (int column = 0; column < 4; ++column)
                    for (int row = 0; row < 3; ++row)
                        local[column][row] = column < 3 ? unit(rng) : place(rng);
                std::vector<double> values;
                for (int column = 0; column < 4; ++column)
                    for (int row = 0; row < 4; ++row) values.push_back(local[column][row]);
                node = {{"matrix", values}};
            }
            expected = expected * local;
            if (depth + 1 < kDeep)
                node["children"] = {depth + 1};
            else
                node["mesh"] = mesh;
            b.node(node);
        }
        const Result<BakeSource> source = open(b, {.chunkSize = 1000});
        ASSERT_TRUE(source) << source.error().what;
        expectSound(source.value());
        const std::vector<Listed> all = listAll(source.value());
        ASSERT_EQ(all.size(), 1u);
        const Placement& placement = all[0].instance.placement;
        // Six products of numbers up to 1e6 * 2^6 round at 1e-8; the linear part is kept as floats.
        EXPECT_LT(glm::length(placement.translation - glm::dvec3(expected[3])), 1e-6) << round;
        for (int axis = 0; axis < 3; ++axis) {
            const glm::vec3 difference = placement.linear[axis] - glm::vec3(expected[axis]);
            EXPECT_LT(glm::length(difference), 1e-5f * (1 + glm::length(glm::vec3(expected[axis])))) << round;
        }
    }
}

TEST(Gltf, PlacesOnlyTheDefaultScene) {
    GltfBuilder b;
    const int mesh = b.triangleMesh();
    for (const char* name : {"a", "b", "c"}) b.node({{"mesh", mesh}, {"name", name}});
    b.root["nodes"][0]["children"] = {1};
    const auto namesOf = [&] {
        const Result<BakeSource> source = open(b);
        EXPECT_TRUE(source) << source.error().what;
        std::set<std::string> names;
        for (const Listed& at : listAll(source.value())) names.insert(at.name);
        return names;
    };
    EXPECT_EQ(namesOf(), (std::set<std::string>{"a", "b", "c"}));  // no scene: all roots
    b.root["scenes"] = {{{"nodes", {0}}}, {{"nodes", {2}}}};
    EXPECT_EQ(namesOf(), (std::set<std::string>{"a", "b"}));
    b.root["scene"] = 1;
    EXPECT_EQ(namesOf(), (std::set<std::string>{"c"}));
    b.root["scenes"][1]["nodes"] = Json::array();
    EXPECT_EQ(namesOf(), (std::set<std::string>{}));
}

TEST(Gltf, GivesEachInstanceToTheChunkOfItsCentre) {
    std::mt19937 rng(12);
    std::uniform_real_distribution<double> place(-500, 500);
    for (const double far : {0.0, 1e6}) {
        GltfBuilder b;
        const int mesh = b.mesh({GltfBuilder::primitive(b.positions({{30, 0, 0}, {31, 0, 0}, {30, 1, 1}}))});
        for (int i = 0; i < 200; ++i)
            b.node({{"mesh", mesh}, {"translation", {far + place(rng), place(rng), -far + place(rng)}}});
        for (const double size : {0.0, 10.0, 128.0, 1e5}) {
            const Result<BakeSource> source = open(b, {.chunkSize = size});
            ASSERT_TRUE(source) << source.error().what;
            expectSound(source.value());
            EXPECT_EQ(listAll(source.value()).size(), 200u);
            EXPECT_TRUE(size == 0 || source.value().header.chunkSize == size);
            EXPECT_FALSE(source.value().make({77, 1, 77}));
        }
    }
    GltfBuilder b;
    b.node({{"mesh", b.triangleMesh()}, {"translation", {1e12, 0, 0}}});
    EXPECT_FALSE(open(b, {.chunkSize = 1}));
    EXPECT_TRUE(open(b, {.chunkSize = 1e4}));
}

TEST(Gltf, TakesAFileWithoutCasters) {
    GltfBuilder b;
    for (const double size : {0.0, 50.0}) {
        const Result<BakeSource> source = open(b, {.chunkSize = size});
        ASSERT_TRUE(source) << source.error().what;
        expectSound(source.value());
        EXPECT_TRUE(source.value().chunks.empty());
    }
}

TEST(Gltf, FindsTheSun) {
    GltfBuilder b;
    b.node({{"mesh", b.triangleMesh()}});
    const TempFolder folder;
    const auto sunOf = [&](const GltfOptions& options = {}) {
        const Result<BakeSource> source = openGltf(folder.write("world.glb", b.glb()), options);
        EXPECT_TRUE(source) << source.error().what;
        return source ? source.value().header.sun : glm::dvec3(9);
    };
    EXPECT_EQ(sunOf(), glm::dvec3(0));
    folder.write("scene.json", R"({"title": "no sun"})");
    EXPECT_EQ(sunOf(), glm::dvec3(0));
    folder.write("scene.json", R"({"sun_direction": [0, -2, 0]})");
    EXPECT_EQ(sunOf(), glm::dvec3(0, -1, 0));

    b.root["extensionsUsed"] = b.root["extensionsRequired"] = {"KHR_lights_punctual"};
    b.root["extensions"]["KHR_lights_punctual"]["lights"] = {{{"type", "point"}}, {{"type", "directional"}}};
    const auto light = [](int index) { return Json{{"KHR_lights_punctual", {{"light", index}}}}; };
    b.node({{"extensions", light(0)}});
    EXPECT_EQ(sunOf(), glm::dvec3(0, -1, 0));  // a point light is no sun
    b.node({{"rotation", {0, std::sqrt(0.5), 0, std::sqrt(0.5)}}, {"scale", {2, 2, 2}}, {"children", {3}}});
    b.node({{"extensions", light(1)}});  // -z, turned a quarter about y
    EXPECT_LT(glm::length(sunOf() - glm::dvec3(-1, 0, 0)), 1e-15);
    EXPECT_EQ(sunOf({.sun = glm::dvec3(0, 0, 3)}), glm::dvec3(0, 0, 1));

    for (const char* text : {"", "[", "[]", "3", R"({"sun_direction": 1})", R"({"sun_direction": [1, 2]})",
                             R"({"sun_direction": [1, 2, "3"]})", R"({"sun_direction": [0, 0, 0]})",
                             R"({"sun_direction": [1e308, 1e308, 0]})"}) {
        b.root.erase("extensions");
        b.root["nodes"][3].erase("extensions");
        b.root["nodes"][1].erase("extensions");
        folder.write("scene.json", text);
        const Result<BakeSource> source = openGltf(folder.write("world.glb", b.glb()), {});
        ASSERT_FALSE(source) << text;
        EXPECT_EQ(source.error().code, ErrorCode::kBadData);
        EXPECT_NE(source.error().what.find("scene.json"), std::string::npos) << source.error().what;
    }
    for (const glm::dvec3& sun : {glm::dvec3(0), glm::dvec3(std::nan(""), 0, 1)})
        EXPECT_EQ(open(b, {.sun = sun}).error().code, ErrorCode::kUsage);
    for (const double size : {-1.0, std::nan(""), std::numeric_limits<double>::infinity()})
        EXPECT_EQ(open(b, {.chunkSize = size}).error().code, ErrorCode::kUsage);
}

TEST(Gltf, WarnsOfCastersFarUpAndDown) {
    GltfBuilder b;
    const int mesh = b.triangleMesh();
    for (const double height : {0.0, 10.0, 20.0, -9999.0, 6000.0, 7000.0, 100.0})
        b.node({{"mesh", mesh}, {"translation", {0.0, height, 0.0}}});
    b.root["extensionsUsed"] = {"EXT_mesh_gpu_instancing", "KHR_materials_unlit"};
    const Result<BakeSource> source = open(b);
    ASSERT_TRUE(source) << source.error().what;
    EXPECT_EQ(listAll(source.value()).size(), 7u);
    EXPECT_TRUE(warns(source.value(), "1 casters lie more than 5 km below the median"));
    EXPECT_TRUE(warns(source.value(), "2 casters lie more than 5 km above the median"));
    EXPECT_TRUE(warns(source.value(), "extension EXT_mesh_gpu_instancing is ignored"));
    EXPECT_FALSE(warns(source.value(), "KHR_materials_unlit"));
}

TEST(Gltf, ReadsTheExampleWorlds) {
    const std::filesystem::path data = std::filesystem::path(GNOMON_SOURCE_DIR) / "../shared/data";
    if (!std::filesystem::exists(data)) GTEST_SKIP() << "no ../shared";
    // Placed triangles as a second reader of the files counts them, without the nodes that say
    // shadowPass: false (4, 722 and 3,392 triangles) and, in oahu, 302,327 without area.
    const struct {
        const char* world;
        size_t nodes, meshes, triangles;
        double chunkSize;
        glm::dvec3 sun;
    } worlds[] = {
        {"stk/candela_city", 960, 283, 384635 + 50299 - 4, 128, {0.974781, -0.222899, 0.010828}},
        {"stk/cocoa_temple", 1683, 385, 235197 + 221582 - 722, 128, {0.671586, -0.704557, -0.229286}},
        {"oahu", 1050, 166, 1306723, 4096, {0.813798, -0.5, -0.296198}},
    };
    for (const auto& w : worlds) {
        const Result<BakeSource> source = openGltf((data / w.world / "world.glb").string(), {});
        ASSERT_TRUE(source) << source.error().what;
        expectSound(source.value());
        const std::vector<Listed> all = listAll(source.value());
        size_t triangles = 0, named = 0;
        for (const Listed& at : all) {
            triangles += source.value().meshes[at.instance.mesh].levels[0].indices.size() / 3;
            named += !at.name.empty();
        }
        EXPECT_EQ(all.size(), w.nodes) << w.world;
        EXPECT_EQ(source.value().meshes.size(), w.meshes) << w.world;
        EXPECT_EQ(triangles, w.triangles) << w.world;
        EXPECT_EQ(named, w.nodes) << w.world;  // DATA.md: node names are unique
        EXPECT_EQ(source.value().header.chunkSize, w.chunkSize) << w.world;
        EXPECT_LT(glm::length(source.value().header.sun - w.sun), 1e-5) << w.world;  // given with 6 digits
        EXPECT_EQ(warns(source.value(), "9 casters lie more than 5 km below"),
                  w.world == std::string("oahu"));
    }
}

}  // namespace
}  // namespace world
