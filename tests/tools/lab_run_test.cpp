// tests/tools/lab_run_test.cpp — methods judged on a small world, whole: truth, maps, answers, measures.
#include "tools/lab/run.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <tbb/global_control.h>

#include <cstdio>
#include <filesystem>

#include "tests/server/worlds.h"
#include "tests/world/random_world.h"

namespace {

using tools::lab::MethodResult;
using world::Pose;

/// Past streets of boxes at 8 m/s, a little downward.
std::vector<Pose> poses(size_t count) {
    std::vector<Pose> path;
    for (size_t k = 0; k < count; ++k)
        path.push_back({double(k) / 10, {-6 + 0.8 * double(k), 4, 20}, glm::angleAxis(-0.3, glm::dvec3(1, 0, 0))});
    return path;
}

/// Judges doughnut and gnomon with so many threads, from nothing.
std::vector<MethodResult> judgedWith(size_t threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    const world::WorldStore store = tests::baked(tests::streets({0, 0, 0}), "lab.world");
    const std::vector<Pose> path = poses(6);
    const std::vector<world::MoverTrack> none;
    const auto light = culling::makeLightSpace(store.header().sun).value();
    auto scene = tools::lab::Scene::load(store, path, 120, light, none);
    EXPECT_TRUE(scene);
    tools::lab::Setting setting{tests::validatedDevice(), store, scene.value(), none, light, 120, glm::radians(60.0)};
    setting.shadingTimed = true;
    tools::lab::RunConfig config;
    config.width = 96;
    config.height = 54;
    config.sunRadius = tools::lab::kSunRadius;
    const auto follow = [](size_t, size_t) {};
    const world_tests::TempFolder folder;
    auto kept = tools::TruthStore::open(folder.file("lab.truth"));
    EXPECT_TRUE(kept);
    const auto truth =
        tools::lab::traceTruth(setting, path, tools::lab::judgedFrames(path.size(), 3), config, kept.value(), follow);
    EXPECT_TRUE(truth);
    std::vector<MethodResult> results;
    for (const char* name : {"doughnut", "gnomon"}) {
        culling::ShadowMethod method = culling::methodNamed(name).value();
        method.side = 256;
        auto result = tools::lab::judgeMethod(setting, path, truth.value(), method, follow);
        EXPECT_TRUE(result) << name;
        if (result) results.push_back(std::move(result.value()));
    }
    tests::expectSilence();
    return results;
}

TEST(Lab, CountersErrorsAndPicturesDoNotDependOnThreads) {
    const auto one = judgedWith(1), two = judgedWith(2);
    ASSERT_EQ(one.size(), 2u);
    ASSERT_EQ(two.size(), 2u);
    for (size_t k = 0; k < 2; ++k) {
        const MethodResult &a = one[k], &b = two[k];
        EXPECT_EQ(a.cost, b.cost) << a.method.name;
        EXPECT_EQ(a.drawn, b.drawn);
        EXPECT_EQ(a.triangles, b.triangles);
        ASSERT_EQ(a.judged.size(), b.judged.size());
        for (size_t f = 0; f < a.judged.size(); ++f) {
            const tools::lab::Measures &m = a.judged[f].measures, &n = b.judged[f].measures;
            EXPECT_EQ(a.judged[f].frame, b.judged[f].frame);
            EXPECT_EQ(m.pixels, n.pixels);
            EXPECT_EQ(m.falseLit.atEdges, n.falseLit.atEdges);
            EXPECT_EQ(m.falseLit.elsewhere, n.falseLit.elsewhere);
            EXPECT_EQ(m.falseShadow.atEdges, n.falseShadow.atEdges);
            EXPECT_EQ(m.falseShadow.elsewhere, n.falseShadow.elsewhere);
            EXPECT_EQ(m.difference, n.difference);
            EXPECT_EQ(m.softDifference, n.softDifference);
            EXPECT_EQ(m.unanswered, n.unanswered);
            EXPECT_EQ(m.points, n.points);
            EXPECT_EQ(m.flips, n.flips);
            EXPECT_EQ(m.usedShare, n.usedShare);
            EXPECT_EQ(m.texelsPerPixel, n.texelsPerPixel);
        }
        EXPECT_EQ(a.worst.frame, b.worst.frame);
        EXPECT_EQ(a.worst.picture.pixels, b.worst.picture.pixels);
    }
}

TEST(Lab, APathThatSeesNothingInTheSunIsRefused) {
    const world::WorldStore store = tests::baked(tests::streets({0, 0, 0}), "sky.world");
    std::vector<Pose> path = poses(3);
    const std::vector<world::MoverTrack> none;
    const auto light = culling::makeLightSpace(store.header().sun).value();
    auto scene = tools::lab::Scene::load(store, path, 120, light, none);
    ASSERT_TRUE(scene);
    const tools::lab::Setting setting{tests::validatedDevice(), store, scene.value(), none, light, 120, glm::radians(60.0)};
    const world_tests::TempFolder folder;
    auto kept = tools::TruthStore::open(folder.file("sky.truth"));
    ASSERT_TRUE(kept);
    tools::lab::RunConfig config;
    config.width = 32;
    config.height = 18;
    const auto traced = [&] {
        return tools::lab::traceTruth(setting, path, tools::lab::judgedFrames(3, 0), config, kept.value(), [](size_t, size_t) {});
    };
    EXPECT_TRUE(traced());
    for (Pose& pose : path) pose = {pose.time, pose.position + glm::dvec3(0, 80, 0), glm::angleAxis(1.4, glm::dvec3(1, 0, 0))};
    const auto sky = traced();
    ASSERT_FALSE(sky);
    EXPECT_EQ(sky.error().code, world::ErrorCode::kUsage);
    EXPECT_NE(sky.error().what.find("faces the sun"), std::string::npos) << sky.error().what;
}

TEST(Lab, CascadesThatServeNothingAreRefusedByNumber) {
    const world::WorldStore store = tests::baked(tests::streets({0, 0, 0}), "room.world");
    const std::vector<Pose> path = poses(2);
    const std::vector<world::MoverTrack> none;
    const auto light = culling::makeLightSpace(store.header().sun).value();
    auto scene = tools::lab::Scene::load(store, path, 120, light, none);
    ASSERT_TRUE(scene);
    tools::lab::Setting setting{tests::validatedDevice(), store, scene.value(), none, light, 120, glm::radians(60.0)};
    const auto told = [&](int cascades, double far) {
        culling::ShadowMethod method = culling::methodNamed("gnomon").value();  // each three times as long as the one before
        method.splits.count = cascades;
        setting.farDistance = far;
        const auto room = tools::lab::requireRoom(setting, method);
        return room ? std::string() : room.error().what;
    };
    const auto has = [](const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; };
    EXPECT_EQ(told(5, 120), "");  // the finest ends at 1.48 m
    EXPECT_TRUE(has(told(6, 120), "serves nothing farther off than 0.5 m; give at most 5")) << told(6, 120);
    EXPECT_TRUE(has(told(4, 1e5), "the coarsest begins 3.33e+04 m off")) << told(4, 1e5);
    EXPECT_TRUE(has(told(4, 1e5), "give at most 1")) << told(4, 1e5);
    EXPECT_EQ(told(1, 1e5), "");
    EXPECT_EQ(told(1, 0.1), "");
}

TEST(JudgedFrames, ArePairsThatDoNotOverlap) {
    for (const size_t poses : {2u, 3u, 7u, 60u, 1000u})
        for (const uint64_t every : {uint64_t(0), uint64_t(1), uint64_t(2), uint64_t(3), uint64_t(50), ~uint64_t(0)}) {
            size_t next = 0;
            for (const size_t frame : tools::lab::judgedFrames(poses, every)) {
                EXPECT_GE(frame, next) << poses << " poses, every " << every;
                next = frame + 2;
                EXPECT_LE(next, poses);
            }
            EXPECT_GT(next, 0u) << poses << " poses, every " << every;
        }
}

TEST(Lab, TheWorstFrameIsTheOneWithMostWrongPixels) {
    for (const MethodResult& result : judgedWith(2)) {
        ASSERT_FALSE(result.judged.empty());
        uint64_t most = 0, sum = 0;
        for (const tools::lab::JudgedFrame& frame : result.judged) {
            most = std::max(most, frame.measures.wrong());
            sum += frame.measures.wrong();
            if (frame.frame == result.worst.frame) {
                EXPECT_EQ(frame.measures.wrong(), result.worst.wrong);
            }
        }
        EXPECT_GT(sum, 0u) << result.method.name << " is never wrong at 256 texels: a judge that is blind";
        EXPECT_EQ(result.worst.wrong, most);
        EXPECT_EQ(result.measures.wrong(), sum);
        EXPECT_EQ(result.worst.picture.width, 96);
        EXPECT_EQ(result.worst.picture.height, 54);
        EXPECT_GT(result.measures.softDifference, 0);  // some pixel lies in a penumbra
        EXPECT_NE(result.measures.softDifference, result.measures.difference);
        EXPECT_EQ(result.drawn.size(), result.frames);
        ASSERT_EQ(result.shadingMs.size(), 2u) << "once for each pair";
        for (const double ms : result.shadingMs) EXPECT_GT(ms, 0);
        // Doughnut draws what is judged, gnomon all frames of the path.
        const std::vector<size_t> judged{1, 2, 4, 5}, all{0, 1, 2, 3, 4, 5};
        EXPECT_EQ(result.drawn, result.method.name == "gnomon" ? all : judged);
    }
}

/// What the program printed of methods, a line each; it is killed after so many of them.
struct Output {
    int status = 0;
    std::vector<std::string> rows;
};
Output lab(const std::string& arguments, size_t killAfter = 1000) {
    const std::string line = "echo $$; exec '" GNOMON_BINARY "' lab " + arguments + " 2>/dev/null";
    FILE* pipe = popen(line.c_str(), "r");
    Output output;
    char text[1024];
    pid_t pid = 0;
    while (fgets(text, sizeof text, pipe)) {
        if (pid == 0) pid = pid_t(std::stol(text));
        const std::string row = text;
        if (row.find('|') == std::string::npos || row.starts_with("method")) continue;
        output.rows.push_back(row);
        if (output.rows.size() == killAfter) kill(pid, SIGKILL);
    }
    output.status = pclose(pipe);
    return output;
}

TEST(Lab, WhatWasKilledGoesOnWithTheMethodsThatAreMissing) {
    const std::string world = tests::temporary("killed.world"), path = tests::temporary("killed.tum");
    tests::baked(tests::streets({0, 0, 0}), "killed.world");
    ASSERT_TRUE(world::writeTum(path, poses(6)));
    const std::string out = tests::temporary("killed.lab");
    const std::string call = world + " --path " + path + " --far 60 --every 3 --out " + out + " --methods ";
    const Output first = lab(call + "doughnut,gnomon,valient", 1);
    ASSERT_TRUE(WIFSIGNALED(first.status) && WTERMSIG(first.status) == SIGKILL);
    EXPECT_FALSE(std::filesystem::exists(out + "/lab.html"));

    const Output second = lab(call + "doughnut,gnomon");
    ASSERT_EQ(second.status, 0);
    ASSERT_EQ(second.rows.size(), 2u);
    EXPECT_EQ(second.rows[0], first.rows[0]) << "times, too: it was not run again";
    const Output third = lab(call + "gnomon");
    ASSERT_EQ(third.rows.size(), 1u);
    EXPECT_EQ(third.rows[0], second.rows[1]);
    const std::string page = world_tests::readFile(out + "/lab.html");
    for (const char* name : {"\"name\":\"doughnut\"", "\"name\":\"gnomon\""})
        EXPECT_NE(page.find(name), std::string::npos) << name << " was run with the same arguments, and is shown";
    // Another setting is another run: nothing of the first is taken for it.
    const Output other = lab(call + "doughnut --fov 50");
    ASSERT_EQ(other.rows.size(), 1u);
    EXPECT_NE(other.rows[0], first.rows[0]);
    EXPECT_EQ(world_tests::readFile(out + "/lab.html").find("\"name\":\"gnomon\""), std::string::npos);
}

TEST(Lab, OcclusionIsFoundOnceAndShownWithTheMethodsOfItsRun) {
    const std::string world = tests::temporary("occlusion-run.world"), path = tests::temporary("occlusion-run.tum");
    tests::baked(tests::streets({0, 0, 0}), "occlusion-run.world");
    ASSERT_TRUE(world::writeTum(path, poses(3)));
    const std::string out = tests::temporary("occlusion-run.lab");
    const std::string call = world + " --path " + path + " --far 60 --out " + out + " --occlusion";
    const Output alone = lab(call);
    ASSERT_EQ(alone.status, 0);
    ASSERT_EQ(alone.rows.size(), 8u) << "a head and seven ways";
    EXPECT_NE(world_tests::readFile(out + "/lab.html").find("\"methods\":[]"), std::string::npos) << "no method was asked for";

    const Output both = lab(call + " --methods doughnut");
    ASSERT_EQ(both.status, 0);
    ASSERT_EQ(both.rows.size(), 9u);
    EXPECT_EQ(std::vector(both.rows.begin(), both.rows.begin() + 8), alone.rows) << "times, too: it was not run again";
    const std::string page = world_tests::readFile(out + "/lab.html");
    for (const char* name : {"\"name\":\"doughnut\"", "\"name\":\"64 rays\"", "\"name\":\"texel-exact\""})
        EXPECT_NE(page.find(name), std::string::npos) << name;
}

}  // namespace
