#include "cache/plan_writer.h"

namespace cache {

void splitAtWrap(const Lattice& lattice, const TexelRect& rect, std::vector<Piece>& pieces) {
    if (rect.empty()) return;
    for (int64_t y = rect.min.y; y < rect.max.y;) {
        const int64_t nextY = std::min(rect.max.y, (lattice.quadrant({0, y}).y + 1) * lattice.side);
        for (int64_t x = rect.min.x; x < rect.max.x;) {
            const int64_t nextX = std::min(rect.max.x, (lattice.quadrant({x, 0}).x + 1) * lattice.side);
            const Texel min(x, y), size(nextX - x, nextY - y);
            const glm::ivec2 slot(lattice.slot(min));
            pieces.push_back({{min, {nextX, nextY}}, lattice.quadrant(min), {slot, slot + glm::ivec2(size)}});
            x = nextX;
        }
        y = nextY;
    }
}

PlanWriter::PlanWriter(const Scene& scene, const DepthRange& depth, int cascade, const Lattice& lattice,
                       FramePlan& plan)
    : scene_(scene), depth_(depth), cascade_(cascade), lattice_(lattice), plan_(plan) {}

bool PlanWriter::begin(const Piece& piece, glm::dvec2 min, glm::dvec2 max, world::CasterId caster) {
    const culling::LightCaster& light = scene_.light[caster];
    if (light.bounds.max.x < min.x || light.bounds.min.x > max.x || light.bounds.max.y < min.y ||
        light.bounds.min.y > max.y)
        return false;
    if (!scene_.light.drawn(caster, cascade_)) {
        ++counts_.castersDropped;
        return false;
    }
    const glm::dvec2 low = min - glm::dvec2(light.origin), high = max - glm::dvec2(light.origin);
    low_ = {culling::roundedDown(low.x), culling::roundedDown(low.y)};
    high_ = {culling::roundedUp(high.x), culling::roundedUp(high.y)};
    const auto levelIndex = static_cast<size_t>(scene_.light.level(caster, cascade_));
    caster_ = caster;
    level_ = &scene_.table.meshOf(caster).levels[levelIndex];
    geometry_ = scene_.table.mesh(scene_.table[caster].mesh).geometry[levelIndex];
    CHECK(geometry_ != world::kNoGeometry);
    quadrant_ = piece.quadrant;
    placed_ = false;
    return true;
}

void PlanWriter::add(uint32_t cluster) {
    const world::Cluster& run = level_->clusters[cluster];
    counts_.cost.triangles += run.indexCount / 3;
    if (placed_) {
        DrawItem& last = plan_.items.back();
        if (last.firstIndex + last.indexCount == run.firstIndex) {
            last.indexCount += run.indexCount;
            return;
        }
    } else {
        // From mesh to stored texels in double precision, rounded once: a function of the caster and
        // the quadrant alone, so a texel meets the same numbers whenever it is drawn.
        const culling::LightCaster& light = scene_.light[caster_];
        const double side = double(lattice_.side);
        const double scale = 2 / (side * lattice_.texel);
        glm::mat3x4 rows;
        for (int axis = 0; axis < 2; ++axis) {
            const double shift =
                2 * (light.origin[axis] / lattice_.texel - double(quadrant_[axis]) * side) / side - 1;
            for (int k = 0; k < 3; ++k) rows[axis][k] = static_cast<float>(light.lightFromMesh[k][axis] * scale);
            rows[axis][3] = static_cast<float>(shift);
        }
        for (int k = 0; k < 3; ++k) rows[2][k] = static_cast<float>(light.lightFromMesh[k][2] / depth_.length);
        rows[2][3] = static_cast<float>((light.origin.z - depth_.near) / depth_.length);
        plan_.transforms.push_back(rows);
        plan_.casters.push_back(caster_);
        placed_ = true;
        ++counts_.cost.casters;
    }
    plan_.items.push_back(
        {geometry_, run.firstIndex, run.indexCount, static_cast<uint32_t>(plan_.transforms.size() - 1)});
    ++counts_.cost.draws;
}

PlanWriter::Counts PlanWriter::draw(const Piece& piece, std::span<const world::CasterId> casters, bool hide,
                                    std::vector<DrawPass>& passes) {
    counts_ = {};
    const auto firstItem = static_cast<uint32_t>(plan_.items.size());
    const glm::dvec2 min = lowOf(lattice_, piece.rect), max = highOf(lattice_, piece.rect);
    for (world::CasterId caster : casters) {
        if (!begin(piece, min, max, caster)) continue;
        culling::eachMeeting(scene_.light.rects(caster, cascade_).rows, low_, high_, [&](size_t at) {
            const auto cluster = static_cast<uint32_t>(at);
            ++counts_.clustersFound;
            if (hide && scene_.occlusion->hidden(cascade_, caster, cluster)) {
                ++counts_.clustersHidden;
                counts_.trianglesHidden += level_->clusters[cluster].indexCount / 3;
                return;
            }
            add(cluster);
        });
    }
    const auto items = static_cast<uint32_t>(plan_.items.size()) - firstItem;
    if (items > 0) passes.push_back({piece.store, firstItem, items});
    return counts_;
}

}  // namespace cache
