#include "gpu/shadow_maps.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstring>
#include <map>
#include <optional>

#include "gpu/cascade_maps.h"
#include "gpu/depth_pass.h"
#include "gpu/device_impl.h"
#include "gpu/draw_list.h"
#include "gpu/frame.h"
#include "gpu/geometry_store.h"
#include "gpu/spot_maps.h"
#include "world/check.h"

namespace gpu {
namespace {

using cache::CascadePlan;
using cache::FramePlan;
using cache::GeometryId;
using cache::StoreRect;
using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

/// First size of a frame's buffers: a few hundred casters.
constexpr uint64_t kFirstBytes = 64 << 10;
/// After a cascade's static passes, its restores and its active passes.
/// Each costs a software driver 0.05 to 0.1 ms, so none is taken twice.
constexpr uint32_t kStampsPerCascade = 3;

/// Where one cascade's draws are, and the timestamps that end its parts; the one before starts them.
struct CascadeWork {
    std::vector<DepthPass::Draws> staticDraws, activeDraws;
    uint32_t staticEnd = 0, restoreEnd = 0, activeEnd = 0;  ///< 0: not taken
};

/// What one submission uses until it has finished; then the next one takes the place.
struct Place {
    GrowingBuffer instances, commands;
    std::vector<CascadeWork> work;
    uint32_t spotsEnd = 0;  ///< timestamp that ends the spot lights' part; 0: not taken
    Ticket ticket = 0;  ///< of its last submission; 0: that had none
    Frame frame;        ///< last, so that its destructor waits before the buffers go
};

/// What `finish` tells of a ticket.
struct Outcome {
    GpuTimes times;
    std::optional<Error> error;
};

bool drawsStatic(const CascadePlan& plan) {
    return !plan.unknowns.empty() || !plan.clears.empty() || !plan.staticPasses.empty();
}

Result<Done> requireSide(const Device::Impl& device, int side) {
    if (static_cast<uint32_t>(side) <= device.maxSide) return Done{};
    return Error{ErrorCode::kLimit, "shadow maps of " + std::to_string(side) + " texels a side: '" + device.name +
                                        "' draws at most " + std::to_string(device.maxSide) +
                                        "; lower --resolution"};
}

Result<std::vector<Place>> makePlaces(Device::Impl& device, const ShadowMapsConfig& config) {
    std::vector<Place> places;
    places.reserve(static_cast<size_t>(config.framesInFlight));
    for (int i = 0; i < config.framesInFlight; ++i) {
        const std::string number = std::to_string(i);
        auto instances = GrowingBuffer::create(device, kFirstBytes, VK_BUFFER_USAGE_VERTEX_BUFFER_BIT,
                                               "instances " + number);
        if (!instances) return instances.error();
        auto commands = GrowingBuffer::create(device, kFirstBytes, VK_BUFFER_USAGE_INDIRECT_BUFFER_BIT,
                                              "indirect draws " + number);
        if (!commands) return commands.error();
        // One starts the frame, and one ends the spot lights' part.
        const uint32_t stamps =
            config.timestamps ? 2 + kStampsPerCascade * static_cast<uint32_t>(config.cascades) : 0;
        auto frame = Frame::create(device, stamps, "shadow maps frame " + number);
        if (!frame) return frame.error();
        places.push_back({.instances = std::move(instances.value()),
                          .commands = std::move(commands.value()),
                          .work = std::vector<CascadeWork>(static_cast<size_t>(config.cascades)),
                          .spotsEnd = 0,
                          .ticket = 0,
                          .frame = std::move(frame.value())});
    }
    return places;
}

double msSince(std::chrono::steady_clock::time_point start) {
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace

struct ShadowMaps::Impl {
    Device::Impl& device;
    ShadowMapsConfig config;
    std::map<DepthFormat, DepthPass> passOf;  ///< each made once: drivers keep something of a pipeline that is gone
    GeometryStore geometry;
    std::optional<Readback> readback;        ///< made at the first read
    std::optional<Buffer> shared;            ///< over, or beside, the memory that is shared
    std::span<std::byte> sharedMemory;
    std::vector<CascadeMaps> maps, scratch;  ///< scratch: made at first use
    SpotMaps spots;
    DrawList drawList;
    std::vector<VkImageCopy> copies;
    uint64_t uploaded = 0;                       ///< without geometry
    Ticket last = 0;                             ///< given out
    std::array<Outcome, kTicketsKept> outcomes;  ///< by ticket modulo their number
    size_t next = 0;                             ///< place of the next submission; the oldest one is in it
    std::vector<Place> places;                   ///< last: they wait before anything that they use goes

    Result<std::vector<CascadeMaps>> makeMaps(const ShadowMapsConfig& of, const std::string& prefix);
    Result<Done> needPass(DepthFormat format);
    Result<Done> needScratch();
    void check(const FramePlan& plan) const;
    Result<Done> fill(const FramePlan& plan, const FramePlan& spotPlan, Place& place);
    void record(VkCommandBuffer commandBuffer, const FramePlan& plan, const DepthPass::Buffers& buffers, Place& place,
                std::vector<CascadeMaps>& target);

    Outcome& outcome(Ticket ticket) { return outcomes[ticket % kTicketsKept]; }
    Result<Place*> claim();
    Ticket giveTicket(bool submitted);
    Result<Done> runAlone(Place& place);
    Result<Done> settle(Place& place);
    Result<Done> settleUpTo(Ticket ticket);
    void reclaim();
    Result<Ticket> submit(const FramePlan& plan, const FramePlan& spotPlan, bool toScratch);
    Result<GpuTimes> finish(Ticket ticket);
};

Result<std::unique_ptr<ShadowMaps>> ShadowMaps::create(Device& device, const ShadowMapsConfig& config) {
    CHECK(config.cascades > 0 && config.side > 0 && config.framesInFlight > 0);
    Device::Impl& d = device.impl();
    if (const auto good = requireSide(d, config.side); !good) return good.error();
    auto geometry = GeometryStore::create(d, config.geometryBytes);
    if (!geometry) return geometry.error();
    std::unique_ptr<Impl> impl(new Impl{.device = d,
                                        .config = config,
                                        .passOf = {},
                                        .geometry = std::move(geometry.value()),
                                        .readback = {},
                                        .shared = {},
                                        .sharedMemory = {},
                                        .maps = {},
                                        .scratch = {},
                                        .spots = SpotMaps(d),
                                        .drawList = {},
                                        .copies = {},
                                        .outcomes = {},
                                        .places = {}});
    if (const auto made = impl->needPass(config.format); !made) return made.error();
    auto places = makePlaces(d, config);
    if (!places) return places.error();
    impl->places = std::move(places.value());
    auto maps = impl->makeMaps(config, "");
    if (!maps) return maps.error();
    impl->maps = std::move(maps.value());
    return std::unique_ptr<ShadowMaps>(new ShadowMaps(std::move(impl)));
}

ShadowMaps::ShadowMaps(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
ShadowMaps::~ShadowMaps() = default;

Result<std::vector<CascadeMaps>> ShadowMaps::Impl::makeMaps(const ShadowMapsConfig& of, const std::string& prefix) {
    auto made = createCascadeMaps(device, of, prefix);
    if (!made) return made.error();
    const auto place = claim();
    if (!place) return place.error();
    Frame& frame = place.value()->frame;
    const auto commandBuffer = frame.begin();
    if (!commandBuffer) return commandBuffer.error();
    recordNew(frame, commandBuffer.value(), made.value(), static_cast<uint32_t>(of.side));
    if (const auto done = runAlone(*place.value()); !done) return done.error();
    return made;
}

Result<Done> ShadowMaps::Impl::needPass(DepthFormat format) {
    if (passOf.contains(format)) return Done{};
    auto pass = DepthPass::create(device, format);
    if (!pass) return pass.error();
    passOf.emplace(format, std::move(pass.value()));
    return Done{};
}

Result<Done> ShadowMaps::Impl::needScratch() {
    if (!scratch.empty()) return Done{};
    auto made = makeMaps(config, "scratch ");
    if (!made) return made.error();
    scratch = std::move(made.value());
    return Done{};
}

Result<Done> ShadowMaps::reshape(std::span<const int> from, int side, DepthFormat format) {
    Impl& impl = *impl_;
    CHECK(!from.empty() && side > 0);
    if (const auto settled = impl.settleUpTo(impl.last); !settled) return settled.error();
    if (const auto good = requireSide(impl.device, side); !good) return good.error();
    ShadowMapsConfig config = impl.config;
    config.cascades = static_cast<int>(from.size());
    config.side = side;
    config.format = format;
    const bool same = side == impl.config.side && format == impl.config.format;
    auto places = makePlaces(impl.device, config);
    if (!places) return places.error();
    if (const auto made = impl.needPass(format); !made) return made;
    ShadowMapsConfig missing = config;
    missing.cascades = static_cast<int>(std::count(from.begin(), from.end(), -1));
    auto fresh = impl.makeMaps(missing, "");
    if (!fresh) return fresh.error();

    std::vector<CascadeMaps> maps;
    size_t next = 0;
    for (const int old : from) {
        CHECK(old == -1 || (same && old >= 0 && old < impl.config.cascades));
        maps.push_back(std::move(old == -1 ? fresh.value()[next++] : impl.maps[static_cast<size_t>(old)]));
    }
    impl.maps = std::move(maps);
    impl.scratch.clear();
    impl.readback.reset();
    impl.places = std::move(places.value());
    impl.next = 0;
    impl.config = config;
    return Done{};
}

Result<GeometryId> ShadowMaps::upload(const world::MeshLevel& level) {
    if (impl_->geometry.anyRetired()) impl_->reclaim();
    return impl_->geometry.upload(level);
}

void ShadowMaps::release(GeometryId id) {
    impl_->geometry.release(id, impl_->last);
    impl_->reclaim();  // at once, where nothing is under way
}

uint64_t ShadowMaps::geometryBytesUsed() const { return impl_->geometry.bytesUsed(); }
uint64_t ShadowMaps::uploadedBytes() const { return impl_->uploaded + impl_->geometry.uploadedBytes(); }

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

/// Gives back what only finished submissions read. Does not wait.
void ShadowMaps::Impl::reclaim() {
    for (size_t i = 0; i < places.size(); ++i) {
        Place& place = places[(next + i) % places.size()];
        // An error is kept for whoever finishes the ticket.
        if (place.frame.done()) static_cast<void>(settle(place));
        if (place.frame.pending()) return geometry.reclaim(std::max<Ticket>(place.ticket, 1) - 1);
    }
    geometry.reclaim(last);
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
    if (geometry.anyRetired()) reclaim();
    if (o.error) return *o.error;
    return o.times;
}

Result<Done> ShadowMaps::addSpot(int side) { return impl_->spots.add(side); }

Result<Done> ShadowMaps::removeSpot(size_t light) {
    if (const auto settled = impl_->settleUpTo(impl_->last); !settled) return settled;
    impl_->spots.remove(light);
    return Done{};
}

Result<Ticket> ShadowMaps::submit(const FramePlan& plan, const FramePlan& spots) {
    return impl_->submit(plan, spots, false);
}

Result<GpuTimes> ShadowMaps::finish(Ticket ticket) { return impl_->finish(ticket); }

bool ShadowMaps::remembered(Ticket ticket) const { return impl_->last - ticket < kTicketsKept; }

Result<GpuTimes> ShadowMaps::execute(const FramePlan& plan, const FramePlan& spots) {
    const auto ticket = submit(plan, spots);
    if (!ticket) return ticket.error();
    return finish(ticket.value());
}

Result<GpuTimes> ShadowMaps::redraw(const FramePlan& plan, const FramePlan& spots) {
    if (const auto made = impl_->needScratch(); !made) return made.error();
    if (!spots.idle())
        if (const auto made = impl_->spots.needScratch(); !made) return made.error();
    if (const auto settled = impl_->settleUpTo(impl_->last); !settled) return settled.error();
    const auto ticket = impl_->submit(plan, spots, true);
    if (!ticket) return ticket.error();
    return finish(ticket.value());
}

Result<std::vector<float>> ShadowMaps::read(int cascade, MapKind kind) {
    Impl& impl = *impl_;
    CHECK(cascade >= 0 && cascade < impl.config.cascades);
    const bool scratch = kind == MapKind::kScratchCache || kind == MapKind::kScratchWorking;
    if (scratch)
        if (const auto made = impl.needScratch(); !made) return made.error();
    CascadeMaps& maps = (scratch ? impl.scratch : impl.maps)[static_cast<size_t>(cascade)];
    DepthMap& map = kind == MapKind::kCache || kind == MapKind::kScratchCache ? maps.cacheMap : maps.working;

    if (const auto settled = impl.settleUpTo(impl.last); !settled) return settled.error();
    if (!impl.readback) {
        auto made =
            Readback::create(impl.device, static_cast<uint32_t>(impl.config.side), impl.config.format);
        if (!made) return made.error();
        impl.readback = std::move(made.value());
    }
    const auto place = impl.claim();
    if (!place) return place.error();
    Frame& frame = place.value()->frame;
    const auto commandBuffer = frame.begin();
    if (!commandBuffer) return commandBuffer.error();
    impl.readback->record(frame, commandBuffer.value(), map);
    if (const auto done = impl.runAlone(*place.value()); !done) return done.error();
    return impl.readback->depths();
}

Result<bool> ShadowMaps::share(std::span<std::byte> memory) {
    Impl& impl = *impl_;
    if (const auto settled = impl.settleUpTo(impl.last); !settled) return settled.error();
    const uint64_t alignment = impl.device.importAlignment;
    const bool imports = alignment > 0 && reinterpret_cast<uintptr_t>(memory.data()) % alignment == 0 && memory.size() % alignment == 0;
    auto made = imports ? importBuffer(impl.device, memory, VK_BUFFER_USAGE_TRANSFER_DST_BIT, "shared maps")
                        : createBuffer(impl.device, memory.size(), VK_BUFFER_USAGE_TRANSFER_DST_BIT, Home::kReadback, "shared maps");
    if (!made) return made.error();
    impl.shared = std::move(made.value());
    impl.sharedMemory = memory;
    return imports;
}

Result<Done> ShadowMaps::copyWorking(std::span<const MapCopy> copies) {
    Impl& impl = *impl_;
    CHECK(impl.shared);
    const auto side = static_cast<uint32_t>(impl.config.side);
    const uint64_t bytes = uint64_t{side} * side * texelBytes(impl.config.format);
    if (copies.empty()) return Done{};
    if (const auto settled = impl.settleUpTo(impl.last); !settled) return settled.error();
    const auto place = impl.claim();
    if (!place) return place.error();
    Frame& frame = place.value()->frame;
    const auto commandBuffer = frame.begin();
    if (!commandBuffer) return commandBuffer.error();
    for (const MapCopy& copy : copies) {
        CHECK(copy.cascade >= 0 && copy.cascade < impl.config.cascades && copy.offset + bytes <= impl.shared->bytes);
        recordCopy(frame, commandBuffer.value(), impl.maps[static_cast<size_t>(copy.cascade)].working, side, *impl.shared, copy.offset);
    }
    frame.toHost(*impl.shared);
    if (const auto done = impl.runAlone(*place.value()); !done) return done.error();
    if (impl.shared->mapped == impl.sharedMemory.data()) return Done{};
    for (const MapCopy& copy : copies) std::memcpy(impl.sharedMemory.data() + copy.offset, impl.shared->mapped + copy.offset, bytes);
    return Done{};
}

Result<std::vector<float>> ShadowMaps::readSpot(size_t light, MapKind kind) {
    if (const auto settled = impl_->settleUpTo(impl_->last); !settled) return settled.error();
    return impl_->spots.read(light, kind);
}

}  // namespace gpu
