#include "gpu/spot_maps.h"

#include <algorithm>

#include "world/check.h"

namespace gpu {
namespace {

using cache::CascadePlan;
using cache::FramePlan;
using cache::StoreRect;
using world::Done;
using world::Result;

bool drawsStatic(const CascadePlan& plan) { return !plan.clears.empty() || !plan.staticPasses.empty(); }

}  // namespace

Result<Done> SpotMaps::needFrame() {
    if (frame_) return Done{};
    auto frame = Frame::create(*device_, 0, "spot maps frame");
    if (!frame) return frame.error();
    frame_.emplace(std::move(frame.value()));
    return Done{};
}

Result<Done> SpotMaps::submitAndWait() {
    if (const auto submitted = frame_->submit(); !submitted) return submitted;
    return frame_->settle();
}

Result<CascadeMaps> SpotMaps::makeMaps(int side, const std::string& name) {
    ShadowMapsConfig config;
    config.cascades = 1;
    config.side = side;
    auto made = createCascadeMaps(*device_, config, name);
    if (!made) return made.error();
    if (const auto settled = frame_->settle(); !settled) return settled.error();
    const auto commands = frame_->begin();
    if (!commands) return commands.error();
    recordNew(*frame_, commands.value(), made.value(), static_cast<uint32_t>(side));
    if (const auto done = submitAndWait(); !done) return done.error();
    return std::move(made.value().front());
}

Result<Done> SpotMaps::add(int side) {
    CHECK(side > 0);
    if (static_cast<uint32_t>(side) > device_->maxSide)
        return world::Error{world::ErrorCode::kLimit, "spot maps of " + std::to_string(side) + " texels a side: '" +
                                                          device_->name + "' draws at most " +
                                                          std::to_string(device_->maxSide) + "; lower the resolution"};
    if (const auto made = needFrame(); !made) return made;
    if (!pass_) {
        auto pass = DepthPass::create(*device_, DepthFormat::kD32, Projection::kPerspective);
        if (!pass) return pass.error();
        pass_.emplace(std::move(pass.value()));
    }
    const std::string name = "spot " + std::to_string(named_++) + ' ';
    auto maps = makeMaps(side, name);
    if (!maps) return maps.error();
    lights_.push_back({.side = side,
                       .name = name,
                       .maps = std::move(maps.value()),
                       .scratch = {},
                       .staticDraws = {},
                       .activeDraws = {}});
    return Done{};
}

void SpotMaps::remove(size_t light) {
    CHECK(light < lights_.size());
    const int side = lights_[light].side;
    lights_.erase(lights_.begin() + static_cast<std::ptrdiff_t>(light));
    if (std::none_of(lights_.begin(), lights_.end(), [side](const Light& l) { return l.side == side; }))
        readbacks_.erase(side);
}

Result<Done> SpotMaps::needScratch() {
    for (Light& light : lights_) {
        if (light.scratch) continue;
        auto made = makeMaps(light.side, "scratch " + light.name);
        if (!made) return made.error();
        light.scratch = std::move(made.value());
    }
    return Done{};
}

void SpotMaps::check(const FramePlan& plan, const GeometryStore& geometry) const {
    CHECK(plan.cascades.empty() || plan.cascades.size() == lights_.size());
    for (size_t i = 0; i < plan.cascades.size(); ++i) {
        const CascadePlan& p = plan.cascades[i];
        const auto inMap = [side = lights_[i].side](const StoreRect& r) {
            return r.min.x >= 0 && r.min.y >= 0 && r.max.x <= side && r.max.y <= side;
        };
        CHECK(p.unknowns.empty());  // nothing of a light waits
        CHECK(std::all_of(p.clears.begin(), p.clears.end(), inMap));
        CHECK(std::all_of(p.restores.begin(), p.restores.end(), inMap));
        for (const auto* passes : {&p.staticPasses, &p.activePasses})
            for (const cache::DrawPass& pass : *passes) {
                CHECK(inMap(pass.scissor));
                CHECK(pass.firstItem <= plan.items.size() && pass.itemCount <= plan.items.size() - pass.firstItem);
            }
    }
    for (const cache::DrawItem& item : plan.items) CHECK(geometry.live(item.geometry));
}

void SpotMaps::fill(const FramePlan& plan, const GeometryStore& geometry, DrawList& draws) {
    for (size_t i = 0; i < plan.cascades.size(); ++i) {
        const auto add = [&](const std::vector<cache::DrawPass>& passes, std::vector<DepthPass::Draws>& noted) {
            noted.clear();
            for (const cache::DrawPass& p : passes)
                noted.push_back({p.scissor, draws.add(std::span(plan.items).subspan(p.firstItem, p.itemCount),
                                                      geometry.ranges(), plan.transforms)});
        };
        add(plan.cascades[i].staticPasses, lights_[i].staticDraws);
        add(plan.cascades[i].activePasses, lights_[i].activeDraws);
    }
}

void SpotMaps::record(Frame& frame, VkCommandBuffer commands, const FramePlan& plan,
                      const DepthPass::Buffers& buffers, bool scratch) {
    const auto each = [&](auto&& f) {
        for (size_t i = 0; i < plan.cascades.size(); ++i)
            f(plan.cascades[i], lights_[i], scratch ? *lights_[i].scratch : lights_[i].maps);
    };
    each([&](const CascadePlan& p, Light&, CascadeMaps& maps) {
        if (drawsStatic(p)) frame.need(maps.cacheMap, Use::kAttachment);
    });
    frame.barrier();
    each([&](const CascadePlan& p, Light& light, CascadeMaps& maps) {
        if (!drawsStatic(p)) return;
        pass_->record(commands, maps.cacheMap.image, static_cast<uint32_t>(light.side),
                      {{}, p.clears, light.staticDraws}, buffers);
    });
    each([&](const CascadePlan& p, Light&, CascadeMaps& maps) {
        if (p.restores.empty()) return;
        frame.need(maps.cacheMap, Use::kCopySource);
        frame.need(maps.working, Use::kCopyTarget);
    });
    frame.barrier();
    each([&](const CascadePlan& p, Light&, CascadeMaps& maps) { recordRestores(commands, maps, p.restores, copies_); });
    each([&](const CascadePlan& p, Light&, CascadeMaps& maps) {
        if (!p.activePasses.empty()) frame.need(maps.working, Use::kAttachment);
    });
    frame.barrier();
    each([&](const CascadePlan& p, Light& light, CascadeMaps& maps) {
        if (p.activePasses.empty()) return;
        pass_->record(commands, maps.working.image, static_cast<uint32_t>(light.side), {{}, {}, light.activeDraws},
                      buffers);
    });
}

Result<std::vector<float>> SpotMaps::read(size_t number, MapKind kind) {
    CHECK(number < lights_.size());
    Light& light = lights_[number];
    const bool scratch = kind == MapKind::kScratchCache || kind == MapKind::kScratchWorking;
    CHECK(!scratch || light.scratch);
    CascadeMaps& maps = scratch ? *light.scratch : light.maps;
    DepthMap& map = kind == MapKind::kCache || kind == MapKind::kScratchCache ? maps.cacheMap : maps.working;
    auto readback = readbacks_.find(light.side);
    if (readback == readbacks_.end()) {
        auto made = Readback::create(*device_, static_cast<uint32_t>(light.side), DepthFormat::kD32);
        if (!made) return made.error();
        readback = readbacks_.emplace(light.side, std::move(made.value())).first;
    }
    if (const auto settled = frame_->settle(); !settled) return settled.error();
    const auto commands = frame_->begin();
    if (!commands) return commands.error();
    readback->second.record(*frame_, commands.value(), map);
    if (const auto done = submitAndWait(); !done) return done.error();
    return readback->second.depths();
}

}  // namespace gpu
