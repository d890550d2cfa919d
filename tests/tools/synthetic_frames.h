// tests/tools/synthetic_frames.h — made-up frames of a replay whose counts add up, from a seed.
#pragma once

#include <random>

#include "tools/replay.h"

namespace tools_test {

inline cache::Cost randomCost(std::mt19937& rng) {
    std::uniform_int_distribution<uint64_t> count(0, 100000);
    return rng() % 3 == 0 ? cache::Cost{} : cache::Cost{count(rng), count(rng), count(rng), count(rng)};
}

inline cache::CascadeStatistics randomCascade(std::mt19937& rng) {
    std::uniform_int_distribution<int64_t> texel(-4'000'000'000, 4'000'000'000);
    cache::CascadeStatistics statistics;
    statistics.window = {texel(rng), texel(rng)};
    statistics.move = {texel(rng) % 100, texel(rng) % 100};
    for (cache::Cost& cost : statistics.byCause) {
        cost = randomCost(rng);
        statistics.total += cost;
    }
    statistics.active = randomCost(rng);
    statistics.clustersFound = rng() % 10000;
    statistics.clustersHidden = statistics.clustersFound / 3;
    statistics.trianglesHidden = rng() % 10000;
    statistics.asleep = rng() % 5 == 0;
    statistics.unknownTexels = rng() % 1000;
    statistics.staleTexels = rng() % 1000;
    statistics.oldestDebt = rng() % 50;
    statistics.missingTexels = rng() % 1000;
    statistics.coarseTexels = rng() % 1000;
    return statistics;
}

/// Times come from `noise`, everything else from `rng`: two calls with equal `rng` and different
/// `noise` are two runs of one replay.
inline tools::ReplayFrame randomFrame(std::mt19937& rng, std::mt19937& noise, uint64_t number, int cascades) {
    std::uniform_real_distribution<double> ms(0, 50);
    tools::ReplayFrame frame;
    frame.number = number;
    frame.report.frame = number;
    frame.report.time = static_cast<double>(number) / 30;
    frame.report.submitted = rng() % 4 != 0;
    frame.report.chunkArrivals = rng() % 5;
    frame.report.chunkDepartures = rng() % 5;
    frame.report.refinements = rng() % 5;
    frame.report.missingChunks = rng() % 3;
    frame.report.coarseChunks = rng() % 3;
    frame.report.longestLack = static_cast<double>(rng() % 100) / 8;
    const auto moment = [](double at) {
        const std::chrono::duration<double, std::milli> since(at);
        return std::chrono::steady_clock::time_point(std::chrono::duration_cast<std::chrono::steady_clock::duration>(since));
    };
    frame.report.begin = moment(100.0 * static_cast<double>(number));
    for (uint32_t k = rng() % 3; k > 0; --k) {
        const double begin = 100.0 * static_cast<double>(number) + ms(noise);
        const std::optional<uint32_t> mesh = rng() % 2 == 0 ? std::optional<uint32_t>(k) : std::nullopt;
        frame.report.reads.push_back({mesh, {static_cast<int>(k), 0, 2}, rng(), {static_cast<int>(noise() % 3), moment(begin), moment(begin + ms(noise))}});
    }
    frame.report.bytesRead = rng();
    frame.report.bytesAgain = rng();
    frame.report.residentBytes = rng();
    frame.report.geometryBytes = rng();
    frame.report.bytesUploaded = rng();
    frame.report.rays = rng();
    frame.report.certificates = rng() % 100;
    frame.report.revocations = rng() % 10;
    frame.report.planHash = rng();
    const bool verified = rng() % 2 == 0;
    if (verified) frame.verify.emplace();
    for (int c = 0; c < cascades; ++c) {
        frame.report.cascades.push_back(randomCascade(rng));
        frame.redraw.push_back(randomCost(rng));
        if (frame.report.submitted) frame.report.gpu.cascades.push_back({ms(noise), ms(noise)});
        if (!verified) continue;
        frame.hashes.push_back({rng(), rng()});
        frame.verify->redraw.cascades.push_back({ms(noise), ms(noise)});
        frame.verify->texels += 1024;
    }
    frame.report.cpu = {ms(noise), ms(noise), ms(noise), ms(noise), ms(noise)};
    frame.report.gpu.recordMs = ms(noise);
    frame.report.gpu.wallMs = ms(noise);
    frame.advanceMs = ms(noise);
    return frame;
}

}  // namespace tools_test
