// cache/statistics.h — what a frame redrew and why: every texel and triangle has exactly one cause.
#pragma once

#include <array>
#include <cstdint>

#include "cache/texel_rect.h"

namespace cache {

/// Why static casters were drawn into a cache map. Regions of one frame are disjoint, so each texel
/// is counted under one cause: the first of this list that applies to it.
enum class Cause : uint8_t {
    kStart,      ///< nothing was there yet
    kSun,        ///< the sun stepped: maps of its new direction begin
    kRebase,     ///< the range of depths moved along the light
    kJump,       ///< the window moved by its width or more
    kScroll,     ///< a slab that the window's move exposed
    kDeparture,  ///< a static caster left with its chunk
    kDemotion,   ///< a static caster moved and became active
    kLevel,      ///< a static caster is drawn in another level of detail
    kEdit,       ///< the ground was dug or filled
    kArrival,    ///< a static caster came with its chunk
    kPromotion,  ///< an active caster came to rest and became static
};
/// Height above its receiver of the caster by which a sun's lag is judged [m]: a house.
constexpr double kSunHeight = 10;

constexpr int kCauses = 11;
const char* toString(Cause cause);

/// Cost of drawing. A caster or draw that several regions of a frame need counts once in each.
struct Cost {
    uint64_t texels = 0;     ///< area of the regions redrawn
    uint64_t casters = 0;    ///< casters with at least one cluster drawn
    uint64_t triangles = 0;  ///< sent to the rasteriser
    uint64_t draws = 0;      ///< runs of clusters: DrawItems
    Cost& operator+=(const Cost& o) {
        texels += o.texels;
        casters += o.casters;
        triangles += o.triangles;
        draws += o.draws;
        return *this;
    }
    friend bool operator==(const Cost&, const Cost&) = default;
};

/// One cascade's share of a frame.
struct CascadeStatistics {
    Texel window{0};  ///< low corner of the committed window
    Texel move{0};    ///< window minus the previous frame's window [texels]; 0 in the first frame
    std::array<Cost, kCauses> byCause{};  ///< static part
    Cost total;       ///< static part, counted on its own as it is drawn: equals the sum of byCause
    Cost active;      ///< working map: texels restored, active casters drawn
    uint64_t clustersFound = 0;   ///< static clusters that the queries returned
    uint64_t clustersHidden = 0;  ///< of these, skipped for a certificate
    uint64_t trianglesHidden = 0; ///< of the skipped clusters
    uint64_t castersDropped = 0;  ///< static ones too small to be drawn, once for each region they meet
    bool asleep = false;          ///< nothing that it serves can be seen: left as it was
    uint64_t unknownTexels = 0;   ///< of the window, after this frame
    uint64_t staleTexels = 0;     ///< of the cache map, likewise
    uint64_t oldestDebt = 0;      ///< frames that the longest owed of them has waited
    uint64_t missingTexels = 0;   ///< of the window, that a chunk which is not there may shade
    uint64_t coarseTexels = 0;    ///< likewise, by a chunk that is there with more error than the cascade allows
    double sunError = 0;  ///< how far the sun's lag moves the shadow of what stands kSunHeight above [texels]

    /// Adds what was drawn for this cascade into other maps than those shown, all of it for one cause.
    void addFor(Cause cause, const CascadeStatistics& other) {
        byCause[size_t(cause)] += other.total;
        total += other.total;
        active += other.active;
        clustersFound += other.clustersFound;
        clustersHidden += other.clustersHidden;
        trianglesHidden += other.trianglesHidden;
        castersDropped += other.castersDropped;
    }
};

}  // namespace cache
