// culling/light_casters.h — casters as the sun sees them: placed in light space, with the level of
// detail that each cascade draws and the map-plane rectangle of every cluster.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <vector>

#include "culling/cascades.h"
#include "culling/light_space.h"
#include "culling/rect_rows.h"
#include "world/casters.h"

namespace culling {

constexpr int kMaxCascades = 8;

/// How much of a caster a cascade draws. Texels do not follow the camera, so neither do levels: nothing switches
/// while the camera moves.
struct Detail {
    double levelError = 0.5;    ///< the coarsest level whose error is at most so many texels is drawn, > 0
    double smallestTexels = 0;  ///< a caster whose bounds span less on both axes of the map is dropped; 0 keeps all
};

/// Bounds of a cluster in the map plane [m], relative to its caster's light-space origin.
struct ClusterRect {
    glm::vec2 min{0}, max{0};
};

/// Those of all clusters of one level; valid until the caster is placed again.
struct ClusterRects {
    RectRows rows;
    size_t size() const { return rows.count; }
    bool empty() const { return rows.count == 0; }
    ClusterRect operator[](size_t k) const {
        return {{rows.minX[k], rows.minY[k]}, {rows.maxX[k], rows.maxY[k]}};
    }
};

struct LightCaster {
    glm::dmat3 lightFromMesh{1};  ///< linear part
    glm::dvec3 origin{0};         ///< light-space place of the mesh's own origin [m]
    world::Box bounds;            ///< light space [m], over all levels in use
    std::array<uint8_t, kMaxCascades> level{};  ///< drawn in each cascade
    uint32_t dropped = 0;  ///< bit c: too small to be drawn in cascade c
    /// Per level in use: minX, minY, maxX, maxY of its clusters, one after the other.
    std::vector<float> rects;
    std::array<uint32_t, kMaxCascades> firstRect{}, rectCount{};  ///< into `rects`, of each cascade's level
};

/// Follows a CasterTable, by the same ids. One writer; readers may run side by side.
class LightCasters {
public:
    /// What is dropped from a cascade is not drawn there, and proof of nothing.
    LightCasters(const LightSpace& space, std::vector<Cascade> cascades, const Detail& detail = {});

    const LightSpace& space() const { return space_; }
    const std::vector<Cascade>& cascades() const { return cascades_; }

    /// Room for ids below `slots`: after it, calls for different ids may run side by side.
    void reserve(size_t slots) { casters_.resize(std::max(casters_.size(), slots)); }
    /// Fits cluster rectangles to the vertices: dear, for casters that stay.
    void addStatic(world::CasterId id, const world::CasterTable& table);
    /// Bounds clusters by their turned boxes: cheap and wider, for casters that move.
    void addActive(world::CasterId id, const world::CasterTable& table);
    /// Keeps nothing of the caster, which was added or lies below `reserve`: its bounds are empty.
    void remove(world::CasterId id) { casters_[id] = {}; }

    const LightCaster& operator[](world::CasterId id) const { return casters_[id]; }
    int level(world::CasterId id, int cascade) const {
        return casters_[id].level[static_cast<size_t>(cascade)];
    }
    bool drawn(world::CasterId id, int cascade) const { return (casters_[id].dropped >> cascade & 1) == 0; }
    /// None where the caster is dropped.
    ClusterRects rects(world::CasterId id, int cascade) const {
        if (!drawn(id, cascade)) return {};
        const LightCaster& caster = casters_[id];
        const size_t count = caster.rectCount[static_cast<size_t>(cascade)];
        const float* first = caster.rects.data() + caster.firstRect[static_cast<size_t>(cascade)];
        return {{first, first + count, first + 2 * count, first + 3 * count, count}};
    }

private:
    LightCaster& place(world::CasterId id, const world::CasterTable& table);
    void drop(LightCaster& caster) const;
    /// `bounds(level, cluster)`: box of a cluster relative to the caster's origin.
    template <class Bounds>
    void fit(LightCaster& caster, const world::Mesh& mesh, Bounds bounds) const;
    LightSpace space_;
    Detail detail_;
    std::vector<Cascade> cascades_;
    std::vector<LightCaster> casters_;
};

}  // namespace culling
