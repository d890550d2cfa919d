#include "tools/lab/occlusion.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <iterator>
#include <limits>
#include <optional>
#include <utility>

#include "culling/caster_rays.h"
#include "culling/hidden_casters.h"
#include "tools/lab/view_plans.h"
#include "tools/lab/view_target.h"

namespace tools::lab {
namespace {

using culling::CasterRays;
using culling::HiddenCasters;
using culling::MapTexels;
using culling::ShadowView;
using world::CasterId;
using world::Done;
using world::Result;

struct Way {
    const char* name;
    int rays;  ///< a caster; 0: none is left out
};
constexpr std::array<Way, 5> kWays{{{"all drawn", 0}, {"1 ray", 1}, {"4 rays", 4}, {"16 rays", 16}, {"64 rays", 64}}};
/// Casters left out whole, then by cluster as well, as Gnomon does.
constexpr std::array<const char*, 2> kProofs{"texel-exact", "by cluster"};

/// Before what a map's depths begin with [m]: all is drawn.
constexpr double kEverywhere = -std::numeric_limits<double>::infinity();

using Images = std::vector<std::vector<float>>;

/// Holds the maps of a way against those with all casters.
void compare(const Images& all, const Images& some, std::span<const ShadowView> views, OcclusionRecord& record) {
    for (size_t map = 0; map < all.size(); ++map) {
        const double range = views[map].depthRange / (1 - double(cache::kNearestDepth));  // of stored depths [m]
        for (size_t i = 0; i < all[map].size(); ++i) {
            if (all[map][i] == some[map][i]) continue;
            ++record.texelsWrong;
            record.deepest = std::max(record.deepest, range * (double(some[map][i]) - double(all[map][i])));
        }
    }
}

/// A method's maps in the frame at hand, and who is left out of them.
class Study {
public:
    Study(const Setting& setting, const culling::ShadowMethod& method, const world::Pose& first)
        : setting_(setting), method_(method), views_(viewsFor(first)),
          casters_(setting.scene, setting.light, method, views_) {
        for (const Way& way : kWays) records_.push_back({.way = way.name});
        for (const char* name : kProofs) records_.push_back({.way = name});
    }

    Result<Done> start() {
        auto made = ViewTarget::create(setting_.device, method_, int(views_.size()));
        if (!made) return made.error();
        target_.emplace(std::move(made.value()));
        return Done{};
    }

    Result<Done> add(const world::Pose& pose, const culling::TruthFrame& truth, const Asked& asked) {
        setting_.scene.moveTo(pose.time);
        casters_.moved(setting_.scene.movers());
        views_ = viewsFor(pose);
        statics_.clear();
        for (const ShadowView& view : views_) statics_.push_back(casters_.staticsOver(view));
        hidden_.assign(records_.size(), std::vector<std::vector<CasterId>>(views_.size()));
        clusters_.assign(views_.size(), {});
        for (size_t v = 0; v < views_.size(); ++v)
            if (const auto done = search(v); !done) return done;

        Images all;
        const uint64_t texels = views_.size() * uint64_t(method_.side) * uint64_t(method_.side);
        for (size_t w = 0; w < records_.size(); ++w) {
            OcclusionRecord& record = records_[w];
            auto images = draw(w);
            if (!images) return images.error();
            if (w == 0) all = images.value();
            record.texels += texels;
            compare(all, images.value(), views_, record);
            const culling::View camera = viewAt(setting_, pose);
            const std::vector<std::span<const float>> spans(images.value().begin(), images.value().end());
            const auto answers = server::shade(method_, views_, setting_.light, camera, spans, asked.receivers);
            const Measures measures = judge(truth, asked, answers, camera.verticalFov, texels);
            record.pixels += measures.pixels;
            record.falseLit += measures.falseLit.all();
            record.falseShadow += measures.falseShadow.all();
            ++record.judged;
        }
        return Done{};
    }
    std::vector<OcclusionRecord> records() && { return std::move(records_); }

private:
    std::vector<ShadowView> viewsFor(const world::Pose& pose) const {
        return culling::viewsOf(method_, setting_.light, viewAt(setting_, pose), kNearDistance, setting_.farDistance,
                                setting_.scene.bounds());
    }

    /// Asks each way about the casters over a map.
    Result<Done> search(size_t v) {
        const world::CasterTable& table = setting_.scene.casters();
        const culling::LightCasters& light = casters_.light();
        const MapTexels map{int(v), glm::i64vec2(glm::round(views_[v].low / light.cascades()[v].texel)), method_.side};
        auto start = std::chrono::steady_clock::now();
        const auto made = CasterRays::create(table, light, map, statics_[v]);
        if (!made) return made.error();
        const double prepareMs = msSince(start);
        const CasterRays& rays = *made.value();
        const std::vector<CasterId> owners = culling::ownersOf(table, light, map, statics_[v]);
        const auto take = [&](size_t w, const HiddenCasters& found, double ms) {
            OcclusionRecord& record = records_[w];
            record.ms += ms;
            record.rays += found.rays;
            record.hidden += found.casters.size();
            for (const CasterId caster : found.casters)
                record.wronglyHidden += std::binary_search(owners.begin(), owners.end(), caster);
            hidden_[w][v] = found.casters;
        };
        for (OcclusionRecord& record : records_) record.asked += rays.asked().size();
        for (size_t w = 1; w < kWays.size(); ++w) {
            start = std::chrono::steady_clock::now();
            const HiddenCasters found = rays.hidden(kWays[w].rays);
            take(w, found, msSince(start));
            records_[w].prepareMs += prepareMs;
        }
        start = std::chrono::steady_clock::now();
        culling::ProvenHidden proven = culling::provenHidden(table, light, map, rays.asked(), setting_.scene.statics(),
                                                             {uint32_t(method_.rays), views_[v].depthRange, method_.side});
        const double ms = msSince(start);
        for (size_t w = kWays.size(); w < records_.size(); ++w) take(w, proven.whole, ms);
        clusters_[v] = std::move(proven.clusters);
        return Done{};
    }

    /// The maps without what a way hides.
    Result<Images> draw(size_t w) {
        const bool byCluster = w + 1 == records_.size();
        gpu::ViewPlan plan;
        for (size_t v = 0; v < views_.size(); ++v) {
            plan.clears.push_back(views_[v].map);
            std::vector<CasterId> left;
            // Both ascend.
            std::set_difference(statics_[v].begin(), statics_[v].end(), hidden_[w][v].begin(), hidden_[w][v].end(),
                                std::back_inserter(left));
            const std::span<const CasterCluster> clusters = byCluster ? clusters_[v] : std::span<const CasterCluster>();
            left.insert(left.end(), setting_.scene.movers().begin(), setting_.scene.movers().end());
            records_[w].triangles += casters_.draw(left, int(v), views_[v], *target_, plan, kEverywhere, clusters).triangles;
        }
        if (const auto drawn = target_->draw(plan); !drawn) return drawn.error();
        return target_->images(int(views_.size()));
    }

    const Setting& setting_;
    culling::ShadowMethod method_;
    std::vector<ShadowView> views_;
    ViewCasters casters_;
    std::optional<ViewTarget> target_;
    std::vector<OcclusionRecord> records_;
    std::vector<std::vector<CasterId>> statics_;              ///< [view], ascending
    std::vector<std::vector<std::vector<CasterId>>> hidden_;  ///< [way][view], likewise
    std::vector<std::vector<CasterCluster>> clusters_;        ///< [view], proven hidden, likewise
};

}  // namespace

Result<std::vector<OcclusionRecord>> studyOcclusion(const Setting& setting, std::span<const world::Pose> poses,
                                                    std::span<const TruthPair> truth,
                                                    const culling::ShadowMethod& method,
                                                    const std::function<void(size_t, size_t)>& onFrame) {
    if (const auto good = culling::requireMethod(method); !good) return good.error();
    CHECK(!truth.empty() && method.fit == culling::Fit::kEyeBox && method.snapped);
    Study study(setting, method, poses.front());
    if (const auto started = study.start(); !started) return started.error();
    size_t done = 0;
    for (const TruthPair& pair : truth) {
        if (const auto added = study.add(poses[pair.frame], pair.first, pair.askedFirst); !added) return added.error();
        onFrame(++done, 2 * truth.size());
        if (const auto added = study.add(poses[pair.frame + 1], pair.second, pair.askedSecond); !added) return added.error();
        onFrame(++done, 2 * truth.size());
    }
    return std::move(study).records();
}

std::string occlusionTable(std::span<const OcclusionRecord> records) {
    char line[512];
    std::snprintf(line, sizeof line, "%-12s %9s %9s %9s | %10s %9s | %9s %9s | %10s %10s | %9s %9s\n", "hidden by",
                  "asked", "hidden", "wrongly", "texels off", "by m", "lit %", "added %", "triangles", "rays", "prepare", "ms");
    std::string table = line;
    for (const OcclusionRecord& r : records) {
        const double added = r.percent(r.falseLit) - records.front().percent(records.front().falseLit);
        std::snprintf(line, sizeof line,
                      "%-12s %9.1f %9.1f %9.2f | %10.1f %9.2f | %9.4f %9.4f | %10.0f %10.0f | %9.1f %9.2f\n", r.way.c_str(),
                      r.aFrame(r.asked), r.aFrame(r.hidden), r.aFrame(r.wronglyHidden), r.aFrame(r.texelsWrong), r.deepest,
                      r.percent(r.falseLit), added, r.aFrame(r.triangles), r.aFrame(r.rays), r.aFrame(r.prepareMs),
                      r.aFrame(r.ms));
        table += line;
    }
    return table;
}

}  // namespace tools::lab
