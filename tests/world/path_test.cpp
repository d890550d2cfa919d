// tests/world/path_test.cpp — paths read back as written, and bad lines are named.

#include "world/path.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <random>

#include "tests/world/temp_file.h"

namespace world {
namespace {

/// A file that goes with the test.
Error errorOf(std::string_view text) {
    const test::TempFile file("path.tum");
    file.write(text);
    const Result<std::vector<Pose>> poses = readTum(file.path());
    EXPECT_FALSE(poses) << text;
    return poses ? Error{} : poses.error();
}

glm::dquat randomTurn(std::mt19937& rng) {
    std::normal_distribution<double> normal;
    return glm::normalize(glm::dquat(normal(rng), normal(rng), normal(rng), normal(rng)));
}

TEST(Path, ReadsBackWhatItWrote) {
    std::mt19937 rng(5);
    std::uniform_real_distribution<double> step(1e-6, 1), place(-1e6, 1e6);  // 1000 km and more out
    for (const size_t count : {1u, 2u, 1000u}) {
        std::vector<Pose> poses;
        double time = -3;
        for (size_t i = 0; i < count; ++i)
            poses.push_back({time += step(rng), {place(rng), place(rng), place(rng)}, randomTurn(rng)});
        const test::TempFile file("path.tum");
        ASSERT_TRUE(writeTum(file.path(), poses));
        const Result<std::vector<Pose>> read = readTum(file.path());
        ASSERT_TRUE(read) << read.error().what;
        ASSERT_EQ(read.value().size(), count);
        for (size_t i = 0; i < count; ++i) {
            EXPECT_EQ(read.value()[i].time, poses[i].time) << i;
            EXPECT_EQ(read.value()[i].position, poses[i].position) << i;
            EXPECT_EQ(read.value()[i].orientation, poses[i].orientation) << i;
        }
    }
}

TEST(Path, TakesWhatOthersWrite) {
    const test::TempFile file("path.tum");
    file.write(
        "\xef\xbb\xbf# a comment\r\n\r\n  0.5\t1 2 +3   0 0 0 1.0005 # and one here\r\n"
        "1e0 1 2 3 0 0 0 -0.9995");
    const Result<std::vector<Pose>> poses = readTum(file.path());
    ASSERT_TRUE(poses) << poses.error().what;
    ASSERT_EQ(poses.value().size(), 2u);
    EXPECT_EQ(poses.value()[0].time, 0.5);
    EXPECT_EQ(poses.value()[0].position, glm::dvec3(1, 2, 3));
    EXPECT_EQ(poses.value()[0].orientation, glm::dquat(1, 0, 0, 0));  // normalised
    EXPECT_EQ(poses.value()[1].orientation, glm::dquat(-1, 0, 0, 0));
}

TEST(Path, NamesTheBadLine) {
    const std::string good = "0 0 0 0 0 0 0 1\n";
    const struct {
        const char* line;
        const char* says;
    } cases[] = {
        {"1 0 0 0 0 0 0", "7 fields"},
        {"1 0 0 0 0 0 0 1 9", "9 fields"},
        {"1 0 0 nan 0 0 0 1", "field 4 is not a finite number"},
        {"inf 0 0 0 0 0 0 1", "field 1 is not a finite number"},
        {"1 0 1e999 0 0 0 0 1", "field 3 is not a finite number"},
        {"1 0 0 0 0 0 0 1x", "field 8 is not a finite number"},
        {"1,0,0,0,0,0,0,1", "field 1 is not a finite number"},
        {"1 0 0 0 0 0 +-0 1", "field 7 is not a finite number"},
        {"1 0 0 0 0 0 0 0", "length is not 1"},
        {"1 0 0 0 0 0 0 1.01", "length is not 1"},
        {"0 0 0 0 0 0 0 1", "does not ascend"},
        {"-1 0 0 0 0 0 0 1", "does not ascend"},
    };
    for (const auto& c : cases) {
        const Error error = errorOf("# comment\n" + good + c.line + "\n9 0 0 0 0 0 0 1\n");
        EXPECT_EQ(error.code, ErrorCode::kBadData);
        EXPECT_NE(error.what.find(".tum:3: "), std::string::npos) << error.what;
        EXPECT_NE(error.what.find(c.says), std::string::npos) << error.what;
    }
    EXPECT_NE(errorOf("").what.find("no poses"), std::string::npos);
    EXPECT_NE(errorOf("# nothing\n\n").what.find("no poses"), std::string::npos);
    EXPECT_NE(errorOf(std::string(100000, '1')).what.find("64 KiB"), std::string::npos);
}

TEST(Path, SurvivesTruncationAtEveryLength) {
    const std::string text = "# path\n0 1 2 3 0 0 0 1\n1.5 4 5 6 0 0 1 0\n";
    const test::TempFile file("path.tum");
    for (size_t length = 0; length <= text.size(); ++length) {
        file.write(std::string_view(text).substr(0, length));
        const Result<std::vector<Pose>> poses = readTum(file.path());
        if (!poses) {
            EXPECT_NE(poses.error().what.find(".tum:"), std::string::npos) << poses.error().what;
            continue;
        }
        EXPECT_FALSE(poses.value().empty()) << length;
        for (const Pose& pose : poses.value()) EXPECT_NEAR(glm::length(pose.orientation), 1, 1e-12) << length;
    }
}

TEST(Path, SaysWhichFileIsMissing) {
    const Result<std::vector<Pose>> poses = readTum("/nowhere/at/all.tum");
    ASSERT_FALSE(poses);
    EXPECT_EQ(poses.error().code, ErrorCode::kNotFound);
    EXPECT_NE(poses.error().what.find("/nowhere/at/all.tum"), std::string::npos);
    ASSERT_FALSE(readTum(testing::TempDir()));
    const Result<Done> written = writeTum("/nowhere/at/all.tum", {Pose{}});
    ASSERT_FALSE(written);
    EXPECT_EQ(written.error().code, ErrorCode::kIo);
}

TEST(Path, RefusesToWriteWhatItWouldNotRead) {
    const test::TempFile file("path.tum");
    file.write("precious");
    const Result<Done> written = writeTum(file.path(), {Pose{0, {std::nan(""), 0, 0}, {1, 0, 0, 0}}});
    ASSERT_FALSE(written);
    EXPECT_EQ(written.error().code, ErrorCode::kUsage);
    std::ifstream in(file.path());
    std::string text;
    in >> text;
    EXPECT_EQ(text, "precious");
}

TEST(Path, HoldsItsEnds) {
    const std::vector<Pose> path{{1, {1, 2, 3}, {1, 0, 0, 0}}, {2, {3, 2, 1}, {0, 1, 0, 0}}};
    for (const double before : {-1e9, 0.0, 1.0}) EXPECT_EQ(poseAt(path, before).position, path[0].position);
    for (const double after : {2.0, 2.5, 1e9}) EXPECT_EQ(poseAt(path, after).position, path[1].position);
    EXPECT_EQ(poseAt(path, 7).orientation, path[1].orientation);
    EXPECT_EQ(poseAt(path, 7).time, 7);
    EXPECT_EQ(poseAt({path[0]}, 1.5).position, path[0].position);
}

TEST(Path, InterpolatesAlongTheShorterArc) {
    std::mt19937 rng(9);
    std::uniform_real_distribution<double> place(-100, 100), part(0, 1);
    for (int step = 0; step < 2000; ++step) {
        const glm::dquat a = randomTurn(rng);
        glm::dquat b = step % 3 == 0 ? glm::normalize(a + randomTurn(rng) * 1e-9) : randomTurn(rng);
        if (step % 2 == 0) b = -b;  // the same rotation; the way there must not change
        const std::vector<Pose> path{{0, {place(rng), place(rng), place(rng)}, a},
                                     {0.25, {place(rng), place(rng), place(rng)}, b}};
        const double f = part(rng);
        const Pose pose = poseAt(path, 0.25 * f);
        const glm::dvec3 expected = path[0].position * (1 - f) + path[1].position * f;
        // Sums of numbers up to 100 round at 1e-14.
        EXPECT_LT(glm::length(pose.position - expected), 1e-12) << step;
        EXPECT_NEAR(glm::length(pose.orientation), 1, 1e-14) << step;
        const auto angle = [](const glm::dquat& p, const glm::dquat& q) {
            const glm::dquat d = glm::conjugate(p) * q;
            return 2 * std::atan2(glm::length(glm::dvec3(d.x, d.y, d.z)), std::abs(d.w));
        };
        // acos within slerp loses half the digits for nearly equal turns.
        EXPECT_NEAR(angle(a, pose.orientation), f * angle(a, b), 1e-7) << step;
        EXPECT_NEAR(angle(pose.orientation, b), (1 - f) * angle(a, b), 1e-7) << step;
    }
}

TEST(Path, ReadsTheRecordedFlightsAndDrives) {
    const std::filesystem::path data = std::filesystem::path(GNOMON_SOURCE_DIR) / "../shared/data";
    if (!std::filesystem::exists(data)) GTEST_SKIP() << "no ../shared";
    size_t paths = 0, poses = 0;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(data)) {
        if (entry.path().extension() != ".tum") continue;
        const Result<std::vector<Pose>> read = readTum(entry.path().string());
        ASSERT_TRUE(read) << read.error().what;
        std::ifstream in(entry.path());
        size_t rows = 0;
        for (std::string line; std::getline(in, line);) rows += !line.empty() && line[0] != '#';
        EXPECT_EQ(read.value().size(), rows) << entry.path();
        ++paths;
        poses += rows;
    }
    EXPECT_EQ(paths, 10u);
    EXPECT_GT(poses, 12000u);  // the two flights alone have 12,590
}

}  // namespace
}  // namespace world
