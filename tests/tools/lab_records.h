// tests/tools/lab_records.h — made-up results of the lab.
#pragma once

#include <random>
#include <string>
#include <vector>

#include "tools/lab/occlusion.h"
#include "tools/lab/record.h"

namespace tests {

inline tools::lab::RunRecord someRun(uint64_t key = 7) {
    tools::lab::RunRecord run;
    run.key = key;
    run.world = "town.world";
    run.path = "drive.tum";
    run.frames = 60;
    run.judged = 4;
    run.begins = 0.5;
    run.ends = 2.5;
    run.farDistance = 600;
    run.verticalFov = 1;
    run.sun = {0.6, -0.8, 0};
    run.width = 320;
    run.height = 180;
    run.device = "a device";
    run.driver = "a driver";
    run.threads = 2;
    return run;
}

/// Every figure of its own, so that none can be taken for another.
inline tools::lab::MethodRecord someMethod(const std::string& name, uint32_t seed) {
    std::mt19937_64 rng(seed);
    const auto count = [&rng] { return rng() % 1'000'000'000'000; };  // beyond 32 bits
    const auto real = [&rng] { return double(rng()) / 1e7; };
    tools::lab::MethodRecord r;
    r.name = name;
    r.fields = culling::settingsOf(culling::ShadowMethod{.name = name});
    for (uint64_t* value : {&r.cost.texels, &r.cost.casters, &r.cost.triangles, &r.cost.draws, &r.pixels, &r.falseLit.atEdges,
                            &r.falseLit.elsewhere, &r.falseShadow.atEdges, &r.falseShadow.elsewhere, &r.unanswered, &r.points,
                            &r.flips, &r.worstWrong})
        *value = count();
    for (double* value : {&r.ms, &r.shadingMs, &r.difference, &r.softDifference, &r.ratio50, &r.ratio99, &r.usedShare}) *value = real();
    r.frames = 60;
    r.judged = 4;
    r.worstFrame = 31;
    for (int k = 0; k < 300; ++k) r.picture.push_back(std::byte(rng()));
    for (size_t frame = 0; frame < 60; ++frame) {
        r.series.push_back({frame, count(), real(), std::nullopt});
        if (frame % 30 < 2) r.series.back().judged = {count(), count(), count(), count(), count()};
    }
    return r;
}

/// Likewise.
inline std::vector<tools::lab::OcclusionRecord> someOcclusion(uint32_t seed) {
    std::mt19937_64 rng(seed);
    std::vector<tools::lab::OcclusionRecord> records(7);
    for (auto& r : records) {
        r.way = "way " + std::to_string(&r - records.data());
        r.judged = 4;
        for (uint64_t* value : {&r.asked, &r.hidden, &r.wronglyHidden, &r.rays, &r.triangles, &r.texels, &r.texelsWrong, &r.pixels,
                                &r.falseLit, &r.falseShadow})
            *value = rng() % 1'000'000'000'000;
        for (double* value : {&r.deepest, &r.prepareMs, &r.ms}) *value = double(rng()) / 1e7;
    }
    return records;
}

inline std::vector<tools::lab::ClaimRecord> someClaims(uint32_t seed) {
    std::mt19937_64 rng(seed);
    const auto text = [&rng] { return std::to_string(rng()) + "' </script>"; };
    std::vector<tools::lab::ClaimRecord> records(5);
    for (auto& r : records) {
        for (std::string* value : {&r.situation, &r.what, &r.method, &r.measure, &r.why, &r.verdict}) *value = text();
        for (double* value : {&r.value, &r.limit}) *value = double(rng()) / 1e7;
        r.fails = rng() % 2 == 0;
        r.wrong = !r.fails;
    }
    return records;
}

}  // namespace tests
