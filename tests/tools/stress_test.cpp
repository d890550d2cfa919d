// tests/tools/stress_test.cpp — the streamer under stress: verdicts that hold, and a twin that earns another.
#include "tools/stress.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>

#include "tests/server/worlds.h"
#include "world/bake.h"
#include "world/procedural.h"

namespace {

using tools::StressCase;
using tools::StressResult;

/// A small built-in world with terrain in levels.
const world::WorldStore& hills() {
    static const world::WorldStore store = [] {
        world::ProceduralOptions options;
        options.size = 1536;
        options.chunkSize = 64;
        options.voxel = 4;
        options.instances = 400;
        return tests::baked(world::openProcedural(7, options).value(), "hills.world");
    }();
    return store;
}

tools::StressPlan plan() {
    tools::StressPlan plan;
    plan.seconds = 4;
    plan.config.streaming.clock = world::Clock::kVirtual;
    plan.config.cascades = 3;
    plan.config.side = 256;
    plan.config.farDistance = 200;
    return plan;
}

StressCase named(const std::string& name, std::vector<StressCase> cases) {
    const auto at = std::find_if(cases.begin(), cases.end(), [&](const StressCase& c) { return c.name == name; });
    CHECK(at != cases.end());
    return *at;
}

StressResult run(const StressCase& c) {
    gpu::Device& device = tests::validatedDevice();
    const tools::StressNeed need = c.needs() ? tools::measureNeed(device, hills(), c).value() : tools::StressNeed{};
    const auto result = tools::runStress(device, hills(), c, need, 5, [](const tools::ReplayFrame&) { return world::Done{}; });
    if (!result) throw std::runtime_error(result.error().what);
    return result.value();
}

/// Chunks of this world are small: a disk that is slow for them.
StressCase slower(StressCase c) {
    c.config.streaming.disk.latency = 0.4;
    c.config.streaming.disk.bandwidth = 1e5;
    return c;
}

TEST(Stress, EveryCaseKeepsItsPromises) {
    for (StressCase& c : tools::stressCases(hills(), plan())) {
        if (c.name == "slow-disk") c = slower(c);
        if (c.losesChunks) c.config.streaming.disk.corruptShare = 0.3;
        const StressResult r = run(c);
        EXPECT_TRUE(r.failures.empty()) << c.name << ": " << r.failures.front();
        EXPECT_GT(r.comparedTexels, 0u) << c.name;
        if (c.name == "ping-pong") {
            EXPECT_EQ(r.summary.bytesAgain, 0u) << "what comes and goes at a border stays";
        }
        if (c.name == "slow-disk" || c.name == "teleports") {
            EXPECT_GT(r.lackingFrames, 0u) << c.name;
            EXPECT_GT(r.holes, 0u) << c.name;
        }
        if (c.name == "memory-eighth" || c.name == "failing-disk") {
            EXPECT_GT(r.holes + r.restingHoles, 0u) << c.name;
        }
        if (c.name == "edits") {
            EXPECT_GT(r.edits, 4u);
        }
        if (c.losesChunks) {
            EXPECT_GT(r.summary.errors, 0u) << c.name;
        }
    }
    tests::expectSilence();
}

TEST(Stress, TheCaseOfAllHasThemAll) {
    const std::vector<StressCase> cases = tools::stressCases(hills(), plan());
    const StressCase all = named("all", cases);
    EXPECT_EQ(all.config.sun, named("low-sun", cases).config.sun);
    EXPECT_EQ(all.config.streaming.disk.latency, named("slow-disk", cases).config.streaming.disk.latency);
    EXPECT_EQ(all.config.streaming.disk.bandwidth, named("slow-disk", cases).config.streaming.disk.bandwidth);
    EXPECT_EQ(all.memoryShare, named("memory-half", cases).memoryShare);
}

TEST(Stress, SameSeedSameNumbersForAnyNumberOfThreads) {
    std::vector<std::string> texts;
    for (const size_t threads : {1, 2, 5}) {
        const tbb::global_control control(tbb::global_control::max_allowed_parallelism, threads);
        std::vector<StressResult> results{run(named("stalling-disk", tools::stressCases(hills(), plan())))};
        results[0].frameMs.clear();
        texts.push_back(tools::stressJson(results, "hills.world", 1));
    }
    EXPECT_EQ(texts[0], texts[1]);
    EXPECT_EQ(texts[0], texts[2]);
}

TEST(Stress, LookingAheadLeavesFewerHoles) {
    std::vector<uint64_t> lacking;
    for (const char* kind : {"none", "speed", "path"}) {
        StressCase c = named("prefetch-100-" + std::string(kind), tools::prefetchCases(hills(), plan()));
        c.config.streaming.disk.latency = 0.4;
        c.config.streaming.disk.channels = 32;
        lacking.push_back(run(c).missingTexels);
    }
    EXPECT_LT(lacking[1], lacking[0]);
    EXPECT_LT(lacking[2], lacking[0]);
}

TEST(Stress, SeesAStreamerThatDoesNotSayWhatItLacks) {
    StressCase c = slower(named("slow-disk", tools::stressCases(hills(), plan())));
    c.config.sabotage = cache::Sabotage::kSilentLack;
    const StressResult r = run(c);
    ASSERT_FALSE(r.failures.empty());
    EXPECT_NE(r.failures[0].find("were not known to be"), std::string::npos) << r.failures[0];
}

}  // namespace
