// tests/world/gltf_fuzz_test.cpp — a glTF file that is wrong gives an error or a sound source, never a
// crash, and never opens what lies outside its folder.

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <functional>
#include <random>

#include "tests/world/gltf_builder.h"
#include "world/gltf.h"

namespace world {
namespace {

using Json = GltfBuilder::Json;

/// A small scene that uses every part of the reader.
GltfBuilder smallScene() {
    GltfBuilder b;
    const int blend = b.material("BLEND");
    const int p = b.positions({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}}, 4);
    Json glass = GltfBuilder::primitive(p);
    glass["material"] = blend;
    const int mesh =
        b.mesh({GltfBuilder::primitive(p, b.indices(std::vector<uint8_t>{0, 1, 2, 2, 1, 3})), glass});
    const int strip = b.mesh({GltfBuilder::primitive(p, b.indices(std::vector<uint16_t>{0, 1, 2, 3}), 5),
                              GltfBuilder::primitive(p, b.indices(std::vector<uint32_t>{0, 1, 3, 2}), 6)});
    b.node({{"mesh", mesh},
            {"name", "a"},
            {"children", {1, 2}},
            {"rotation", {0, 0, 0, 1}},
            {"scale", {1, 2, 3}}});
    b.node({{"mesh", strip}, {"name", "b"}, {"translation", {300, 0, 0}}, {"extras", {{"billboard", true}}}});
    b.node({{"mesh", mesh}, {"matrix", {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, -1, 0, 5, 6, 7, 1}}});
    b.node({{"mesh", mesh}, {"extras", {{"shadowPass", false}}}});
    b.node({{"extensions", {{"KHR_lights_punctual", {{"light", 0}}}}}});
    b.root["extensions"]["KHR_lights_punctual"]["lights"] = Json::array({Json{{"type", "directional"}}});
    b.root["extensionsUsed"] = {"KHR_lights_punctual"};
    b.root["images"] =
        Json::array({Json{{"uri", "wood.png"}}, Json{{"bufferView", 0}, {"mimeType", "image/png"}}});
    b.root["scenes"] = Json::array({Json{{"nodes", {0, 3, 4}}}});
    b.root["scene"] = 0;
    return b;
}

/// Opens the bytes; whatever comes out must be sound.
void tryOpen(const TempFolder& folder, std::string_view bytes) {
    const Result<BakeSource> source = openGltf(folder.write("f.glb", bytes), {.chunkSize = 100});
    if (source) {
        expectSound(source.value());
    } else {
        ASSERT_EQ(source.error().what.find('\n'), std::string::npos);
        ASSERT_LT(source.error().what.size(), 1000u);
    }
}

Result<BakeSource> opened(const GltfBuilder& builder) {
    const TempFolder folder;
    return openGltf(folder.write("world.glb", builder.glb()), {});
}

void expectError(const GltfBuilder& builder, ErrorCode code, const std::string& says) {
    const Result<BakeSource> source = opened(builder);
    ASSERT_FALSE(source) << says;
    EXPECT_EQ(source.error().code, code) << source.error().what;
    EXPECT_NE(source.error().what.find(says), std::string::npos)
        << source.error().what << " does not say: " << says;
    EXPECT_NE(source.error().what.find("world.glb"), std::string::npos) << source.error().what;
}

TEST(GltfFuzz, TheSceneItselfIsSound) {
    const Result<BakeSource> source = opened(smallScene());
    ASSERT_TRUE(source) << source.error().what;
    expectSound(source.value());
    EXPECT_EQ(listAll(source.value()).size(), 3u);
    EXPECT_EQ(source.value().header.sun, glm::dvec3(0, 0, -1));
}

TEST(GltfFuzz, TruncatedAtEveryLength) {
    const TempFolder folder;
    const std::string whole = smallScene().glb();
    for (size_t length = 0; length < whole.size(); ++length) {
        SCOPED_TRACE(length);
        const Result<BakeSource> source = openGltf(folder.write("f.glb", whole.substr(0, length)), {});
        ASSERT_FALSE(source);
        ASSERT_EQ(source.error().code, ErrorCode::kBadData) << source.error().what;
    }
}

TEST(GltfFuzz, TruncatedTextAtEveryLength) {
    const TempFolder folder;
    const GltfBuilder b = smallScene();
    folder.write("b.bin", b.bin);
    const std::string whole = b.gltf("b.bin");
    EXPECT_TRUE(openGltf(folder.write("f.gltf", whole), {}));
    for (size_t length = 0; length < whole.size(); ++length)
        ASSERT_FALSE(openGltf(folder.write("f.gltf", whole.substr(0, length)), {})) << length;
}

TEST(GltfFuzz, ABitOfEveryByteFlipped) {
    std::mt19937 rng(17);
    const TempFolder folder;
    const std::string whole = smallScene().glb();
    for (size_t at = 0; at < whole.size(); ++at) {
        std::string changed = whole;
        changed[at] = static_cast<char>(changed[at] ^ (1 << rng() % 8));
        SCOPED_TRACE(testing::Message() << "byte " << at << " is " << int(changed[at]));
        tryOpen(folder, changed);
        if (HasFatalFailure()) return;
    }
}

/// Every value of the tree, as a pointer to it.
void collect(Json& value, std::vector<Json*>& all) {
    all.push_back(&value);
    if (!value.is_structured()) return;
    for (Json& child : value) collect(child, all);
}

TEST(GltfFuzz, ValuesReplaced) {
    std::mt19937 rng(21);
    const TempFolder folder;
    const std::vector<Json> strange{-1,
                                    0,
                                    1,
                                    2,
                                    3,
                                    5,
                                    7,
                                    63,
                                    64,
                                    255,
                                    65535,
                                    2147483647,
                                    2147483648u,
                                    4294967295u,
                                    4294967296,
                                    9223372036854775807,
                                    18446744073709551615u,
                                    -2147483649,
                                    0.5,
                                    1e-300,
                                    1e300,
                                    -1e308,
                                    true,
                                    false,
                                    nullptr,
                                    "",
                                    "VEC3",
                                    "SCALAR",
                                    "MAT4",
                                    "BLEND",
                                    "KHR_draco_mesh_compression",
                                    "../x",
                                    Json::array(),
                                    Json::object(),
                                    {{"light", 3}},
                                    {1, 2, 3},
                                    {0, 0, 0, 0},
                                    {"POSITION"}};
    for (int step = 0; step < 3000; ++step) {
        GltfBuilder b = smallScene();
        b.root["buffers"] = Json::array({Json{{"byteLength", b.bin.size()}}});
        for (int change = 0; change <= step % 3; ++change) {
            std::vector<Json*> all;
            collect(b.root, all);
            Json& value = *all[rng() % all.size()];
            if (value.is_object() && !value.empty() && rng() % 2 == 0) {
                value.erase(std::next(value.begin(), static_cast<std::ptrdiff_t>(rng() % value.size())));
            } else {
                value = strange[rng() % strange.size()];
            }
            if (!b.root.is_object()) break;
        }
        SCOPED_TRACE(testing::Message() << "step " << step << ": " << b.root.dump());
        tryOpen(folder, GltfBuilder::frame(b.root.dump(), b.bin));
        if (HasFatalFailure()) return;
    }
}

TEST(GltfFuzz, FramesThatLie) {
    const TempFolder folder;
    const GltfBuilder b = smallScene();
    const std::string whole = b.glb();
    // Each length and type word in turn: total, JSON length, JSON type, binary length, binary type.
    const size_t json = static_cast<unsigned char>(whole[12]) |
                        static_cast<size_t>(static_cast<unsigned char>(whole[13])) << 8;
    for (const size_t at : {size_t{8}, size_t{12}, size_t{16}, 20 + json, 24 + json}) {
        for (const int64_t by :
             {-2147483648LL, -65536LL, -12LL, -8LL, -4LL, -1LL, 1LL, 4LL, 8LL, 12LL, 65536LL}) {
            uint32_t word = 0;
            std::memcpy(&word, whole.data() + at, 4);
            word += static_cast<uint32_t>(by);
            std::string changed = whole;
            std::memcpy(changed.data() + at, &word, 4);
            SCOPED_TRACE(testing::Message() << "word at " << at << " by " << by);
            tryOpen(folder, changed);
        }
    }
}

TEST(GltfFuzz, NamesWhatIsWrong) {
    const struct {
        const char* says;
        std::function<void(GltfBuilder&)> spoil;
        ErrorCode code = ErrorCode::kBadData;
    } cases[] = {
        {"mesh 0 '', primitive 0: accessor 77 does not exist",
         [](GltfBuilder& b) { b.root["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = 77; }},
        {"has no POSITION",
         [](GltfBuilder& b) { b.root["meshes"][0]["primitives"][0]["attributes"] = Json::object(); }},
        {"accessor 0 has the wrong type", [](GltfBuilder& b) { b.root["accessors"][0]["type"] = "VEC4"; }},
        {"POSITION accessor 0 is not of floats",
         [](GltfBuilder& b) { b.root["accessors"][0]["componentType"] = 5123; }},
        {"index accessor 1 is not of unsigned",
         [](GltfBuilder& b) { b.root["accessors"][1]["componentType"] = 5126; }},
        {"accessor 0 runs past its buffer view", [](GltfBuilder& b) { b.root["accessors"][0]["count"] = 5; }},
        {"accessor 0 runs past its buffer view",
         [](GltfBuilder& b) { b.root["accessors"][0]["count"] = uint64_t{1} << 60; }},
        {"accessor 0 runs past its buffer view",
         [](GltfBuilder& b) { b.root["accessors"][0]["byteOffset"] = ~uint64_t{0} - 3; }},
        {"accessor 0: buffer view 0 runs past its buffer",
         [](GltfBuilder& b) { b.root["bufferViews"][0]["byteLength"] = 100000; }},
        {"accessor 0: buffer view 0 runs past its buffer",
         [](GltfBuilder& b) { b.root["bufferViews"][0]["byteOffset"] = ~uint64_t{0}; }},
        {"accessor 0: its buffer does not exist",
         [](GltfBuilder& b) {
             b.root["bufferViews"][0]["buffer"] = 3;
             b.root.erase("images");
         }},
        {"accessor 0: its elements overlap",
         [](GltfBuilder& b) { b.root["bufferViews"][0]["byteStride"] = 8; }},
        {"accessor 0 has no buffer view", [](GltfBuilder& b) { b.root["accessors"][0].erase("bufferView"); }},
        {"accessor 0 is sparse",
         [](GltfBuilder& b) {
             b.root["accessors"][0]["sparse"] = {{"count", 1},
                                                 {"indices", {{"bufferView", 0}, {"componentType", 5121}}},
                                                 {"values", {{"bufferView", 0}}}};
         }},
        {"element 3 names vertex 9 of 4",
         [](GltfBuilder& b) { b.bin[b.root["bufferViews"][1]["byteOffset"].get<size_t>() + 3] = 9; }},
        {"POSITION accessor 0: element 1 is not finite",
         [](GltfBuilder& b) {
             const float nan = std::nanf("");
             std::memcpy(b.bin.data() + 16 + 4, &nan, 4);
         }},
        {"unknown mode 9", [](GltfBuilder& b) { b.root["meshes"][0]["primitives"][0]["mode"] = 9; }},
        {"material 5 does not exist",
         [](GltfBuilder& b) { b.root["meshes"][0]["primitives"][0]["material"] = 5; }},
        {"unknown alphaMode 'GLASS'", [](GltfBuilder& b) { b.root["materials"][0]["alphaMode"] = "GLASS"; }},
        {"node 0 'a': mesh 9 does not exist", [](GltfBuilder& b) { b.root["nodes"][0]["mesh"] = 9; }},
        {"node 0 'a': its child 9 does not exist",
         [](GltfBuilder& b) { b.root["nodes"][0]["children"] = {9}; }},
        {"node 0 'a' is its own ancestor", [](GltfBuilder& b) { b.root["nodes"][0]["children"] = {0}; }},
        {"node 0 'a' is its own ancestor", [](GltfBuilder& b) { b.root["nodes"][1]["children"] = {0}; }},
        {"node 1 'b' is a child twice", [](GltfBuilder& b) { b.root["nodes"][3]["children"] = {1}; }},
        {"node 1 'b' is a child twice",
         [](GltfBuilder& b) {
             b.root["nodes"][0]["children"] = {1, 1};
         }},
        {"node 1 'b' is placed twice by scene 0",
         [](GltfBuilder& b) {
             b.root["scenes"][0]["nodes"] = {0, 1};
         }},
        {"node 3 '' is placed twice by scene 0",
         [](GltfBuilder& b) {
             b.root["scenes"][0]["nodes"] = {3, 3};
         }},
        {"scene 0: node 9 does not exist", [](GltfBuilder& b) { b.root["scenes"][0]["nodes"] = {9}; }},
        {"scene 4 does not exist", [](GltfBuilder& b) { b.root["scene"] = 4; }},
        {"node 0 'a': its transform has the wrong number",
         [](GltfBuilder& b) {
             b.root["nodes"][0]["scale"] = {1, 2};
         }},
        {"node 2 '': its matrix is not affine", [](GltfBuilder& b) { b.root["nodes"][2]["matrix"][3] = 1; }},
        {"node 0 'a': its rotation is not a unit",
         [](GltfBuilder& b) {
             b.root["nodes"][0]["rotation"] = {0, 0, 0, 0};
         }},
        {"node 1 'b': its transform is not finite",
         [](GltfBuilder& b) {
             b.root["nodes"][0]["scale"] = {1e308, 1, 1};
             b.root["nodes"][1]["translation"] = {1e308, 0, 0};
         }},
        {"node 0 'a': its scale is too large",
         [](GltfBuilder& b) {
             b.root["nodes"][0]["scale"] = {1e300, 1, 1};
         }},
        {"node 4 '': its light does not exist",
         [](GltfBuilder& b) { b.root["nodes"][4]["extensions"]["KHR_lights_punctual"]["light"] = 2; }},
        {"requires the extension KHR_draco_mesh_compression",
         [](GltfBuilder& b) {
             b.root["extensionsRequired"] = {"KHR_materials_unlit", "KHR_draco_mesh_compression"};
         }},
        {"requires the extension EXT_meshopt_compression",
         [](GltfBuilder& b) { b.root["extensionsRequired"] = {"EXT_meshopt_compression"}; }},
        {"glTF version '1.0'", [](GltfBuilder& b) { b.root["asset"]["version"] = "1.0"; }},
        {"buffer 0: byteLength must be",
         [](GltfBuilder& b) {
             b.root["buffers"] = Json::array({Json{{"byteLength", 0}}});
         }},
        {"buffer 1 has no URI",
         [](GltfBuilder& b) {
             b.root["buffers"] = Json::array({Json{{"byteLength", 4}}, Json{{"byteLength", 4}}});
         }},
        {"nested deeper than 128 levels",
         [](GltfBuilder& b) {
             Json deep = 1;
             for (int i = 0; i < 1000; ++i) deep = Json::array({std::move(deep)});
             b.root["extras"] = std::move(deep);
         }},
    };
    for (const auto& c : cases) {
        GltfBuilder b = smallScene();
        c.spoil(b);
        expectError(b, c.code, c.says);
    }
}

TEST(GltfFuzz, DeepNestingEndsBeforeTheStack) {
    const TempFolder folder;
    const int depth = 3000000;
    const std::string text =
        R"({"asset":{"version":"2.0"},"extras":)" + std::string(depth, '[') + std::string(depth, ']') + "}";
    const Result<BakeSource> source = openGltf(folder.write("f.gltf", text), {});
    ASSERT_FALSE(source);
    EXPECT_NE(source.error().what.find("nested deeper"), std::string::npos) << source.error().what;
}

TEST(GltfFuzz, ManyNodesInAChainAreNoRecursion) {
    GltfBuilder b;
    const int mesh = b.triangleMesh();
    constexpr int kNodes = 50000;
    for (int i = 0; i < kNodes; ++i) {
        Json node{{"translation", {0, 0, 1}}};
        if (i + 1 < kNodes)
            node["children"] = {i + 1};
        else
            node["mesh"] = mesh;
        b.node(node);
    }
    const Result<BakeSource> source = opened(b);
    ASSERT_TRUE(source) << source.error().what;
    EXPECT_EQ(listAll(source.value()).at(0).instance.placement.translation, glm::dvec3(0, 0, kNodes));
}

TEST(GltfFuzz, BuffersStayInTheFolder) {
    GltfBuilder b;
    b.node({{"mesh", b.triangleMesh()}});
    const TempFolder outside;
    outside.write("secret.bin", b.bin);
    const TempFolder folder;
    folder.write("world/own buffer+1%.bin", b.bin);
    folder.write("world/sub/deep.bin", b.bin);
    folder.write("secret.bin", b.bin);
    std::filesystem::create_symlink(outside.path("secret.bin"), folder.path("world/link.bin"));
    std::filesystem::create_symlink(outside.path(""), folder.path("world/linked"));
    std::filesystem::create_symlink("sub/deep.bin", folder.path("world/inner.bin"));
    ASSERT_EQ(::mkfifo(folder.path("world/pipe.bin").c_str(), 0600), 0);
    const auto openAt = [&](const std::string& uri) {
        return openGltf(folder.write("world/scene.gltf", b.gltf(uri)), {});
    };
    for (const char* uri : {"own%20buffer%2B1%25.bin", "own buffer+1%25.bin", "sub/deep.bin",
                            "./sub/../sub/deep.bin", "sub%2Fdeep.bin", "inner.bin"}) {
        const Result<BakeSource> source = openAt(uri);
        ASSERT_TRUE(source) << uri << ": " << source.error().what;
        EXPECT_EQ(listAll(source.value()).size(), 1u) << uri;
    }
    const struct {
        std::string uri, says;
        ErrorCode code = ErrorCode::kBadData;
    } refused[] = {
        {"../secret.bin", "leaves the file's folder"},
        {"sub/../../secret.bin", "leaves the file's folder"},
        {"%2e%2e/secret.bin", "leaves the file's folder"},
        {"..%2Fsecret.bin", "leaves the file's folder"},
        {outside.path("secret.bin").string(), "leaves the file's folder"},
        {"%2Fetc/passwd", "leaves the file's folder"},
        {"link.bin", "is a link out of the file's folder"},
        {"linked/secret.bin", "is a link out of the file's folder"},
        {"file://" + outside.path("secret.bin").string(), "has a scheme"},
        {"http://example.org/b.bin", "has a scheme"},
        {"C:\\b.bin", "has a scheme"},
        {"own%20buffer%2", "not percent-encoded correctly"},
        {"own%zzbuffer", "not percent-encoded correctly"},
        {"sub/deep.bin%00.png", "not percent-encoded correctly"},
        {"data:application/x-strange;base64,AAAA", "its data: URI is not"},
        {"data:application/octet-stream;base64,AAAA", "Failed to decode"},
        {"missing.bin", "no such file", ErrorCode::kNotFound},
        {"sub", "not a regular file"},
        {"pipe.bin", "not a regular file"},
        {"", "has no URI"},
    };
    for (const auto& c : refused) {
        const Result<BakeSource> source = openAt(c.uri);
        ASSERT_FALSE(source) << c.uri;
        EXPECT_EQ(source.error().code, c.code) << source.error().what;
        EXPECT_NE(source.error().what.find(c.says), std::string::npos) << source.error().what;
        EXPECT_NE(source.error().what.find("scene.gltf"), std::string::npos) << source.error().what;
    }
    folder.write("world/short.bin", b.bin.substr(1));
    EXPECT_FALSE(openAt("short.bin"));
}

TEST(GltfFuzz, ReadsDataUris) {
    GltfBuilder b;
    b.node({{"mesh", b.triangleMesh()}});
    constexpr char kDigits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string uri = "data:application/octet-stream;base64,";
    ASSERT_EQ(b.bin.size() % 3, 0u);
    for (size_t i = 0; i < b.bin.size(); i += 3) {
        const auto byte = [&](size_t k) {
            return static_cast<uint32_t>(static_cast<unsigned char>(b.bin[i + k]));
        };
        const uint32_t bits = byte(0) << 16 | byte(1) << 8 | byte(2);
        for (int shift = 18; shift >= 0; shift -= 6) uri += kDigits[bits >> shift & 63];
    }
    const TempFolder folder;
    const Result<BakeSource> source = openGltf(folder.write("scene.gltf", b.gltf(uri)), {});
    ASSERT_TRUE(source) << source.error().what;
    EXPECT_EQ(listAll(source.value()).size(), 1u);
}

TEST(GltfFuzz, NeverReadsImages) {
    GltfBuilder b = smallScene();
    const TempFolder folder;
    // Opening a pipe that nobody writes to would wait for ever.
    ASSERT_EQ(::mkfifo(folder.path("wood.png").c_str(), 0600), 0);
    folder.write("b.bin", b.bin);
    EXPECT_TRUE(openGltf(folder.write("scene.gltf", b.gltf("b.bin")), {}));
    EXPECT_TRUE(openGltf(folder.write("scene.glb", b.glb()), {}));
}

TEST(GltfFuzz, NamesMissingFiles) {
    const TempFolder folder;
    const Result<BakeSource> missing = openGltf(folder.path("none.glb").string(), {});
    ASSERT_FALSE(missing);
    EXPECT_EQ(missing.error().code, ErrorCode::kNotFound);
    EXPECT_NE(missing.error().what.find("none.glb"), std::string::npos);
    EXPECT_FALSE(openGltf(folder.path("").string(), {}));
    EXPECT_FALSE(openGltf("", {}));
}

TEST(GltfFuzz, CountsTrianglesBeforeItStoresThem) {
    // One small index list, drawn by ever more primitives.
    GltfBuilder b;
    const int p = b.positions({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}});
    std::vector<uint8_t> list(3 << 16);
    for (size_t i = 0; i < list.size(); ++i) list[i] = static_cast<uint8_t>(i % 3);
    const Json primitive = GltfBuilder::primitive(p, b.indices(list));
    b.node({{"mesh", b.mesh(std::vector<Json>(3000, primitive))}});
    expectError(b, ErrorCode::kLimit, "triangles");
}

}  // namespace
}  // namespace world
