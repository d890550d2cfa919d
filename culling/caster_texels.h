// culling/caster_texels.h — which texels of one map each caster covers, how deep, and who is nearest the sun there: what a
// map's rasteriser decides, with names.
// Source: edge functions, after Pineda, "A Parallel Algorithm for Polygon Rasterization", 1988.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "culling/light_casters.h"
#include "world/casters.h"

namespace culling {

/// The square of a cascade's lattice that a map shows.
struct MapTexels {
    int cascade = 0;
    glm::i64vec2 low{0};  ///< low corner [lattice texels]
    int side = 1024;      ///< [texels], > 0
};

/// A texel whose centre a caster covers.
struct CasterTexel {
    glm::ivec2 texel{0};  ///< from the map's low corner on
    double depth = 0;     ///< of the caster's surface nearest the sun there, light space [m]
};

/// Those of one static caster at the level that the cascade draws, row by row. In double precision, and corners do not snap:
/// a driver may say otherwise of a centre that an edge passes within 1/512 texel of. None for a caster that is dropped.
std::vector<CasterTexel> texelsOf(const world::CasterTable& table, const LightCasters& light, const MapTexels& map,
                                  world::CasterId caster);

/// Those of the casters that are nearest the sun at one texel or more, ascending; of equally near ones the first by
/// number. Runs on all of TBB's threads and gives the same answer for any number of them.
std::vector<world::CasterId> ownersOf(const world::CasterTable& table, const LightCasters& light, const MapTexels& map,
                                      std::span<const world::CasterId> casters);

}  // namespace culling
