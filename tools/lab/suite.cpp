#include "tools/lab/suite.h"

#include <cstdio>
#include <map>
#include <utility>

#include "culling/method_settings.h"

namespace tools::lab {
namespace {

using world::Error;
using world::Result;

/// Where what was removed is, as far as rays and maps go: beyond all of them [m].
constexpr double kGone = 1e5;

const char* textOf(cache::Sabotage sabotage) {
    switch (sabotage) {
        case cache::Sabotage::kNone:
            return "";
        case cache::Sabotage::kLiteralScroll:
            return ", S - S' only";
        case cache::Sabotage::kDeafDeparture:
            return ", deaf to departures";
        case cache::Sabotage::kStickyCertificate:
            return ", keeps certificates";
        case cache::Sabotage::kForgottenDebt:
            return ", forgets debts";
        case cache::Sabotage::kUnknownAsEmpty:
            return ", unknown is empty";
        case cache::Sabotage::kMixedSuns:
            return ", mixes suns";
        case cache::Sabotage::kSleptMotion:
            return ", sleeps over motion";
        case cache::Sabotage::kSilentLack:
            return ", silent on lacks";
        case cache::Sabotage::kKeptDepths:
            return ", keeps depths";
        case cache::Sabotage::kDeafArrival:
            return ", deaf to arrivals";
        case cache::Sabotage::kSilentLevel:
            return ", silent on levels";
        case cache::Sabotage::kUnrestored:
            return ", restores nothing";
        case cache::Sabotage::kLostMaps:
            return ", loses maps";
    }
    return "";
}

const char* textOf(Defect defect) {
    switch (defect) {
        case Defect::kNone:
            return "";
        case Defect::kFromOrigin:
            return ", floats from the origin";
        case Defect::kSeenCasters:
            return ", only casters in view";
    }
    return "";
}

/// Those of the movers, and of what leaves.
std::vector<world::MoverTrack> tracksOf(const SuiteCase& c) {
    std::vector<world::MoverTrack> tracks = c.movers;
    for (const Removal& removal : c.removals) {
        const world::MoverSample rest = c.stage.restOf(removal.name, c.poses.front().time);
        world::MoverSample gone = rest;
        gone.time = removal.time;
        gone.position.y -= kGone;
        tracks.push_back({removal.name, {rest, gone}});
    }
    return tracks;
}

/// The runs of a case.
class Contest {
public:
    Contest(const SuiteCase& c, const Setting& setting, const std::vector<TruthPair>& truth)
        : case_(c), setting_(setting), truth_(truth) {}

    Result<const Measures*> of(const Contestant& contestant) {
        const auto [at, fresh] = runs_.try_emplace(nameOf(contestant));
        if (!fresh) return &at->second;
        const auto method = culling::methodFrom(contestant.method);
        if (!method) return method.error();
        Setting setting = setting_;
        setting.cache.sabotage = contestant.sabotage;
        setting.defect = contestant.defect;
        auto judged = judgeMethod(setting, case_.poses, truth_, method.value(), [](size_t, size_t) {});
        if (!judged) return judged.error();
        at->second = std::move(judged.value().measures);
        return &at->second;
    }

private:
    const SuiteCase& case_;
    const Setting& setting_;
    const std::vector<TruthPair>& truth_;
    std::map<std::string, Measures> runs_;
};

Result<ClaimResult> held(const Claim& claim, Contest& contest) {
    ClaimResult result{claim};
    result.threshold = claim.limit;
    const auto run = contest.of(claim.who);
    if (!run) return run.error();
    result.value = claim.measure.of(*run.value());
    if (claim.than) {
        const auto other = contest.of(*claim.than);
        if (!other) return other.error();
        result.threshold *= claim.measure.of(*other.value());
    }
    if (claim.kind == Claim::Kind::kFails)
        result.verdict = result.value > 0 && result.value >= result.threshold ? Verdict::kFailsAsItMust : Verdict::kFailsToFail;
    else
        result.verdict = result.value <= result.threshold ? Verdict::kHolds : Verdict::kDoesNotHold;
    return result;
}

Result<std::vector<ClaimResult>> played(gpu::Device& device, const SuiteCase& c) {
    const auto made = StageWorld::bake(c.stage);
    if (!made) return made.error();
    const auto light = culling::makeLightSpace(c.sun);
    if (!light) return light.error();
    // Twice the far distance: a sun that moves sees chunks elsewhere.
    auto scene = Scene::load(made.value().store(), c.poses, 2 * c.farDistance, light.value(), tracksOf(c));
    if (!scene) return scene.error();
    Setting setting{device, made.value().store(), scene.value(), c.movers, light.value(), c.farDistance, c.verticalFov};
    setting.sunAt = c.sunAt;
    setting.fovAt = c.fovAt;
    setting.removals = c.removals;
    setting.cache = c.cache;
    RunConfig config;
    config.width = kSuiteWidth;
    config.height = kSuiteHeight;
    auto kept = TruthStore::open(made.value().store().path() + ".truth");
    if (!kept) return kept.error();
    const auto truth = traceTruth(setting, c.poses, c.judged, config, kept.value(), [](size_t, size_t) {});
    if (!truth) return truth.error();
    Contest contest(c, setting, truth.value());
    std::vector<ClaimResult> results;
    for (const Claim& claim : c.claims) {
        auto result = held(claim, contest);
        if (!result) return result.error();
        results.push_back(std::move(result.value()));
    }
    return results;
}

}  // namespace

std::string nameOf(const Contestant& contestant) {
    return contestant.method + textOf(contestant.sabotage) + textOf(contestant.defect);
}

const char* toString(Verdict verdict) {
    switch (verdict) {
        case Verdict::kFailsAsItMust:
            return "fails, as it must";
        case Verdict::kHolds:
            return "holds";
        case Verdict::kFailsToFail:
            return "FAILS TO FAIL";
        case Verdict::kDoesNotHold:
            return "DOES NOT HOLD";
    }
    return "";
}

Result<std::vector<ClaimResult>> runCase(gpu::Device& device, const SuiteCase& c) {
    auto results = played(device, c);
    if (!results) return Error{results.error().code, "case " + c.name + ": " + results.error().what, results.error().native};
    return results;
}

std::vector<ClaimRecord> recordsOf(const SuiteCase& c, const std::vector<ClaimResult>& results) {
    std::vector<ClaimRecord> records;
    for (const ClaimResult& r : results)
        records.push_back({c.name, c.what, nameOf(r.claim.who), r.claim.measure.name, r.claim.why, toString(r.verdict), r.value,
                           r.threshold, r.claim.kind == Claim::Kind::kFails, wrong(r.verdict)});
    return records;
}

std::string suiteHead() {
    char line[256];
    std::snprintf(line, sizeof line, "%-62s %-24s %10s    %10s  %s\n", "case, method", "measure", "value", "limit", "verdict");
    return line;
}

std::string suiteRows(const SuiteCase& c, const std::vector<ClaimResult>& results) {
    std::string text = c.name + ": " + c.what + "\n";
    for (const ClaimResult& r : results) {
        char line[512];
        std::snprintf(line, sizeof line, "  %-60s %-24s %10.4g %s %10.4g  %s\n", nameOf(r.claim.who).c_str(),
                      r.claim.measure.name.c_str(), r.value, r.claim.kind == Claim::Kind::kFails ? ">=" : "<=", r.threshold,
                      toString(r.verdict));
        text += line;
        if (wrong(r.verdict)) text += "    expected since " + r.claim.why + "\n";
    }
    return text;
}

}  // namespace tools::lab
