// tests/tools/command_test.cpp — the real programs with bad input: status, one line, nothing left behind.
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <set>

#include "tests/world/hills_world.h"
#include "world/path.h"

namespace {

namespace fs = std::filesystem;

struct Outcome {
    int status = -1;
    std::string text;  ///< stdout and stderr
};

class Commands : public testing::Test {
protected:
    fs::path folder_;

    void SetUp() override {
        // Cases run side by side as processes of their own: each has its folder.
        const auto* info = testing::UnitTest::GetInstance()->current_test_info();
        folder_ = fs::path(testing::TempDir()) / ("gnomon_command_" + std::string(info->name()));
        fs::remove_all(folder_);
        fs::create_directories(folder_);
    }
    void TearDown() override { fs::remove_all(folder_); }

    /// Runs a program in the test's folder.
    Outcome run(const std::string& program, const std::string& arguments) const {
        const std::string line =
            "cd '" + folder_.string() + "' && '" + program + "' " + arguments + " 2>&1 </dev/null";
        Outcome outcome;
        FILE* pipe = popen(line.c_str(), "r");
        if (!pipe) return outcome;
        std::array<char, 4096> buffer;
        while (const size_t read = fread(buffer.data(), 1, buffer.size(), pipe))
            outcome.text.append(buffer.data(), read);
        const int status = pclose(pipe);
        outcome.status = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
        return outcome;
    }
    Outcome gnomon(const std::string& arguments) const { return run(GNOMON_BINARY, arguments); }

    void put(const std::string& name, const std::string& text) const {
        std::ofstream(folder_ / name) << text;
    }
    std::set<std::string> files() const {
        std::set<std::string> names;
        for (const auto& entry : fs::recursive_directory_iterator(folder_))
            names.insert(entry.path().lexically_relative(folder_).string());
        return names;
    }

    /// One line that names `word`, the given status, and the folder as it was.
    void expectRefusal(const std::string& arguments, int status, const std::string& word) const {
        const std::set<std::string> before = files();
        const Outcome outcome = gnomon(arguments);
        EXPECT_EQ(outcome.status, status) << arguments << "\n" << outcome.text;
        EXPECT_EQ(std::count(outcome.text.begin(), outcome.text.end(), '\n'), 1) << outcome.text;
        EXPECT_TRUE(outcome.text.starts_with("gnomon: ")) << outcome.text;
        EXPECT_NE(outcome.text.find(word), std::string::npos) << outcome.text;
        EXPECT_EQ(files(), before) << arguments;
    }
};

TEST_F(Commands, BadOptionsAreUsage) {
    expectRefusal("", 2, "subcommand");
    expectRefusal("bake", 2, "source");
    expectRefusal("bake x.glb", 2, "--output");
    expectRefusal("replay a.world", 2, "--path");
    expectRefusal("lab a.world", 2, "--path");
    expectRefusal("replay a.world --path p --bogus", 2, "--bogus");
    expectRefusal("replay a.world --path p --method magic", 2, "magic");
    expectRefusal("replay a.world --path p --occlusion maybe", 2, "maybe");
    expectRefusal("replay a.world --path p --sun 90,-5", 2, "--sun");
    expectRefusal("replay a.world --path p --sun east", 2, "--sun");
    expectRefusal("replay a.world --path p --spot 1,2,3", 2, "--spot 1,2,3");
    expectRefusal("replay a.world --path p --spot 0,9,0,0,-1,0,35,30 --spot 0,9,0,0,-1,0,95,30", 2, "half-angle");
    expectRefusal("replay a.world --path p --threads=-1", 2, "--threads");
    expectRefusal("lab a.world --path p --every=-1", 2, "--every");
    expectRefusal("lab a.world --path p --far nan", 2, "--far");
    expectRefusal("lab a.world --path p --methods gnomn", 2, "nearest is gnomon");
    expectRefusal("lab a.world --path p --methods doughnut,gnomon:sied=512", 2, "nearest is side");
    expectRefusal("tune a.world --path p", 2, "--max-error");
    expectRefusal("tune a.world --path p --max-error nan", 2, "--max-error");
    expectRefusal("tune a.world --path p --max-error 1 --start engel", 2, "keeps no cache");
    expectRefusal("bake procedural:x -o a.world", 2, "procedural:x");
    expectRefusal("bake procedural:7 -o a.world --sun 0,0", 2, "--sun");
    expectRefusal("bake procedural:7 -o a.world --bounds 0,0,1,1", 2, "--bounds");
    expectRefusal("bake dem.tif -o a.world --bounds 3,0,1,1", 2, "--bounds");
    expectRefusal("bake dem.tif -o a.world --chunk=-3", 2, "--chunk");
    expectRefusal("bake a.glb dem.tif -o a.world", 2, "dem.tif");
    expectRefusal("bake a.glb procedural:7 -o a.world", 2, "procedural:7");
}

TEST_F(Commands, MissingAndForeignFilesAreData) {
    expectRefusal("info missing.world", 3, "missing.world");
    expectRefusal("replay missing.world --path p.tum", 3, "missing.world");
    expectRefusal("bake missing.glb -o a.world", 3, "missing.glb");
    expectRefusal("bake missing.tif -o a.world", 3, "missing.tif");
    put("text.world", "this is no world");
    put("text.glb", "this is no scene");
    put("text.tif", "this is no elevation model");
    expectRefusal("info text.world --check", 3, "text.world");
    expectRefusal("bake text.glb -o a.world", 3, "text.glb");
    expectRefusal("bake text.tif -o a.world", 3, "text.tif");
    put("empty.world", "");
    expectRefusal("info empty.world", 3, "empty.world");
}

TEST_F(Commands, HelpIsNoError) {
    for (const char* arguments : {"--help", "bake --help", "edit --help", "info --help", "replay --help"})
        EXPECT_EQ(gnomon(arguments).status, 0) << arguments;
    EXPECT_EQ(run(GNOMON_BENCH_BINARY, "--help").status, 0);
}

TEST_F(Commands, TheBenchmarkRefusesWhatItCannotMeasure) {
    for (const char* arguments :
         {"", "a.world --yardstick", "--sizes 1e4 --yardstick", "--yardstick --path a.tum", "--sizes 1e4",
          "--sizes 1e4,x --work .", "a.world --frames 0"})
        EXPECT_EQ(run(GNOMON_BENCH_BINARY, arguments).status, 2) << arguments;
    EXPECT_EQ(run(GNOMON_BENCH_BINARY, "missing.world").status, 3);
}

/// A glTF scene of one box 20 m wide, text only: enough of a world to refuse things about.
constexpr const char* kScene = R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],
"nodes":[{"mesh":0,"name":"slab"}],"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[20,5,20]},
{"bufferView":1,"componentType":5123,"count":3,"type":"SCALAR"}],
"bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":6}],
"buffers":[{"byteLength":42,"uri":"data:application/octet-stream;base64,)";

std::string base64(const std::string& bytes) {
    constexpr const char* digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string text;
    for (size_t k = 0; k < bytes.size(); k += 3) {
        uint32_t group = 0;
        for (size_t j = 0; j < 3; ++j)
            group = group << 8 | (k + j < bytes.size() ? uint8_t(bytes[k + j]) : 0);
        for (size_t j = 0; j < 4; ++j)
            text += k + j > bytes.size() ? '=' : digits[group >> (18 - 6 * j) & 63];
    }
    return text;
}

std::string scene() {
    const std::array<float, 9> positions{0, 0, 0, 20, 5, 0, 0, 0, 20};
    const std::array<uint16_t, 3> indices{0, 1, 2};
    return kScene +
           base64(std::string(reinterpret_cast<const char*>(positions.data()), sizeof positions) +
                  std::string(reinterpret_cast<const char*>(indices.data()), sizeof indices)) +
           "\"}]}";
}

TEST_F(Commands, ASmallWorldIsBakedShownAndGuardsItsReplays) {
    put("scene.gltf", scene());
    const Outcome baked = gnomon("bake scene.gltf -o small.world --sun 135,40 --threads 1");
    ASSERT_EQ(baked.status, 0) << baked.text;
    EXPECT_NE(baked.text.find("1 chunks, 1 instances"), std::string::npos) << baked.text;
    EXPECT_EQ(files(), (std::set<std::string>{"scene.gltf", "small.world"}));
    const Outcome info = gnomon("info small.world --check");
    EXPECT_EQ(info.status, 0) << info.text;
    EXPECT_NE(info.text.find("azimuth 135.000, elevation 40.000"), std::string::npos) << info.text;
    EXPECT_NE(info.text.find("1 instances of 1 meshes"), std::string::npos) << info.text;

    put("near.tum", "0 5 2 5 0 0 0 1\n1 6 2 5 0 0 0 1\n");
    put("far.tum", "0 50000 2 5 0 0 0 1\n1 50001 2 5 0 0 0 1\n");
    put("broken.tum", "0 5 2 5 0 0 0 1\n1 6 two 5 0 0 0 1\n");
    put("ghost.csv", "time,id,node_or_mesh,x,y,z,qx,qy,qz,qw,scale\n0,0,ghost,0,0,0,0,0,0,1,1\n");
    expectRefusal("replay small.world --path missing.tum", 3, "missing.tum");
    expectRefusal("replay small.world --path broken.tum", 3, "broken.tum:2");
    expectRefusal("replay small.world --path far.tum", 2, "50000");
    for (const char* range : {"5:6", "0:3", "1:1", "2:1", "x"})
        expectRefusal(std::string("replay small.world --path near.tum --frames ") + range, 2, "--frames");
    expectRefusal("replay small.world --path near.tum --fps=-2", 2, "--fps");
    expectRefusal("replay small.world --path near.tum --verify=0", 2, "--verify");
    expectRefusal("replay small.world --path near.tum --cascades 9", 2, "cascades");
    expectRefusal("replay small.world --path near.tum --resolution 7", 2, "resolution");
    expectRefusal("replay small.world --path near.tum --far=-5", 2, "far");
    expectRefusal("replay small.world --path near.tum --movers missing.csv", 3, "missing.csv");
    expectRefusal("replay small.world --path near.tum --movers ghost.csv", 3, "ghost");
    expectRefusal("replay small.world --path near.tum --device no-such-device", 3, "no-such-device");
    expectRefusal("replay small.world --path near.tum --out scene.gltf", 3, "scene.gltf");
    expectRefusal("replay small.world --path near.tum --out a/b --dump scene.gltf/c", 3, "scene.gltf");
    expectRefusal("lab small.world --path near.tum --methods gnomom", 2, "gnomon");
    expectRefusal("lab small.world --path near.tum --frames 0:1", 2, "one frame");
    expectRefusal("lab small.world --path near.tum --out scene.gltf", 3, "scene.gltf");
}

TEST_F(Commands, EditsAreToldOneByOneAndBadOnesByTheirLine) {
    ASSERT_TRUE(world::bake(world::test::hillsWorld(2, 16, 2), (folder_ / "hills.world").string(), {}));
    expectRefusal("edit hills.world", 2, "edits");
    expectRefusal("edit hills.world missing.txt", 3, "missing.txt");
    put("good.txt", "# a hole, and something on it\n\ndig sphere 32 0 32 6\r\nfill  box 20 -2 20 40 4 30\n"
                    "dig capsule 10 0 10 35 0 35 2.5\n  \ndig sphere 32 55 32 1\n");
    expectRefusal("edit missing.world good.txt", 3, "missing.world");
    const Outcome edited = gnomon("edit hills.world good.txt");
    EXPECT_EQ(edited.status, 0) << edited.text;
    EXPECT_EQ(edited.text, "edit 1: 4 chunks changed\nedit 2: 4 chunks changed\nedit 3: 4 chunks changed\n"
                           "edit 4: 0 chunks changed\n");
    EXPECT_EQ(gnomon("info hills.world --check").status, 0);
    for (const char* bad : {"dig", "dig hole 1 2 3 4", "bury sphere 1 2 3 4", "dig sphere 1 2 3", "dig sphere 1 2 3 4 5",
                            "dig sphere 1 2 3 nan", "dig sphere 1 2 3 x", "dig sphere 1 2 3 -4", "fill box 5 0 0 4 1 1"}) {
        put("bad.txt", std::string("\n").append(bad).append("\n"));
        expectRefusal("edit hills.world bad.txt", 2, "bad.txt:2: ");
    }
    put("bad.txt", "dig sphere 1 2 3 1000\n");
    expectRefusal("edit hills.world bad.txt", 3, "bad.txt:1: dig: ");
    put("bad.txt", "dig sphere 1000 0 3 1\n");
    expectRefusal("edit hills.world bad.txt", 3, "no terrain");
    put("scene.gltf", scene());
    ASSERT_EQ(gnomon("bake scene.gltf -o flat.world --sun 135,40").status, 0);
    put("bad.txt", "dig sphere 1 2 3 1\n");
    expectRefusal("edit flat.world bad.txt", 2, "this world has no terrain");
}

TEST_F(Commands, AReplayWithSpotLightsComparesThemAndSumsThemUp) {
    put("scene.gltf", scene());
    ASSERT_EQ(gnomon("bake scene.gltf -o small.world --sun 135,40").status, 0);
    put("walk.tum", "0 5 2 5 0 0 0 1\n1 6 2 5 0 0 0 1\n");
    const std::string small = "replay small.world --path walk.tum --resolution 64 --cascades 2 --far 50 --verify";
    ASSERT_EQ(gnomon(small + " --out without").status, 0);
    const Outcome with = gnomon(small + " --spot -5,9,5,1,-0.5,0,35,30 --spot 10,20,10,0,-1,0,20,40");
    ASSERT_EQ(with.status, 0) << with.text;
    EXPECT_NE(with.text.find("Spot 0     redrawn 1 for start: 262,144 texels, 1 triangles;"), std::string::npos) << with.text;
    EXPECT_NE(with.text.find("Spot 1     redrawn 1 for start: "), std::string::npos) << with.text;
    // Two frames, two cascades of 64 x 64 and two lights of 512 x 512, two maps each.
    EXPECT_NE(with.text.find("Verified   2 frames, 2.130 M texels compared, 0 differ"), std::string::npos) << with.text;
    const auto lines = [&](const std::string& path) {
        std::ifstream file(folder_ / path);
        std::string text(std::istreambuf_iterator<char>(file), {});
        return text;
    };
    EXPECT_NE(lines("small.replay/summary.json").find("\"half_angle_rad\": 0.61"), std::string::npos);
    EXPECT_NE(lines("without/summary.json").find("\"spots\": []"), std::string::npos);
}

TEST_F(Commands, AReplayWritesAllItsResults) {
    put("scene.gltf", scene());
    ASSERT_EQ(gnomon("bake scene.gltf -o small.world --sun 135,40").status, 0);
    put("walk.tum", "0 5 2 5 0 0 0 1\n1 6 2 5 0 0 0 1\n2 8 2 5 0 0 0 1\n3 20 2 5 0 0 0 1\n");
    const std::string small = "replay small.world --path walk.tum --resolution 64 --cascades 2 --far 50";
    const Outcome first = gnomon(small + " --verify --dump pictures");
    ASSERT_EQ(first.status, 0) << first.text;
    EXPECT_NE(first.text.find("0 differ"), std::string::npos) << first.text;
    for (const char* name :
         {"small.replay/frames.csv", "small.replay/summary.json", "pictures/frame_000003_cascade_1.png",
          "pictures/frame_000000_cascade_0_depth.png"})
        EXPECT_TRUE(files().contains(name)) << name;

    // Another number of threads and another run: all but the times are equal.
    for (const std::string threads : {"1", "2", "5"}) {
        const Outcome second = gnomon(small + " --verify --threads " + threads + " --out second" + threads);
        ASSERT_EQ(second.status, 0) << second.text;
        std::ifstream a(folder_ / "small.replay/frames.csv"),
            b(folder_ / ("second" + threads) / "frames.csv");
        std::string lineA, lineB;
        std::getline(a, lineA);
        const size_t noisy =
            size_t(std::count(lineA.begin(), lineA.begin() + ptrdiff_t(lineA.find(",t_")), ','));
        const auto deterministic = [&](const std::string& line) {
            size_t end = 0;
            for (size_t k = 0; k <= noisy; ++k) end = line.find(',', end + 1);
            return line.substr(0, end);
        };
        size_t rows = 0;
        std::getline(b, lineB);
        while (std::getline(a, lineA)) {
            ASSERT_TRUE(std::getline(b, lineB));
            EXPECT_EQ(deterministic(lineA), deterministic(lineB));
            ++rows;
        }
        EXPECT_EQ(rows, 8u);
    }
}

TEST_F(Commands, ReportsRefuseWhatIsNoRun) {
    expectRefusal("report", 2, "runs");
    expectRefusal("report missing.sqlite", 3, "missing.sqlite");
    expectRefusal("report missing.sqlite#4 -o a.html", 3, "missing.sqlite");
    put("text.sqlite", std::string(5000, 'x'));
    expectRefusal("report text.sqlite", 3, "text.sqlite: holds no results");
    put("scene.gltf", scene());
    ASSERT_EQ(gnomon("bake scene.gltf -o small.world --sun 135,40").status, 0);
    put("walk.tum", "0 5 2 5 0 0 0 1\n1 6 2 5 0 0 0 1\n2 8 2 5 0 0 0 1\n3 20 2 5 0 0 0 1\n");
    const std::string small = "replay small.world --path walk.tum --resolution 64 --cascades 2 --far 50";
    expectRefusal(small + " --results text.sqlite", 3, "text.sqlite: holds no results");
    expectRefusal(small + " --results none/r.sqlite", 3, "none/r.sqlite");
    expectRefusal(small + " --dump-frames 1", 2, "--dump");
    expectRefusal(small + " --dump d --dump-frames 1,7", 2, "--dump-frames 7");
    const Outcome run = gnomon(small + " --verify --results r.sqlite --dump d --dump-frames 1,3");
    ASSERT_EQ(run.status, 0) << run.text;
    EXPECT_NE(run.text.find("r.sqlite#1 holds the run"), std::string::npos) << run.text;
    EXPECT_TRUE(files().contains("d/frame_000001_cascade_1.png"));
    EXPECT_FALSE(files().contains("d/frame_000000_cascade_1.png"));
    expectRefusal("report r.sqlite#9", 3, "there is no such run; the newest of r.sqlite are #1 replay");
    expectRefusal("report r.sqlite --diff", 2, "two runs");
    expectRefusal("report r.sqlite --gate 'triangels.max < 5'", 2, "nearest is triangles");
    expectRefusal("report r.sqlite --gate 'triangles.max <= 1x'", 2, "--diff");
    expectRefusal("report r.sqlite --export a.xls", 2, "a.xls");
    expectRefusal("report r.sqlite --export none/a.csv", 3, "none/a.csv");
    expectRefusal("report r.sqlite -o none/a.html", 3, "none/a.html");
    EXPECT_EQ(gnomon("report r.sqlite --gate 'triangles.max < 0'").status, 1);
    const Outcome kept = gnomon("report --diff r.sqlite r.sqlite --gate 'triangles.max <= 1x; frame_differing_texels.max == 0' -o a.html");
    EXPECT_EQ(kept.status, 0) << kept.text;
    EXPECT_NE(kept.text.find("Nothing differs"), std::string::npos) << kept.text;
    const Outcome exported = gnomon("report r.sqlite --export a.csv");
    EXPECT_EQ(exported.status, 0) << exported.text;
    const auto text = [&](const std::string& name) {
        std::ifstream file(folder_ / name);
        return std::string(std::istreambuf_iterator<char>(file), {});
    };
    EXPECT_EQ(text("a.csv"), text("small.replay/frames.csv"));
    EXPECT_EQ(gnomon("report r.sqlite --export a.png").status, 0);
    EXPECT_EQ(text("a.png").substr(37, 4), "acTL");
}

TEST_F(Commands, LabWantsAWorldOrTheSuite) {
    for (const std::string arguments : {"lab", "lab hills.world", "lab --path way.tum"}) {
        const Outcome neither = gnomon(arguments);
        EXPECT_EQ(neither.status, 2) << arguments;
        EXPECT_NE(neither.text.find("--suite"), std::string::npos) << neither.text;
    }
    for (const std::string arguments : {"hills.world", "--path way.tum", "--methods gnomon", "--sun 0,40"})
        EXPECT_EQ(gnomon("lab --suite " + arguments).status, 2) << arguments;
}

}  // namespace
