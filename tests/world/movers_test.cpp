// tests/world/movers_test.cpp — recorded motion reads back as written, and bad rows are named.

#include "world/movers.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <random>

#include "tests/world/temp_file.h"

namespace world {
namespace {

const std::string kHead = "time,id,node_or_mesh,x,y,z,qx,qy,qz,qw,scale\n";

/// A file that goes with the test.
Result<std::vector<MoverTrack>> readText(std::string_view text) {
    const test::TempFile file("movers.csv");
    file.write(text);
    return readMovers(file.path());
}

MoverSample randomSample(std::mt19937& rng, double time) {
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> place(-1e6, 1e6), scale(1e-3, 10);
    return {time,
            {place(rng), place(rng), place(rng)},
            glm::normalize(glm::dquat(normal(rng), normal(rng), normal(rng), normal(rng))),
            scale(rng)};
}

TEST(Movers, ReadBackWhatTheyWrote) {
    std::mt19937 rng(2);
    std::uniform_real_distribution<double> step(1e-6, 1);
    // In the order of their names, as reading gives them; each awkward in its own way.
    const std::vector<std::string> names{" padded ",         "\"",          "a,b",
                                         "crate \"7\", red", "lib/box.001", "\xc3\xa9t\xc3\xa9"};
    std::vector<MoverTrack> tracks;
    for (const std::string& name : names) {
        MoverTrack track{name, {}};
        double time = 0;
        for (int i = 0; i < 100; ++i) track.samples.push_back(randomSample(rng, time += step(rng)));
        tracks.push_back(track);
    }
    const test::TempFile file("movers.csv");
    ASSERT_TRUE(writeMovers(file.path(), tracks));
    const Result<std::vector<MoverTrack>> read = readMovers(file.path());
    ASSERT_TRUE(read) << read.error().what;
    ASSERT_EQ(read.value().size(), tracks.size());
    for (size_t t = 0; t < tracks.size(); ++t) {
        EXPECT_EQ(read.value()[t].name, tracks[t].name);
        ASSERT_EQ(read.value()[t].samples.size(), tracks[t].samples.size()) << t;
        for (size_t s = 0; s < tracks[t].samples.size(); ++s) {
            EXPECT_EQ(read.value()[t].samples[s].time, tracks[t].samples[s].time);
            EXPECT_EQ(read.value()[t].samples[s].position, tracks[t].samples[s].position);
            EXPECT_EQ(read.value()[t].samples[s].orientation, tracks[t].samples[s].orientation);
            EXPECT_EQ(read.value()[t].samples[s].scale, tracks[t].samples[s].scale);
        }
    }
}

TEST(Movers, TakeWhatOthersWrite) {
    const auto tracks = readText(
        "\xef\xbb\xbf\"time\", id ,node_or_mesh,x,y,z,qx,qy,qz,qw,scale\r\n"
        " 0 , 7 , plain name , 1,2,3, 0,0,0,1, 1 \r\n\r\n"
        "0,8,\"with, comma\" ,+1,2e0,3,0,0,0,1,0.5");
    ASSERT_TRUE(tracks) << tracks.error().what;
    ASSERT_EQ(tracks.value().size(), 2u);
    EXPECT_EQ(tracks.value()[0].name, "plain name");
    EXPECT_EQ(tracks.value()[1].name, "with, comma");
    EXPECT_EQ(tracks.value()[1].samples[0].position, glm::dvec3(1, 2, 3));
    EXPECT_EQ(tracks.value()[1].samples[0].scale, 0.5);
}

TEST(Movers, MayBeNone) {
    const auto tracks = readText(kHead);
    ASSERT_TRUE(tracks) << tracks.error().what;
    EXPECT_TRUE(tracks.value().empty());
}

TEST(Movers, NameTheBadRow) {
    const struct {
        const char* row;
        const char* says;
    } cases[] = {
        {"1,0,a,0,0,0,0,0,0,1", "too few fields"},
        {"1,0,a,0,0,0,0,0,0,1,1,1", "too many fields"},
        {"1,0,a,0,0,0,0,0,0,1,1,", "too many fields"},
        {"1,0,a,0,nan,0,0,0,0,1,1", "y is not a finite number"},
        {"1,0,a,0,0,1e999,0,0,0,1,1", "z is not a finite number"},
        {"inf,0,a,0,0,0,0,0,0,1,1", "time is not a finite number"},
        {"1,0,a,0,0,0,0,0,0,1,1m", "scale is not a finite number"},
        {"1,0,a,,0,0,0,0,0,1,1", "x is not a finite number"},
        {"1,0,a,0,0,0,0,0,0,1,0", "scale must be above zero"},
        {"1,0,a,0,0,0,0,0,0,1,-1", "scale must be above zero"},
        {"1,0,a,0,0,0,0,0,0,0,1", "length is not 1"},
        {"1,0,a,0,0,0,0,0,2,0,1", "length is not 1"},
        {"1,0,,0,0,0,0,0,0,1,1", "node_or_mesh is empty"},
        {"1,0,\"a,0,0,0,0,0,0,1,1", "a quote is not closed"},
        {"1,0,\"a\"b,0,0,0,0,0,0,1,1", "text after a closing quote"},
        {"0,0,a,0,0,0,0,0,0,1,1", "does not ascend for 'a'"},
        {"-1,0,a,0,0,0,0,0,0,1,1", "does not ascend for 'a'"},
    };
    for (const auto& c : cases) {
        const auto tracks = readText(kHead + "0,0,a,0,0,0,0,0,0,1,1\n" + c.row + "\n2,0,a,0,0,0,0,0,0,1,1\n");
        ASSERT_FALSE(tracks) << c.row;
        EXPECT_EQ(tracks.error().code, ErrorCode::kBadData);
        EXPECT_NE(tracks.error().what.find(".csv:3: "), std::string::npos) << tracks.error().what;
        EXPECT_NE(tracks.error().what.find(c.says), std::string::npos) << tracks.error().what;
    }
    for (const char* head : {"", "\n", "time,id,x,y,z\n", "0,0,a,0,0,0,0,0,0,1,1\n"}) {
        const auto tracks = readText(head);
        ASSERT_FALSE(tracks) << head;
        EXPECT_NE(tracks.error().what.find("the first line must be time,id,"), std::string::npos);
    }
    // Other names may be behind in time.
    EXPECT_TRUE(readText(kHead + "5,0,a,0,0,0,0,0,0,1,1\n1,1,b,0,0,0,0,0,0,1,1\n"));
}

TEST(Movers, SurviveTruncationAtEveryLength) {
    const std::string text = kHead + "0,0,\"a \"\"b\"\"\",0,0,0,0,0,0,1,1.5\n0.5,0,c,1,2,3,0,0,1,0,1\n";
    const test::TempFile file("movers.csv");
    for (size_t length = 0; length <= text.size(); ++length) {
        file.write(std::string_view(text).substr(0, length));
        const auto tracks = readMovers(file.path());
        if (!tracks) {
            EXPECT_NE(tracks.error().what.find(".csv:"), std::string::npos) << tracks.error().what;
            continue;
        }
        for (const MoverTrack& track : tracks.value()) {
            EXPECT_FALSE(track.samples.empty()) << length;
            EXPECT_FALSE(track.name.empty()) << length;
        }
    }
}

TEST(Movers, SurviveRandomBytes) {
    std::mt19937 rng(4);
    const std::string text = kHead + "0,0,\"a \"\"b\"\"\",0,0,0,0,0,0,1,1.5\n0.5,0,c,1,2,3,0,0,1,0,1\n";
    using namespace std::string_view_literals;
    constexpr std::string_view alphabet = "\",\n\r \t0179.-+e#\0\xff"sv;
    for (int step = 0; step < 5000; ++step) {
        std::string changed = text;
        for (int i = 0; i < 1 + step % 4; ++i) {
            const size_t at = rng() % changed.size();
            const char c = alphabet[rng() % alphabet.size()];
            if (rng() % 2)
                changed[at] = c;
            else if (rng() % 2)
                changed.insert(at, 1, c);
            else
                changed.erase(at, 1);
        }
        const auto tracks = readText(changed);
        if (!tracks) continue;
        for (const MoverTrack& track : tracks.value())
            for (const MoverSample& sample : track.samples) ASSERT_GT(sample.scale, 0) << changed;
    }
}

TEST(Movers, RefuseToWriteWhatTheyWouldNotRead) {
    const test::TempFile file("movers.csv");
    for (const MoverTrack& track :
         {MoverTrack{"", {MoverSample{}}}, MoverTrack{"two\nlines", {MoverSample{}}},
          MoverTrack{"a", {MoverSample{std::nan("")}}}}) {
        const Result<Done> written = writeMovers(file.path(), {track});
        ASSERT_FALSE(written);
        EXPECT_EQ(written.error().code, ErrorCode::kUsage);
        EXPECT_FALSE(std::filesystem::exists(file.path()));
    }
}

TEST(Movers, HoldTheLastSample) {
    std::mt19937 rng(8);
    MoverTrack track{"a", {}};
    for (int i = 0; i < 50; ++i) track.samples.push_back(randomSample(rng, i * 0.1));
    std::uniform_real_distribution<double> when(-1, 6);
    for (int step = 0; step < 1000; ++step) {
        const double time = step % 2 == 0 ? when(rng) : track.samples[static_cast<size_t>(step) % 50].time;
        const MoverSample* expected = &track.samples[0];
        for (const MoverSample& sample : track.samples)
            if (sample.time <= time) expected = &sample;
        EXPECT_EQ(&sampleAt(track, time), expected) << time;
    }
}

TEST(Movers, ReadTheRecordedWorlds) {
    const std::filesystem::path stk = std::filesystem::path(GNOMON_SOURCE_DIR) / "../shared/data/stk";
    if (!std::filesystem::exists(stk)) GTEST_SKIP() << "no ../shared";
    const struct {
        const char* world;
        size_t movers, rows;
    } worlds[] = {{"candela_city", 57, 102657}, {"cocoa_temple", 2, 3602}};
    for (const auto& w : worlds) {
        const auto start = std::chrono::steady_clock::now();
        const auto tracks = readMovers((stk / w.world / "movers.csv").string());
        const double seconds =
            std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        ASSERT_TRUE(tracks) << tracks.error().what;
        size_t rows = 0;
        for (const MoverTrack& track : tracks.value()) rows += track.samples.size();
        EXPECT_EQ(tracks.value().size(), w.movers);
        EXPECT_EQ(rows, w.rows);
        RecordProperty(std::string(w.world) + "_ms", static_cast<int>(seconds * 1000));
    }
}

}  // namespace
}  // namespace world
