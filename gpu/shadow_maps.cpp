#include "gpu/shadow_maps_impl.h"

#include <algorithm>
#include <cstring>

#include "world/check.h"

namespace gpu {
namespace {

using cache::FramePlan;
using cache::GeometryId;
using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

/// First size of a frame's buffers: a few hundred casters.
constexpr uint64_t kFirstBytes = 64 << 10;

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

}  // namespace

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
    return impl_->geometry.upload(level, [this](Ticket reader) { return impl_->settleUpTo(reader); });
}

void ShadowMaps::release(GeometryId id) {
    impl_->geometry.release(id, impl_->last);
    impl_->geometry.forgetReaders(impl_->settledUpTo());
}

uint64_t ShadowMaps::geometryBytesUsed() const { return impl_->geometry.bytesUsed(); }
uint64_t ShadowMaps::uploadedBytes() const { return impl_->uploaded + impl_->geometry.uploadedBytes(); }

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

double ShadowMaps::recordMs(Ticket ticket) const {
    CHECK(remembered(ticket));
    return impl_->outcome(ticket).times.recordMs;
}

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
