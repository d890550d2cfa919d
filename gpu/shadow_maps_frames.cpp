#include "gpu/shadow_maps_impl.h"

#include <algorithm>
#include <chrono>

#include "world/check.h"

namespace gpu {

using cache::CascadePlan;
using cache::FramePlan;
using cache::StoreRect;
using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

namespace {

bool drawsStatic(const CascadePlan& plan) {
    return !plan.unknowns.empty() || !plan.clears.empty() || !plan.staticPasses.empty();
}

double msSince(std::chrono::steady_clock::time_point start) {
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace

/// CHECKs what recording relies on; ranges within meshes are checked where the draws are made.
void ShadowMaps::Impl::check(const FramePlan& plan) const {
    CHECK(plan.cascades.size() <= static_cast<size_t>(config.cascades));
    const auto inMap = [this](const StoreRect& r) {
        return r.min.x >= 0 && r.min.y >= 0 && r.max.x <= config.side && r.max.y <= config.side;
    };
    for (const CascadePlan& cascade : plan.cascades) {
        CHECK(std::all_of(cascade.unknowns.begin(), cascade.unknowns.end(), inMap));
        CHECK(std::all_of(cascade.clears.begin(), cascade.clears.end(), inMap));
        CHECK(std::all_of(cascade.restores.begin(), cascade.restores.end(), inMap));
        for (const auto* passes : {&cascade.staticPasses, &cascade.activePasses})
            for (const cache::DrawPass& p : *passes) {
                CHECK(inMap(p.scissor));
                CHECK(p.firstItem <= plan.items.size() && p.itemCount <= plan.items.size() - p.firstItem);
            }
    }
    for (const cache::DrawItem& item : plan.items) CHECK(geometry.live(item.geometry));
}

/// Writes the place's buffers and notes each pass's draws in its `work`.
Result<Done> ShadowMaps::Impl::fill(const FramePlan& plan, const FramePlan& spotPlan, Place& place) {
    uint64_t items = spotPlan.items.size();
    for (const CascadePlan& cascade : plan.cascades)
        for (const auto* passes : {&cascade.staticPasses, &cascade.activePasses})
            for (const cache::DrawPass& p : *passes) items += p.itemCount;
    const uint64_t instanceBytes = items * sizeof(glm::mat3x4);
    // A doubled buffer must still be one that the device can give.
    if (instanceBytes > device.maxAllocationBytes / 2)
        return Error{ErrorCode::kLimit, "frame plan: " + std::to_string(items) + " draws are more than '" +
                                            device.name +
                                            "' takes at once; use fewer cascades or a lower far distance"};
    const auto moreInstances = place.instances.reserve(device, instanceBytes);
    if (!moreInstances) return moreInstances;
    const auto moreCommands = place.commands.reserve(device, items * sizeof(VkDrawIndexedIndirectCommand));
    if (!moreCommands) return moreCommands;

    drawList.begin({reinterpret_cast<VkDrawIndexedIndirectCommand*>(place.commands.buffer().mapped), items},
                   {reinterpret_cast<glm::mat3x4*>(place.instances.buffer().mapped), items});
    for (size_t c = 0; c < plan.cascades.size(); ++c) {
        const auto add = [&](const std::vector<cache::DrawPass>& passes,
                             std::vector<DepthPass::Draws>& draws) {
            draws.clear();
            for (const cache::DrawPass& p : passes)
                draws.push_back(
                    {p.scissor, drawList.add(std::span(plan.items).subspan(p.firstItem, p.itemCount),
                                             geometry.ranges(), plan.transforms)});
        };
        add(plan.cascades[c].staticPasses, place.work[c].staticDraws);
        add(plan.cascades[c].activePasses, place.work[c].activeDraws);
    }
    spots.fill(spotPlan, geometry, drawList);
    uploaded += drawList.instanceCount() * sizeof(glm::mat3x4) +
                drawList.commandCount() * sizeof(VkDrawIndexedIndirectCommand);
    return Done{};
}

/// All cascades' static parts, then all restores, then all active parts: three barriers in all, and
/// on a software driver each one waits for everything before it.
void ShadowMaps::Impl::record(VkCommandBuffer commandBuffer, const FramePlan& plan, const DepthPass::Buffers& buffers,
                              Place& place, std::vector<CascadeMaps>& target) {
    Frame& frame = place.frame;
    std::vector<CascadeWork>& work = place.work;
    const size_t count = plan.cascades.size();
    const auto side = static_cast<uint32_t>(config.side);
    DepthPass& pass = passOf.at(config.format);
    frame.stamp();
    for (size_t c = 0; c < count; ++c)
        if (drawsStatic(plan.cascades[c])) frame.need(target[c].cacheMap, Use::kAttachment);
    frame.barrier();
    for (size_t c = 0; c < count; ++c) {
        if (!drawsStatic(plan.cascades[c])) continue;
        pass.record(commandBuffer, target[c].cacheMap.image, side,
                    {plan.cascades[c].unknowns, plan.cascades[c].clears, work[c].staticDraws}, buffers);
        work[c].staticEnd = frame.stamp();
    }
    for (size_t c = 0; c < count; ++c) {
        if (plan.cascades[c].restores.empty()) continue;
        frame.need(target[c].cacheMap, Use::kCopySource);
        frame.need(target[c].working, Use::kCopyTarget);
    }
    frame.barrier();
    for (size_t c = 0; c < count; ++c) {
        if (plan.cascades[c].restores.empty()) continue;
        recordRestores(commandBuffer, target[c], plan.cascades[c].restores, copies);
        work[c].restoreEnd = frame.stamp();
    }
    for (size_t c = 0; c < count; ++c)
        if (!plan.cascades[c].activePasses.empty()) frame.need(target[c].working, Use::kAttachment);
    frame.barrier();
    for (size_t c = 0; c < count; ++c) {
        if (plan.cascades[c].activePasses.empty()) continue;
        pass.record(commandBuffer, target[c].working.image, side, {{}, {}, work[c].activeDraws}, buffers);
        work[c].activeEnd = frame.stamp();
    }
}

/// The next place, once its last submission has finished.
Result<Place*> ShadowMaps::Impl::claim() {
    Place& place = places[next];
    if (const auto settled = settle(place); !settled) return settled.error();
    for (CascadeWork& w : place.work) w.staticEnd = w.restoreEnd = w.activeEnd = 0;
    place.spotsEnd = 0;
    return &place;
}

/// The next ticket, with an outcome that tells of no cost yet.
Ticket ShadowMaps::Impl::giveTicket(bool submitted) {
    Outcome& o = outcome(++last);
    o.error.reset();
    o.times.cascades.assign(static_cast<size_t>(config.cascades), {});
    o.times.spotsMs = o.times.recordMs = o.times.wallMs = 0;
    o.times.submitted = submitted;
    return last;
}

/// Submits what the claimed place has recorded and waits. It reads no geometry and takes no ticket.
Result<Done> ShadowMaps::Impl::runAlone(Place& place) {
    place.ticket = 0;
    if (const auto submitted = place.frame.submit(); !submitted) return submitted;
    return place.frame.settle();
}

/// Waits for a place's submission and notes its outcome. Nothing to do where none is under way.
Result<Done> ShadowMaps::Impl::settle(Place& place) {
    if (!place.frame.pending()) return Done{};
    const auto settled = place.frame.settle();
    // Nobody asks, or may ask any more.
    if (place.ticket == 0 || last - place.ticket >= kTicketsKept) return settled;
    Outcome& o = outcome(place.ticket);
    o.error.reset();
    if (!settled) {
        o.error = settled.error();
        return settled;
    }
    o.times.wallMs = place.frame.wallMs();
    for (size_t c = 0; c < place.work.size(); ++c) {
        const CascadeWork& w = place.work[c];
        CascadeTimes& t = o.times.cascades[c];
        if (w.staticEnd > 0) t.staticMs = place.frame.msUntil(w.staticEnd);
        if (w.restoreEnd > 0) t.activeMs += place.frame.msUntil(w.restoreEnd);
        if (w.activeEnd > 0) t.activeMs += place.frame.msUntil(w.activeEnd);
    }
    if (place.spotsEnd > 0) o.times.spotsMs = place.frame.msUntil(place.spotsEnd);
    return Done{};
}

/// Waits for all submissions up to a ticket, the oldest first.
Result<Done> ShadowMaps::Impl::settleUpTo(Ticket ticket) {
    for (size_t i = 0; i < places.size(); ++i) {
        Place& place = places[(next + i) % places.size()];
        if (place.ticket > ticket) break;
        if (const auto settled = settle(place); !settled) return settled.error();
    }
    return Done{};
}

/// All submissions up to this one were waited for.
Ticket ShadowMaps::Impl::settledUpTo() const {
    for (size_t i = 0; i < places.size(); ++i) {
        const Place& place = places[(next + i) % places.size()];
        if (place.frame.pending()) return std::max<Ticket>(place.ticket, 1) - 1;
    }
    return last;
}

Result<Ticket> ShadowMaps::Impl::submit(const FramePlan& plan, const FramePlan& spotPlan, bool toScratch) {
    if (plan.idle() && spotPlan.idle()) return giveTicket(false);
    check(plan);
    spots.check(spotPlan, geometry);
    const auto claimed = claim();
    if (!claimed) return claimed.error();
    Place& place = *claimed.value();
    const auto start = std::chrono::steady_clock::now();
    if (const auto filled = fill(plan, spotPlan, place); !filled) return filled.error();
    const auto commandBuffer = place.frame.begin();
    if (!commandBuffer) return commandBuffer.error();
    const DepthPass::Buffers buffers{.geometry = geometry.buffer(),
                                     .instances = place.instances.buffer(),
                                     .commands = place.commands.buffer()};
    record(commandBuffer.value(), plan, buffers, place, toScratch ? scratch : maps);
    if (!spotPlan.idle()) {
        spots.record(place.frame, commandBuffer.value(), spotPlan, buffers, toScratch);
        place.spotsEnd = place.frame.stamp();
    }
    const double recordMs = msSince(start);
    if (const auto submitted = place.frame.submit(); !submitted) return submitted.error();
    next = (next + 1) % places.size();
    place.ticket = giveTicket(true);
    outcome(place.ticket).times.recordMs = recordMs;
    return place.ticket;
}

Result<GpuTimes> ShadowMaps::Impl::finish(Ticket ticket) {
    CHECK(ticket > 0 && ticket <= last && last - ticket < kTicketsKept);
    const Outcome& o = outcome(ticket);
    if (!o.times.submitted) return o.times;
    if (const auto settled = settleUpTo(ticket); !settled) return settled.error();
    if (o.error) return *o.error;
    return o.times;
}

}  // namespace gpu
