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
    const tools::StressNeed need = c.memoryShare > 0 ? tools::measureNeed(device, hills(), c).value() : tools::StressNeed{};
    return tools::runStress(device, hills(), c, need, 5, [](const tools::ReplayFrame&) { return world::Done{}; }).value();
}

TEST(Stress, EveryCaseKeepsItsPromises) {
    for (const StressCase& c : tools::stressCases(hills(), plan())) {
        const StressResult r = run(c);
        EXPECT_TRUE(r.failures.empty()) << c.name << ": " << r.failures.front();
        EXPECT_GT(r.comparedTexels, 0u) << c.name;
        if (c.name == "ping-pong") {
            EXPECT_EQ(r.summary.bytesAgain, 0u) << "what comes and goes at a border stays";
        }
        if (c.name == "straight-300" || c.name == "slow-disk") {
            EXPECT_GT(r.lackingFrames, 0u) << c.name;
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
    for (const char* kind : {"none", "speed", "path"})
        lacking.push_back(run(named("prefetch-100-" + std::string(kind), tools::prefetchCases(hills(), plan()))).missingTexels);
    EXPECT_LT(lacking[1], lacking[0]);
    EXPECT_LE(lacking[2], lacking[1]);
}

TEST(Stress, SeesAStreamerThatDoesNotSayWhatItLacks) {
    StressCase c = named("slow-disk", tools::stressCases(hills(), plan()));
    c.config.sabotage = cache::Sabotage::kSilentLack;
    const StressResult r = run(c);
    ASSERT_FALSE(r.failures.empty());
    EXPECT_NE(r.failures[0].find("were not known to be"), std::string::npos) << r.failures[0];
}

}  // namespace
