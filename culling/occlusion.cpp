#include "culling/occlusion.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "culling/coverage.h"

namespace culling {

namespace {

/// Candidates tried along one ray: the surface right above is often the cluster's own rim or an
/// edge too near the texel's centre, the next one often proves.
constexpr int kCandidates = 4;
constexpr int kProbe = 4;  ///< a probe of kProbe x kProbe spread rays rejects most clusters
constexpr size_t kBatch = 256;

/// Depths nearer to each other than this share of the range are not told apart: a float depth in
/// [0, 1] and the arithmetic behind it are good to about 2^-22.
constexpr double kDepthShare = 1.0 / (1 << 20);

/// Room for positions computed in single precision, per texel of reach.
constexpr double kFloatShare = 1.0 / (1 << 21);

PlacedTriangle placed(const LightCaster& caster, const world::MeshLevel& level, uint32_t triangle, double texel) {
    PlacedTriangle t;
    for (size_t k = 0; k < 3; ++k) {
        const glm::vec3& p = level.positions[level.indices[3 * triangle + k]];
        const glm::dvec3 pLight = caster.lightFromMesh * glm::dvec3(p) + caster.origin;
        t[k] = {pLight.x / texel, pLight.y / texel, pLight.z};
    }
    return t;
}

/// Texels that the caster's corners can lie away from a map's origin.
double reach(const LightCaster& caster, double texel, int side) {
    return glm::length(caster.bounds.extent()) / texel + side;
}

}  // namespace

world::Result<std::unique_ptr<Occlusion>> Occlusion::create(const world::CasterTable& table,
                                                           const LightCasters& light,
                                                           const OcclusionConfig& config) {
    auto scenes = TraceScenes::create(table, light, config.anchor);
    if (!scenes) return scenes.error();
    return std::unique_ptr<Occlusion>(new Occlusion(table, light, config, std::move(scenes.value())));
}

Occlusion::Occlusion(const world::CasterTable& table, const LightCasters& light, const OcclusionConfig& config,
                     std::unique_ptr<TraceScenes> scenes)
    : table_(table), light_(light), config_(config), scenes_(std::move(scenes)) {}

Occlusion::~Occlusion() = default;

void Occlusion::forgetMesh(world::MeshSlot slot) { scenes_->forgetMesh(slot); }

size_t Occlusion::remove(std::span<const world::CasterId> casters) {
    for (world::CasterId id : casters) {
        scenes_->remove(id);
        if (id < ownedBy_.size())
            while (!ownedBy_[id].empty()) kill(ownedBy_[id].back());
    }
    size_t revoked = 0;
    for (world::CasterId id : casters) {
        if (id >= provenBy_.size()) continue;
        if (config_.sticky) provenBy_[id].clear();
        for (; !provenBy_[id].empty(); ++revoked) kill(provenBy_[id].back());
    }
    return revoked;
}

void Occlusion::issue(Certificate certificate) {
    uint32_t at = static_cast<uint32_t>(certificates_.size());
    if (free_.empty()) {
        certificates_.emplace_back();
    } else {
        at = free_.back();
        free_.pop_back();
    }
    const size_t slots = std::max<size_t>(certificate.caster, certificate.occluders.back()) + 1;
    if (bits_.size() < slots) {
        bits_.resize(slots);
        provenBy_.resize(slots);
        ownedBy_.resize(slots);
    }
    auto& bits = bits_[certificate.caster][static_cast<size_t>(certificate.cascade)];
    if (bits.empty()) bits.resize(light_.rects(certificate.caster, certificate.cascade).size(), 0);
    bits[certificate.cluster] = 1;
    ownedBy_[certificate.caster].push_back(at);
    for (world::CasterId occluder : certificate.occluders) provenBy_[occluder].push_back(at);
    certificates_[at] = std::move(certificate);
    certificates_[at].alive = true;
    ++live_;
}

void Occlusion::kill(uint32_t certificate) {
    Certificate& c = certificates_[certificate];
    CHECK(c.alive);
    auto& bits = bits_[c.caster][static_cast<size_t>(c.cascade)];
    bits[c.cluster] = 0;
    if (std::find(bits.begin(), bits.end(), 1) == bits.end()) bits.clear();
    std::erase(ownedBy_[c.caster], certificate);
    for (world::CasterId occluder : c.occluders) std::erase(provenBy_[occluder], certificate);
    c = {};
    free_.push_back(certificate);
    --live_;
}

bool Occlusion::prove(SunRay& ray, int cascade, double nearest, uint64_t& rays) const {
    const double texel = light_.cascades()[static_cast<size_t>(cascade)].texel;
    const glm::dvec2 p = glm::dvec2(ray.origin) / texel;
    for (int candidate = 0;; ++candidate) {
        if (!ray.hit) return false;
        const LightCaster& caster = light_[ray.caster];
        const world::MeshLevel& level =
            table_.meshOf(ray.caster).levels[static_cast<size_t>(light_.level(ray.caster, cascade))];
        const double margin = kSnapTexels + reach(caster, texel, config_.side) * kFloatShare;
        const auto depth = coveredDepth(
            placed(caster, level, ray.triangle, texel), p, margin,
            [&](int edge) {
                std::optional<PlacedTriangle> across;
                acrossEdge(level, ray.triangle, edge, [&](uint32_t other) {
                    across = placed(caster, level, other, texel);
                    return true;
                });
                return across;
            });
        if (depth && *depth < nearest - config_.depthRange * kDepthShare) return true;
        if (candidate + 1 == kCandidates) return false;
        // Single precision: step past the surface just met by a little more than its rounding.
        ray.skip = ray.distance * (1 + 1e-6) + 1e-4;
        scenes_->trace(cascade, std::span(&ray, 1));
        ++rays;
    }
}

Occlusion::Attempt Occlusion::attempt(world::CasterId caster, int cascade) const {
    Attempt result;
    const LightCaster& own = light_[caster];
    const world::MeshLevel& level = table_.meshOf(caster).levels[static_cast<size_t>(light_.level(caster, cascade))];
    const ClusterRects rects = light_.rects(caster, cascade);
    const double texel = light_.cascades()[static_cast<size_t>(cascade)].texel;
    const double margin = kSnapTexels + reach(own, texel, config_.side) * kFloatShare;
    std::vector<SunRay> rays;
    for (uint32_t cluster = 0; cluster < rects.size(); ++cluster) {
        // The footprint, grown by one texel; its texels' centres get a ray each.
        const glm::dvec2 origin(own.origin);
        const glm::i64vec2 low =
            glm::i64vec2(glm::floor((origin + glm::dvec2(rects[cluster].min)) / texel)) - glm::i64vec2(1);
        const glm::i64vec2 high =
            glm::i64vec2(glm::floor((origin + glm::dvec2(rects[cluster].max)) / texel)) + glm::i64vec2(2);
        const int64_t width = high.x - low.x, height = high.y - low.y;
        if (width > config_.raysPerCluster || height > config_.raysPerCluster ||
            width * height > config_.raysPerCluster)
            continue;
        ++result.costs.clustersTested;

        double nearest = std::numeric_limits<double>::infinity();
        const world::Cluster& run = level.clusters[cluster];
        for (uint32_t t = run.firstIndex / 3; t < (run.firstIndex + run.indexCount) / 3; ++t) {
            const PlacedTriangle triangle = placed(own, level, t, texel);
            const double z = std::min({triangle[0].z, triangle[1].z, triangle[2].z});
            nearest = std::min(nearest, z - depthSlope(triangle) * margin);
        }
        nearest -= config_.depthRange * kDepthShare;
        if (!std::isfinite(nearest)) continue;

        Certificate certificate{cascade, caster, cluster, {}, false};
        const auto rayAt = [&](int64_t x, int64_t y) {
            SunRay ray;
            ray.origin = {(double(low.x + x) + 0.5) * texel, (double(low.y + y) + 0.5) * texel, nearest};
            return ray;
        };
        const auto allProven = [&] {
            scenes_->trace(cascade, rays);
            result.costs.rays += rays.size();
            for (SunRay& ray : rays) {
                if (!prove(ray, cascade, nearest, result.costs.rays)) return false;
                if (certificate.occluders.empty() || certificate.occluders.back() != ray.caster)
                    certificate.occluders.push_back(ray.caster);
            }
            return true;
        };
        rays.clear();
        for (int64_t k = 0; k < kProbe * kProbe; ++k)
            rays.push_back(rayAt(width * (2 * (k % kProbe) + 1) / (2 * kProbe), height * (2 * (k / kProbe) + 1) / (2 * kProbe)));
        bool hidden = allProven();
        rays.clear();
        for (int64_t k = 0; hidden && k < width * height; ++k) {
            rays.push_back(rayAt(k % width, k / width));
            if (rays.size() == kBatch || k + 1 == width * height) {
                hidden = allProven();
                rays.clear();
            }
        }
        if (!hidden) continue;
        auto& occluders = certificate.occluders;
        std::sort(occluders.begin(), occluders.end());
        occluders.erase(std::unique(occluders.begin(), occluders.end()), occluders.end());
        result.proven.push_back(std::move(certificate));
        ++result.costs.certificates;
    }
    return result;
}

CertifyCosts Occlusion::admit(int cascade, std::span<const world::CasterId> casters) {
    const std::vector<world::CasterId> fresh = scenes_->add(cascade, casters);
    if (fresh.empty()) return {};
    scenes_->commit(cascade);
    std::vector<Attempt> attempts(fresh.size());
    tbb::parallel_for(tbb::blocked_range<size_t>(0, attempts.size()), [&](const tbb::blocked_range<size_t>& range) {
        for (size_t i = range.begin(); i != range.end(); ++i) attempts[i] = attempt(fresh[i], cascade);
    });
    // Issued in one order whatever thread found them.
    CertifyCosts costs;
    for (Attempt& a : attempts) {
        costs += a.costs;
        for (Certificate& c : a.proven) issue(std::move(c));
    }
    return costs;
}

}  // namespace culling
