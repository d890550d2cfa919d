#include "tools/lab/scroll_engine.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "cache/scroll.h"
#include "tools/lab/view_plans.h"
#include "tools/lab/view_target.h"

namespace tools::lab {
namespace {

using culling::ShadowMethod;
using culling::ShadowView;
using world::CasterId;
using world::Done;
using world::Result;

double farEnd(const ShadowView& view) { return view.origin.z + view.depthRange; }

/// Maps 0 to n - 1 are the working ones, those after them hold the static casters.
class ScrollEngine : public Engine {
public:
    ScrollEngine(const Setting& setting, const ShadowMethod& method, const world::Pose& first)
        : setting_(setting), method_(method) {
        lightFor(first);
    }

    Result<Done> start() {
        auto made = ViewTarget::create(setting_.device, method_, 2 * int(views_.size()));
        if (!made) return made.error();
        target_.emplace(std::move(made.value()));
        return Done{};
    }

    Result<FrameCost> advance(const world::Pose& pose) override {
        setting_.scene.moveTo(pose.time);
        if (setting_.sunAt && lightAt(setting_, pose.time).sun != light_.sun) lightFor(pose);
        casters_->moved(setting_.scene.movers());
        const auto start = std::chrono::steady_clock::now();
        const std::vector<ShadowView> before = std::exchange(views_, viewsFor(pose));
        FrameCost frame;
        gpu::ViewPlan kept, working;
        for (size_t v = 0; v < views_.size(); ++v) {
            const auto step = drawn_ ? stepBetween(before[v], views_[v], method_.side) : std::nullopt;
            frame.cost += step ? scroll(v, *step, before[v], kept) : redraw(v, kept);
            frame.cost += addMovers(v, working);
        }
        for (const gpu::ViewPlan* plan : {&kept, &working})
            if (const auto drawn = target_->draw(*plan); !drawn) return drawn.error();
        frame.ms = msSince(start);
        drawn_ = true;
        return frame;
    }
    bool remembers() const override { return true; }
    std::span<const ShadowView> views() const override { return views_; }
    Result<std::vector<std::vector<float>>> images() override { return target_->images(int(views_.size())); }
    const culling::LightSpace& light() const override { return light_; }

private:
    /// Fits all casters to the light of a pose; the maps are drawn anew.
    void lightFor(const world::Pose& pose) {
        light_ = lightAt(setting_, pose.time);
        views_ = viewsFor(pose);
        casters_.emplace(setting_.scene, light_, method_, views_);
        held_.assign(views_.size(), {});
        drawn_ = false;
    }
    std::vector<ShadowView> viewsFor(const world::Pose& pose) const {
        return culling::viewsOf(method_, light_, viewAt(setting_, pose), kNearDistance, setting_.farDistance,
                                setting_.scene.bounds());
    }
    uint64_t mapArea() const { return uint64_t(method_.side) * uint64_t(method_.side); }
    /// A view, as it is drawn to its map of static casters.
    ShadowView keptView(size_t v) const {
        ShadowView view = views_[v];
        view.map += int(views_.size());
        return view;
    }
    /// Static casters that meet the view's rectangle and do not lie behind its far end, ascending.
    std::vector<CasterId> reached(const ShadowView& view) const {
        std::vector<CasterId> casters = casters_->staticsOver(view);
        std::erase_if(casters, [&](CasterId id) { return (*casters_)[id].bounds.min.z > farEnd(view); });
        return casters;
    }

    cache::Cost redraw(size_t v, gpu::ViewPlan& plan) {
        const ShadowView view = keptView(v);
        plan.clears.push_back(view.map);
        held_[v] = reached(view);
        cache::Cost cost = casters_->draw(held_[v], int(v), view, *target_, plan);
        cost.texels += mapArea();
        return cost;
    }

    cache::Cost scroll(size_t v, const ViewStep& step, const ShadowView& before, gpu::ViewPlan& plan) {
        const ShadowView view = keptView(v);
        cache::Cost cost;
        if (step.texels != glm::ivec2(0) || step.units != 0) {
            plan.moves.push_back({.from = view.map, .to = view.map, .by = -step.texels, .units = -step.units});
            cost.texels += mapArea();
        }
        if (method_.mendedScroll) {
            cost += drawExposed(v, view, step, before, plan);
            return cost;
        }
        std::vector<CasterId> casters = reached(view), fresh;
        std::set_difference(casters.begin(), casters.end(), held_[v].begin(), held_[v].end(),
                            std::back_inserter(fresh));
        cost += casters_->draw(fresh, int(v), view, *target_, plan);
        held_[v] = std::move(casters);
        return cost;
    }

    cache::Cost drawExposed(size_t v, const ShadowView& view, const ViewStep& step, const ShadowView& before,
                            gpu::ViewPlan& plan) {
        cache::Cost cost;
        for (const cache::TexelRect& slab : cache::exposedSlabs({0, 0}, cache::Texel(step.texels), method_.side)) {
            const cache::StoreRect rect{glm::ivec2(slab.min) - step.texels, glm::ivec2(slab.max) - step.texels};
            ShadowView strip = view;
            strip.low = view.low + glm::dvec2(rect.min) * view.texel;
            strip.high = view.low + glm::dvec2(rect.max) * view.texel;
            cost += casters_->draw(reached(strip), int(v), strip, *target_, plan);
            plan.passes.back().scissor = rect;
        }
        // What lay in the last unit before the old end was rounded away with what lay behind it.
        if (step.units > 0)
            cost += casters_->draw(reached(view), int(v), view, *target_, plan,
                                  farEnd(before) - before.depthRange / culling::kDepthUnits);
        return cost;
    }

    cache::Cost addMovers(size_t v, gpu::ViewPlan& plan) {
        plan.moves.push_back({.from = keptView(v).map, .to = views_[v].map});
        cache::Cost cost;
        cost.texels += mapArea();
        if (!views_[v].statics) cost += casters_->draw(setting_.scene.movers(), int(v), views_[v], *target_, plan);
        return cost;
    }

    const Setting& setting_;
    ShadowMethod method_;
    culling::LightSpace light_;
    std::vector<ShadowView> views_;
    std::optional<ViewCasters> casters_;
    std::vector<std::vector<CasterId>> held_;  ///< by view: static casters that met its volume, ascending
    std::optional<ViewTarget> target_;
    bool drawn_ = false;  ///< the maps hold the last frame's views
};

}  // namespace

std::optional<ViewStep> stepBetween(const ShadowView& before, const ShadowView& after, int side) {
    if (before.texel != after.texel || before.depthRange != after.depthRange) return std::nullopt;
    const glm::dvec3 step = glm::dvec3((after.low - before.low) / after.texel,
                                       (after.origin.z - before.origin.z) / (after.depthRange / culling::kDepthUnits));
    const glm::dvec3 whole = glm::round(step);
    // Windows 1e7 m from the origin are known to a millionth of a texel of 1 mm.
    constexpr double kWhole = 1e-3;
    if (glm::any(glm::greaterThan(glm::abs(step - whole), glm::dvec3(kWhole)))) return std::nullopt;
    if (glm::any(glm::greaterThanEqual(glm::abs(whole), glm::dvec3(side, side, culling::kDepthUnits))))
        return std::nullopt;
    return ViewStep{glm::ivec2(whole), int(whole.z)};
}

Result<std::unique_ptr<Engine>> makeScrollEngine(const Setting& setting, const ShadowMethod& method,
                                                 const world::Pose& first) {
    auto engine = std::make_unique<ScrollEngine>(setting, method, first);
    if (const auto done = engine->start(); !done) return done.error();
    return std::unique_ptr<Engine>(std::move(engine));
}

}  // namespace tools::lab
