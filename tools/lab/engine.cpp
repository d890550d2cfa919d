#include "tools/lab/engine.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <glm/gtc/matrix_transform.hpp>
#include <optional>
#include <utility>

#include "server/cascade_images.h"
#include "server/shadow_system.h"
#include "tools/lab/scroll_engine.h"
#include "tools/lab/view_plans.h"
#include "tools/method_file.h"
#include "tools/lab/view_target.h"
#include "tools/mover_feed.h"
#include "tools/replay.h"

namespace tools::lab {
namespace {

using culling::Keep;
using culling::ShadowMethod;
using culling::ShadowView;
using world::Done;
using world::Result;

/// The same view without its own origin, as far as single precision tells.
ShadowView fromOrigin(ShadowView view) {
    view.clipFromLight = glm::dmat4(glm::mat4(glm::translate(view.clipFromLight, -view.origin)));
    view.origin = glm::dvec3(0);
    return view;
}

/// Draws every map whole in every frame; but what is the same whatever the camera does, once.
class RedrawEngine : public Engine {
public:
    RedrawEngine(const Setting& setting, const ShadowMethod& method, const world::Pose& first)
        : setting_(setting), method_(method) {
        lightFor(first);
    }

    Result<Done> start() {
        auto made = ViewTarget::create(setting_.device, method_, views_.back().map + 1);
        if (!made) return made.error();
        target_.emplace(std::move(made.value()));
        return Done{};
    }

    Result<FrameCost> advance(const world::Pose& pose) override {
        setting_.scene.moveTo(pose.time);
        if (setting_.sunAt) lightFor(pose);
        casters_->moved(setting_.scene.movers());
        const auto start = std::chrono::steady_clock::now();
        views_ = viewsFor(pose);
        FrameCost frame;
        gpu::ViewPlan plan;
        const culling::View camera = viewAt(setting_, pose);
        frame.cost = casters_->plan(views_, !staticsDrawn_, *target_, plan,
                                    setting_.defect == Defect::kSeenCasters ? &camera : nullptr);
        frame.cost.texels = plan.clears.size() * uint64_t(method_.side) * uint64_t(method_.side);
        if (const auto drawn = target_->draw(plan); !drawn) return drawn.error();
        frame.ms = msSince(start);
        staticsDrawn_ = true;
        return frame;
    }
    bool remembers() const override { return false; }
    std::span<const ShadowView> views() const override { return views_; }
    Result<std::vector<std::vector<float>>> images() override { return target_->images(views_.back().map + 1); }
    const culling::LightSpace& light() const override { return light_; }

private:
    /// Fits all casters to the light of a pose.
    void lightFor(const world::Pose& pose) {
        light_ = lightAt(setting_, pose.time);
        views_ = viewsFor(pose);
        casters_.emplace(setting_.scene, light_, method_, views_);
        staticsDrawn_ = false;
    }
    std::vector<ShadowView> viewsFor(const world::Pose& pose) const {
        std::vector<ShadowView> views = culling::viewsOf(method_, light_, viewAt(setting_, pose), kNearDistance,
                                                         setting_.farDistance, setting_.scene.bounds());
        if (setting_.defect == Defect::kFromOrigin)
            for (ShadowView& view : views) view = fromOrigin(view);
        return views;
    }

    const Setting& setting_;
    ShadowMethod method_;
    culling::LightSpace light_;
    std::vector<ShadowView> views_;
    std::optional<ViewCasters> casters_;
    std::optional<ViewTarget> target_;
    bool staticsDrawn_ = false;
};

/// Gnomon itself.
class CacheEngine : public Engine {
public:
    CacheEngine(const Setting& setting, const ShadowMethod& method, const world::Pose& first)
        : setting_(setting), method_(method), light_(lightAt(setting, first.time)) {}

    Result<Done> start() {
        server::ShadowConfig config = setting_.cache;
        if (const auto good = apply(method_, config); !good) return good;
        config.farDistance = setting_.farDistance;
        config.sun = light_.sun;
        config.movingSun = bool(setting_.sunAt);
        config.geometryBytes = kGeometryBytes;
        auto made = server::ShadowSystem::create(setting_.device, setting_.store, config);
        if (!made) return made.error();
        system_ = std::move(made.value());
        for (const Removal& removal : setting_.removals) {
            const auto id = system_->adopt(removal.name);
            if (!id) return id.error();
            leaving_.push_back(id.value());
        }
        if (setting_.movers.empty()) return Done{};
        auto feed = MoverFeed::create(*system_, setting_.movers);
        if (!feed) return feed.error();
        feed_.emplace(std::move(feed.value()));
        return Done{};
    }

    Result<FrameCost> advance(const world::Pose& pose) override {
        setting_.scene.moveTo(pose.time);
        const culling::View view = viewAt(setting_, pose);
        server::FrameInput input;
        input.time = pose.time;
        input.camera = {.position = view.eye, .orientation = view.orientation, .verticalFov = view.verticalFov, .aspect = view.aspect};
        if (feed_) input.objects = feed_->at(pose.time);
        if (setting_.sunAt) input.sun = lightAt(setting_, pose.time).sun;
        for (; gone_ < leaving_.size() && setting_.removals[gone_].time <= pose.time; ++gone_)
            if (const auto removed = system_->remove(leaving_[gone_]); !removed) return removed.error();
        const auto start = std::chrono::steady_clock::now();
        auto report = system_->advance(input);
        if (!report) return report.error();
        if (const auto done = system_->finish(report.value()); !done) return done.error();
        FrameCost frame;
        frame.ms = msSince(start) - report.value().cpu.streamMs;
        for (const cache::CascadeStatistics& c : report.value().cascades) {
            frame.cost += c.total;
            frame.cost += c.active;
        }
        if (!report.value().errors.empty()) return report.value().errors.front();
        if (setting_.sunAt) light_ = culling::makeLightSpace(report.value().sun.shown).value();
        return frame;
    }
    bool remembers() const override { return true; }
    std::span<const ShadowView> views() const override { return views_; }

    /// Maps as their views have them: from the low corner of the window on.
    Result<std::vector<std::vector<float>>> images() override {
        auto read = server::readImages(*system_, 0);
        if (!read) return read.error();
        views_ = std::move(read.value().views);
        return std::move(read.value().images);
    }
    const culling::LightSpace& light() const override { return light_; }

private:
    const Setting& setting_;
    ShadowMethod method_;
    std::unique_ptr<server::ShadowSystem> system_;
    std::optional<MoverFeed> feed_;
    std::vector<server::ObjectId> leaving_;  ///< as the setting's removals
    size_t gone_ = 0;                        ///< of them
    culling::LightSpace light_;
    std::vector<ShadowView> views_;
};

template <class Kind, class... Arguments>
Result<std::unique_ptr<Engine>> started(Arguments&&... arguments) {
    auto engine = std::make_unique<Kind>(std::forward<Arguments>(arguments)...);
    if (const auto done = engine->start(); !done) return done.error();
    return std::unique_ptr<Engine>(std::move(engine));
}

/// "0.5 m", "66.7 m".
std::string lengthText(double metres) {
    char text[32];
    std::snprintf(text, sizeof text, "%.3g m", metres);
    return text;
}

}  // namespace

double msSince(std::chrono::steady_clock::time_point start) {
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

culling::View viewAt(const Setting& setting, const world::Pose& pose) {
    return {pose.position, pose.orientation, setting.fovAt ? setting.fovAt(pose.time) : setting.verticalFov, kAspect};
}

culling::LightSpace lightAt(const Setting& setting, double time) {
    return setting.sunAt ? culling::makeLightSpace(setting.sunAt(time)).value() : setting.light;
}

Result<Done> requireRoom(const Setting& setting, const ShadowMethod& method) {
    const double far = setting.farDistance, across = glm::length(setting.scene.bounds().extent());
    const auto idle = [&](int cascades) -> std::string {
        if (cascades == 1) return "";
        culling::Splits splits = method.splits;
        splits.count = cascades;
        const std::vector<double> ends = culling::splitsOf(splits, std::min(kNearDistance, far / 2), far);
        if (ends.front() <= kNearDistance) return "the finest serves nothing farther off than " + lengthText(kNearDistance);
        if (ends[ends.size() - 2] >= across)
            return "the coarsest begins " + lengthText(ends[ends.size() - 2]) + " off, and the world is " + lengthText(across) +
                   " across";
        return "";
    };
    const std::string why = idle(method.splits.count);
    if (why.empty()) return Done{};
    int most = method.splits.count - 1;
    while (!idle(most).empty()) --most;
    std::string what = "method ";
    what.append(method.name).append(": ").append(std::to_string(method.splits.count)).append(" cascades within ");
    what.append(lengthText(far)).append(": ").append(why).append("; give at most ").append(std::to_string(most));
    what.append(", or another --far");
    return world::Error{world::ErrorCode::kUsage, what};
}

Result<std::unique_ptr<Engine>> makeEngine(const Setting& setting, const ShadowMethod& method, const world::Pose& first) {
    if (const auto good = culling::requireMethod(method); !good) return good.error();
    if (method.keep == Keep::kScrolled) return makeScrollEngine(setting, method, first);
    if (method.keep == Keep::kCached) return started<CacheEngine>(setting, method, first);
    return started<RedrawEngine>(setting, method, first);
}

}  // namespace tools::lab
