// tests/tools/wire_replay_test.cpp — a recorded path with movers over the wire, by the clients in C++ and in Python, beside
// the same path replayed offline: every counter and every hash is the same.
#include <algorithm>
#include <fstream>
#include <map>
#include <sstream>

#include "tests/server/worlds.h"
#include "tests/tools/served.h"
#include "world/gltf.h"
#include "world/movers.h"
#include "world/path.h"
#include "world/procedural.h"
#include "world/procedural_path.h"

namespace {

namespace fs = std::filesystem;

/// A row of a CSV without quotes, by its columns' names.
using Row = std::map<std::string, std::string>;

std::vector<std::string> split(const std::string& text, char by) {
    std::vector<std::string> parts;
    std::istringstream in(text);
    for (std::string part; std::getline(in, part, by);) parts.push_back(part);
    return parts;
}

std::vector<Row> readRows(const std::string& path) {
    std::ifstream in(path);
    std::string line;
    std::getline(in, line);
    const std::vector<std::string> names = split(line, ',');
    std::vector<Row> rows;
    while (std::getline(in, line)) {
        std::vector<std::string> values = split(line, ',');
        values.resize(names.size());
        Row& row = rows.emplace_back();
        for (size_t i = 0; i < names.size(); ++i) row[names[i]] = values[i];
    }
    return rows;
}

/// What a client's row says of causes, as columns of their own, as the replay has them.
void spreadCauses(Row& row) {
    for (const std::string& cause : split(row.at("causes"), ';')) {
        const std::vector<std::string> parts = split(cause, ':');
        if (parts.size() != 5) throw std::runtime_error("causes: " + cause);
        row[parts[0] + "_texels"] = parts[1];
        row[parts[0] + "_casters"] = parts[2];
        row[parts[0] + "_triangles"] = parts[3];
        row[parts[0] + "_draws"] = parts[4];
    }
    row.erase("causes");
}

/// Columns of the replay whose values a session's reply has.
bool told(const std::string& column) {
    static const char* const kElsewhere[] = {"time", "move_", "triangles_hidden", "casters_dropped", "sun_error", "frame_sun_",
                                             "frame_limit_", "frame_longest_lack", "frame_bytes_again", "frame_edits", "frame_errors", "frame_spot_",
                                             "frame_verified", "frame_skipped", "frame_differing", "t_"};
    return std::none_of(std::begin(kElsewhere), std::end(kElsewhere), [&](const char* begin) { return column.starts_with(begin); });
}

/// Holds a client's rows against the replay's, value by value.
void expectEqual(const std::vector<Row>& replayed, std::vector<Row> driven, const std::string& client) {
    ASSERT_EQ(driven.size(), replayed.size()) << client;
    size_t values = 0, hashes = 0, active = 0;
    for (size_t i = 0; i < driven.size(); ++i) {
        spreadCauses(driven[i]);
        for (const auto& [column, value] : replayed[i]) {
            if (!told(column)) continue;
            const bool hash = column == "cache_hash" || column == "working_hash";
            if (hash && value.empty()) continue;  // the replay has hashes on frames that it verifies
            const auto found = driven[i].find(column);
            const std::string wire = found == driven[i].end() ? "0" : found->second;  // a cause without cost
            ASSERT_EQ(wire, value) << client << ", frame " << replayed[i].at("frame") << ", cascade " << replayed[i].at("cascade") << ", " << column;
            ++values;
            hashes += hash;
        }
        for (const auto& [column, value] : driven[i]) ASSERT_TRUE(replayed[i].contains(column)) << client << ": " << column;
        active += driven[i].at("active_texels") != "0";
    }
    EXPECT_GT(values, driven.size() * 60);  // nearly all columns, and not a handful
    EXPECT_GT(hashes, 0u);
    EXPECT_GT(active, 0u) << "nothing moved";
}

/// Replays `path` offline and over the wire.
///   folder  holds NAME.world, and gets what comes of it
void expectSameOverTheWire(const std::string& folder, const std::string& name, const std::vector<world::Pose>& path,
                           const std::vector<world::MoverTrack>& tracks, const std::string& verify) {
    ASSERT_TRUE(world::writeTum(folder + "/path.tum", path));
    ASSERT_TRUE(world::writeMovers(folder + "/movers.csv", tracks));
    const std::string inputs = " '" + folder + "/path.tum' ", movers = "'" + folder + "/movers.csv'";
    // The service's own memory of a session.
    const auto offline = tests::run(std::string(GNOMON_BINARY) + " replay '" + folder + "/" + name + ".world' --path" + inputs + "--movers " + movers +
                                    " --gpu-budget 256 --memory-budget 1024 --verify=" + verify + " --out '" + folder + "/replay'");
    ASSERT_EQ(offline.status, 0) << offline.text;
    const std::vector<Row> replayed = readRows(folder + "/replay/frames.csv");
    ASSERT_EQ(replayed.size(), path.size() * 4);

    tests::Served served(folder, "unix:" + folder + "/socket");
    const auto cpp = tests::run(std::string(GNOMON_DRIVE_CITY) + " " + served.address() + " " + name + inputs + movers + " >" + folder + "/cpp.csv");
    ASSERT_EQ(cpp.status, 0) << cpp.text;
    EXPECT_EQ(cpp.text, "");
    expectEqual(replayed, readRows(folder + "/cpp.csv"), "C++");

    const auto python = tests::run("PYTHONPATH=" GNOMON_PYTHON " /usr/bin/python3 " GNOMON_SOURCE_DIR "/tools/examples/drive_city.py " + name + inputs +
                                   "--movers " + movers + " --server " + served.address() + " >" + folder + "/python.csv");
    ASSERT_EQ(python.status, 0) << python.text;
    EXPECT_EQ(python.text, "");
    expectEqual(replayed, readRows(folder + "/python.csv"), "Python");
    EXPECT_EQ(served.stop(), 0);
}

TEST(WireReplay, OfTheBuiltInWorldIsTheReplay) {
    world::ProceduralOptions options;
    options.size = 1024;
    options.voxel = 4;
    options.instances = 4000;
    const std::string folder = tests::temporary("built-in");
    fs::create_directory(folder);
    const auto source = world::openProcedural(7, options);
    ASSERT_TRUE(source);
    ASSERT_TRUE(world::bake(source.value(), folder + "/small.world", [](size_t, size_t) {}));
    const auto path = world::proceduralPath(7, options);
    // Around the jump: driving, everything anew, standing.
    size_t jump = 1;
    for (size_t i = 1; i < path.size(); ++i)
        if (glm::distance(path[i].position, path[i - 1].position) > glm::distance(path[jump].position, path[jump - 1].position)) jump = i;
    const std::vector<world::Pose> part(path.begin() + std::ptrdiff_t(jump) - 25, path.begin() + std::ptrdiff_t(jump) + 15);
    expectSameOverTheWire(folder, "small", part, world::proceduralMovers(7, options), "4");
}

TEST(WireReplay, OfARecordedDriveIsTheReplay) {
    const std::string data = std::string(GNOMON_SOURCE_DIR) + "/../shared/data/stk/candela_city";
    if (!fs::exists(data)) GTEST_SKIP() << "no ../shared";
    const std::string folder = tests::temporary("city");
    fs::create_directory(folder);
    const auto source = world::openGltf(data + "/world.glb", {});
    ASSERT_TRUE(source);
    ASSERT_TRUE(world::bake(source.value(), folder + "/candela_city.world", [](size_t, size_t) {}));
    const auto path = world::readTum(data + "/paths/standard_expert_candela_city.tum");
    ASSERT_TRUE(path);
    const std::vector<world::Pose> part(path.value().begin() + 100, path.value().begin() + 160);
    const auto movers = world::readMovers(data + "/movers.csv");
    ASSERT_TRUE(movers);
    expectSameOverTheWire(folder, "candela_city", part, movers.value(), "10");
}

}  // namespace
