#include "tools/lab/judge_all.h"

#include <iostream>
#include <optional>
#include <utility>
#include <vector>

#include "tools/lab/results.h"
#include "tools/lab/session.h"
#include "tools/lab/suite.h"

namespace tools::lab {
namespace {

/// Of the judged frames, with what the folder has of it.
world::Result<std::vector<TruthPair>> truthOf(const Setting& setting, std::span<const world::Pose> poses,
                                              std::span<const size_t> judged, const RunConfig& config,
                                              const std::string& folder, const Follow& onPair) {
    auto truths = openTruths(folder);
    if (!truths) return truths.error();
    auto traced = traceTruth(setting, poses, judged, config, truths.value(), onPair);
    for (const std::string& line : truths.value().damage()) std::cerr << line << '\n';
    return traced;
}

}  // namespace

world::Result<std::string> judgeAll(const Setting& setting, const RunFiles& files, std::span<const world::Pose> poses,
                                    const RunConfig& config, const std::string& folder,
                                    const std::function<void(const MethodRecord&)>& onMethod,
                                    const std::function<Follow(const std::string&)>& follow) {
    for (const culling::ShadowMethod& method : config.methods)
        if (const auto room = requireRoom(setting, method); !room) return room.error();
    const auto judged = judgedFrames(poses.size(), config.every);
    const auto run = describe(setting, files, poses, judged, config);
    if (!run) return run.error();
    auto results = Results::open(folder);
    if (!results) return results.error();
    std::optional<std::vector<TruthPair>> truth;  // traced when a method first needs it
    for (const culling::ShadowMethod& method : config.methods) {
        const uint64_t key = methodKey(run.value(), method);
        const auto kept = results.value().find(key);
        if (!kept) return kept.error();
        if (kept.value()) {
            onMethod(*kept.value());
            continue;
        }
        if (!truth) {
            auto traced = truthOf(setting, poses, judged, config, folder, follow("truth"));
            if (!traced) return traced.error();
            truth = std::move(traced.value());
        }
        const auto result = judgeMethod(setting, poses, *truth, method, follow(method.name));
        if (!result) return result.error();
        const auto record = recordOf(result.value());
        if (!record) return record.error();
        if (const auto saved = results.value().save(run.value(), key, record.value()); !saved) return saved.error();
        onMethod(record.value());
    }
    return results.value().writePage(run.value());
}

world::Result<std::vector<OcclusionRecord>> judgeOcclusion(const Setting& setting, const RunFiles& files,
                                                           std::span<const world::Pose> poses, const RunConfig& config,
                                                           const std::string& folder,
                                                           const std::function<Follow(const std::string&)>& follow) {
    const auto judged = judgedFrames(poses.size(), config.every);
    const auto run = describe(setting, files, poses, judged, config);
    if (!run) return run.error();
    auto results = Results::open(folder);
    if (!results) return results.error();
    auto kept = results.value().occlusionOf(run.value());
    if (!kept || !kept.value().empty()) return kept;
    const auto truth = truthOf(setting, poses, judged, config, folder, follow("truth"));
    if (!truth) return truth.error();
    auto records = studyOcclusion(setting, poses, truth.value(), culling::methodNamed("gnomon").value(), follow("occlusion"));
    if (!records) return records;
    if (const auto saved = results.value().saveOcclusion(run.value(), records.value()); !saved) return saved.error();
    return records;
}

world::Result<std::vector<ClaimRecord>> judgeSuite(const Setting& setting, const RunFiles& files,
                                                   std::span<const world::Pose> poses, const RunConfig& config,
                                                   const std::string& folder,
                                                   const std::function<Follow(const std::string&)>& follow) {
    const auto run = describe(setting, files, poses, judgedFrames(poses.size(), config.every), config);
    if (!run) return run.error();
    auto results = Results::open(folder);
    if (!results) return results.error();
    auto kept = results.value().claimsOf(run.value());
    if (!kept || !kept.value().empty()) return kept;
    std::vector<ClaimRecord> records;
    const std::vector<SuiteCase> cases = suiteCases();
    const Follow onCase = follow("suite");
    for (const SuiteCase& c : cases) {
        const auto played = runCase(setting.device, c);
        if (!played) return played.error();
        for (ClaimRecord& record : recordsOf(c, played.value())) records.push_back(std::move(record));
        onCase(size_t(&c - cases.data()) + 1, cases.size());
    }
    if (const auto saved = results.value().saveClaims(run.value(), records); !saved) return saved.error();
    return records;
}

}  // namespace tools::lab
