#include "server/spot_lights.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "world/hash.h"

namespace server {

namespace {

using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

std::string nameOf(SpotId id) { return "spot light " + std::to_string(id); }

Error told(const std::string& who, const Error& error) { return {error.code, who + ": " + error.what, error.native}; }

cache::GeometryOf geometryOf(ResidentScene& scene) {
    return [&scene](world::CasterId caster, size_t level) { return scene.uploadLevel(caster, level); };
}

}  // namespace

Result<size_t> SpotLights::find(SpotId id) const {
    const auto at =
        std::lower_bound(lights_.begin(), lights_.end(), id, [](const Entry& e, SpotId i) { return e.id < i; });
    if (at != lights_.end() && at->id == id) return static_cast<size_t>(at - lights_.begin());
    const char* why = id < next_ ? ": it was removed; add another" : ": there is none of that number; add it first";
    return Error{ErrorCode::kNotFound, nameOf(id) + why};
}

Result<SpotId> SpotLights::add(const culling::SpotLight& light) {
    const auto space = culling::makeSpotSpace(light);
    if (!space) return told("new spot light", space.error());
    if (lights_.size() == kMostSpots)
        return Error{ErrorCode::kLimit,
                     "new spot light: there are " + std::to_string(kMostSpots) + "; remove one first"};
    if (const auto made = maps_.addSpot(light.side); !made) return made.error();
    lights_.push_back({next_, cache::SpotCache(space.value(), sabotage_)});
    return next_++;
}

Result<Done> SpotLights::move(SpotId id, const culling::SpotLight& light) {
    const auto at = find(id);
    if (!at) return at.error();
    const auto space = culling::makeSpotSpace(light);
    if (!space) return told(nameOf(id), space.error());
    cache::SpotCache& cache = lights_[at.value()].cache;
    const int side = cache.space().light.side;
    if (light.side != side)
        return Error{ErrorCode::kUsage, nameOf(id) + ": its maps have " + std::to_string(side) +
                                            " texels a side; for another resolution remove it and add another"};
    cache.turn(space.value());
    return Done{};
}

Result<Done> SpotLights::remove(SpotId id) {
    const auto at = find(id);
    if (!at) return at.error();
    if (const auto removed = maps_.removeSpot(at.value()); !removed) return removed;
    lights_.erase(lights_.begin() + static_cast<std::ptrdiff_t>(at.value()));
    return Done{};
}

void SpotLights::forget() {
    for (Entry& light : lights_) light.cache.forget();
}

uint64_t SpotLights::planHash(uint64_t seed) const {
    if (lights_.empty()) return seed;
    const uint64_t hash = plan_.hash();
    return world::hashValues(std::span(&hash, 1), seed);
}

Result<Done> SpotLights::plan(ResidentScene& scene, std::vector<SpotReport>& reports) {
    reports.clear();
    plan_.reset(lights_.size());
    const cache::Scene view = scene.view(0, false);
    const cache::GeometryOf geometry = geometryOf(scene);
    for (size_t i = 0; i < lights_.size(); ++i) {
        reports.push_back({lights_[i].id, {}});
        const auto done =
            lights_[i].cache.plan(view, scene.worldEvents(), geometry, i, plan_, reports.back().cost);
        if (!done) return told(nameOf(lights_[i].id), done.error());
    }
    return Done{};
}

Result<SpotView> SpotLights::view(SpotId id) const {
    const auto at = find(id);
    if (!at) return at.error();
    const cache::SpotCache& cache = lights_[at.value()].cache;
    return SpotView{cache.space(), cache.drawn()};
}

Result<std::vector<float>> SpotLights::readMap(SpotId id, gpu::MapKind kind) {
    const auto at = find(id);
    if (!at) return at.error();
    return maps_.readSpot(at.value(), kind);
}

Result<std::vector<SpotAnswer>> SpotLights::lookup(SpotId id, std::span<const glm::dvec3> points,
                                                   const LookupBias& bias) {
    const auto at = find(id);
    if (!at) return at.error();
    const cache::SpotCache& cache = lights_[at.value()].cache;
    std::vector<SpotAnswer> answers(points.size(), SpotAnswer::kUnknown);
    if (!cache.drawn()) return answers;
    const culling::SpotSpace& space = cache.space();
    const double cosine = std::cos(space.light.halfAngle);
    std::vector<float> depths;  // read only if a point asks for it
    for (size_t i = 0; i < points.size(); ++i) {
        const glm::dvec3 p = space.toLight(points[i]);
        const double distance = glm::length(p);
        answers[i] = SpotAnswer::kOutside;
        if (!(p.z > 0 && distance <= space.light.range && p.z >= distance * cosine)) continue;
        if (depths.empty()) {
            auto read = maps_.readSpot(at.value(), gpu::MapKind::kWorking);
            if (!read) return read.error();
            depths = std::move(read.value());
        }
        // A point on the cone's edge may round to the texel beyond.
        const glm::ivec2 texel =
            glm::clamp(glm::ivec2(glm::floor(space.onMap(p))), glm::ivec2(0), glm::ivec2(space.light.side - 1));
        const float depth = depths[static_cast<size_t>(texel.y * space.light.side + texel.x)];
        const double room = bias.texels * space.texelAt(p.z) + bias.metres;
        const bool shadowed =
            depth < cache::kEmptyDepth && cache::distanceOf(depth, space.light.near) + room < p.z;
        answers[i] = shadowed ? SpotAnswer::kShadowed : SpotAnswer::kLit;
    }
    return answers;
}

Result<Done> SpotLights::verify(ResidentScene& scene, VerifyReport& report) {
    redraw_.reset(lights_.size());
    const cache::Scene view = scene.view(0, false);
    const cache::GeometryOf geometry = geometryOf(scene);
    for (size_t i = 0; i < lights_.size(); ++i) {
        if (!lights_[i].cache.drawn()) continue;
        const auto planned = lights_[i].cache.planRedraw(view, geometry, i, redraw_);
        if (!planned) return told(nameOf(lights_[i].id), planned.error());
    }
    const auto times = maps_.redraw({}, redraw_);
    if (!times) return times.error();
    report.redraw.spotsMs = times.value().spotsMs;
    report.redraw.recordMs += times.value().recordMs;
    report.redraw.wallMs += times.value().wallMs;
    for (size_t i = 0; i < lights_.size(); ++i) {
        if (!lights_[i].cache.drawn()) continue;
        for (const auto& [cached, redrawn] : {std::pair(gpu::MapKind::kCache, gpu::MapKind::kScratchCache),
                                              std::pair(gpu::MapKind::kWorking, gpu::MapKind::kScratchWorking)})
            if (auto done = compare(i, cached, redrawn, scene, report); !done) return done;
    }
    return Done{};
}

Result<Done> SpotLights::compare(size_t light, gpu::MapKind cached, gpu::MapKind redrawn, const ResidentScene& scene,
                                 VerifyReport& report) {
    auto a = maps_.readSpot(light, cached);
    if (!a) return a.error();
    auto b = maps_.readSpot(light, redrawn);
    if (!b) return b.error();
    const std::vector<float>&held = a.value(), &truth = b.value();
    const culling::SpotSpace& space = lights_[light].cache.space();
    report.texels += held.size();
    for (size_t i = 0; i < held.size(); ++i) {
        if (std::bit_cast<uint32_t>(held[i]) == std::bit_cast<uint32_t>(truth[i])) continue;
        ++report.differing;
        ++report.differingSpots;
        if (report.first.size() == kReported) continue;
        const auto side = static_cast<int64_t>(space.light.side), at = static_cast<int64_t>(i);
        const cache::Texel texel(at % side, at / side);
        // The texel and its neighbours as slopes of the light's frame.
        const auto slopeOf = [&](cache::Texel t) { return (glm::dvec2(t) * 2.0 / double(side) - 1.0) * space.slope; };
        const glm::dvec2 low = slopeOf(texel - int64_t(1)), high = slopeOf(texel + int64_t(2));
        std::vector<std::string> names;
        const world::CasterTable& table = scene.casters();
        for (world::CasterId id = 0; id < table.slots() && names.size() < kReported; ++id)
            if (table[id].state != world::CasterState::kFree &&
                space.touchesWithin(space.toLight(table[id].bounds), low, high))
                names.push_back(table.describe(id));
        report.first.push_back({-1, cached, texel, held[i], truth[i], std::move(names), lights_[light].id});
    }
    return Done{};
}

}  // namespace server
