// world/contour.cpp — see contour.h.
#include "world/contour.h"

#include <openvdb/Grid.h>
#include <openvdb/tools/VolumeToMesh.h>
#include <tbb/task_arena.h>

#include <cmath>

namespace world {
namespace {

/// OpenVDB's usual tree with nodes of 8^3 children under its root, not 32^3: a chunk fills one, and making, copying
/// and clearing its pointers is what small grids cost. The order of leaves stays, up to kMaxBandSide samples aside.
template <class Value>
using Tree = typename openvdb::tree::Tree4<Value, 3, 4, 3>::Type;
using FloatGrid = openvdb::Grid<Tree<float>>;
using BoolGrid = openvdb::Grid<Tree<bool>>;

}  // namespace

Columns columnsOf(const Band& band, int32_t side) {
    const int n = band.count.x;
    // Cell centres reach from -2 to side + 2 voxels.
    const int first = 1 + (band.step == 1 ? 1 : 0);
    const int last = band.step == 1 ? side + kBandMargin + 1 : (side + kBandMargin + 1) / 2;
    Columns out;
    out.shown.assign(static_cast<size_t>(n * n), 0);
    out.rim.assign(static_cast<size_t>(n * n), 0);
    for (int x = first; x <= last; ++x) {
        for (int z = first; z <= last; ++z) {
            bool known = true;
            for (int i = x - 1; i <= x + 1; ++i) {
                for (int k = z - 1; k <= z + 1; ++k) known &= !std::isnan(band.at(i, 0, k));
            }
            out.shown[static_cast<size_t>(x * n + z)] = known;
        }
    }
    for (int x = first - 1; x <= last; ++x) {
        for (int z = first - 1; z <= last; ++z) {
            const bool edge = x <= first || x >= last || z <= first || z >= last;
            out.rim[static_cast<size_t>(x * n + z)] = edge;
        }
    }
    return out;
}

MeshLevel contour(const Band& band, const Columns& columns, float adaptivity, double voxel) {
    FloatGrid grid(kBandVoxels);
    grid.setGridClass(openvdb::GRID_LEVEL_SET);
    const BoolGrid::Ptr mask = BoolGrid::create(false);
    const BoolGrid::TreePtrType rim(new BoolGrid::TreeType(false));
    for (int x = 0; x < band.count.x; x += kLeafSide) {
        for (int y = 0; y < band.count.y; y += kLeafSide) {
            for (int z = 0; z < band.count.z; z += kLeafSide) {
                // Leaves everywhere near the surface, tiles of the right sign elsewhere: no face may
                // appear where the band ends. Box sides that are no multiple of a leaf are air, which
                // the mask hides.
                bool air = false, solid = false;
                const glm::ivec3 from = glm::max(glm::ivec3(x, y, z) - 1, 0);
                const glm::ivec3 to = glm::min(glm::ivec3(x, y, z) + kLeafSide + 1, band.count);
                for (int i = from.x; i < to.x; ++i) {
                    for (int j = from.y; j < to.y; ++j) {
                        for (int k = from.z; k < to.z; ++k) (band.at(i, j, k) <= 0 ? solid : air) = true;
                    }
                }
                const openvdb::Coord origin(x, band.bottom + y, z);
                if (!(air && solid)) {
                    grid.tree().addTile(1, origin, solid ? -float(kBandVoxels) : float(kBandVoxels), false);
                    continue;
                }
                auto* leaf = grid.tree().touchLeaf(origin);
                auto* maskLeaf = mask->tree().touchLeaf(origin);
                auto* rimLeaf = rim->touchLeaf(origin);
                leaf->setValuesOn();
                for (int i = 0; i < kLeafSamples; ++i) {
                    const int sx = x + (i >> 6), sy = y + ((i >> 3) & 7), sz = z + (i & 7);
                    if (sx >= band.count.x || sy >= band.count.y || sz >= band.count.z) continue;
                    const float v = band.at(sx, sy, sz);
                    const auto offset = static_cast<openvdb::Index>(i);
                    leaf->setValueOnly(offset, std::isnan(v) ? float(kBandVoxels) : v);
                    const auto column = static_cast<size_t>(sx * band.count.z + sz);
                    if (columns.shown[column]) maskLeaf->setActiveState(offset, true);
                    if (columns.rim[column]) rimLeaf->setActiveState(offset, true);
                }
            }
        }
    }

    openvdb::tools::VolumeToMesh mesher(0, adaptivity);
    mesher.setSurfaceMask(mask);
    mesher.setAdaptivityMask(rim);
    // One thread: chunks are made side by side already, and the order of faces is then always the same.
    tbb::task_arena alone(1);
    alone.execute([&] { mesher(grid); });

    MeshLevel level;
    const float scale = float(band.step) * float(voxel);
    const glm::vec3 shift = band.low * float(voxel);
    level.positions.reserve(mesher.pointListSize());
    for (size_t i = 0; i < mesher.pointListSize(); ++i) {
        const openvdb::Vec3s& p = mesher.pointList()[i];
        level.positions.push_back(glm::vec3(p.x(), p.y(), p.z()) * scale + shift);
    }
    // The mesher's faces are clockwise seen from the air.
    const auto add = [&](uint32_t a, uint32_t b, uint32_t c) {
        if (a != b && b != c && c != a) level.indices.insert(level.indices.end(), {a, c, b});
    };
    for (size_t n = 0; n < mesher.polygonPoolListSize(); ++n) {
        const openvdb::tools::PolygonPool& pool = mesher.polygonPoolList()[n];
        for (size_t i = 0; i < pool.numTriangles(); ++i) {
            const openvdb::Vec3I& t = pool.triangle(i);
            add(t[0], t[1], t[2]);
        }
        for (size_t i = 0; i < pool.numQuads(); ++i) {
            const openvdb::Vec4I& q = pool.quad(i);
            const auto& p = level.positions;
            const glm::vec3 d02 = p[q[2]] - p[q[0]], d13 = p[q[3]] - p[q[1]];
            if (glm::dot(d02, d02) <= glm::dot(d13, d13)) {
                add(q[0], q[1], q[2]);
                add(q[0], q[2], q[3]);
            } else {
                add(q[0], q[1], q[3]);
                add(q[1], q[2], q[3]);
            }
        }
    }
    return level;
}

}  // namespace world
