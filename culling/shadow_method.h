// culling/shadow_method.h — what tells one way of keeping sun shadow maps from another: values, no code.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace culling {

/// Where the view's slices end.
/// Source: Zhang et al., "Parallel-Split Shadow Maps for Large-scale Virtual Environments", 2006 (the blend);
/// Engel, "Cascaded Shadow Maps", ShaderX5, 2006 (the ratio).
struct Splits {
    int count = 4;     ///< 1 to kMaxViews
    double ratio = 3;  ///< each slice ends this many times as far as the one before, > 1; 0: by `blend`
    double blend = 1;  ///< from 0, all equally long, to 1, logarithmic between near and far
};

/// How a map lies around what it serves.
enum class Fit : uint8_t {
    kSliceBox,       ///< bounding box of the slice in light space: size and place follow each turn
    kEyeBox,         ///< square around the eye, half an edge as long as the split
    kSliceSphere,    ///< square around the least sphere that holds the slice, whichever way it is turned
    kSplitSphere,    ///< square around a sphere of radius d / sqrt(2) in the middle of the slice's length d
    kSliceDiameter,  ///< square as long as the slice's diameter, around the centre of the slice's box
    kPushedSphere,   ///< square around a sphere, pushed forward while it still holds what the one before left
    kFacets,         ///< one map, in wedges around the eye, each warped away from it
    kWarped,         ///< one map of the whole view, warped along the view (LiSPSM)
};

/// Which depths along the light a map tells apart.
enum class DepthFit : uint8_t {
    kScene,    ///< those of the scene's bounds
    kClipped,  ///< those of the scene's bounds, cut off at the map's four edges
    kMoving,   ///< those of what the map must hold, and before it as far as a ray goes through the scene: a range of
               ///< one length that moves with the map, by whole units of a 16 bit depth
};

/// Which map answers for a point.
enum class Selection : uint8_t {
    kInterval,  ///< that of the slice that the point's distance along the view lies in
    kMap,       ///< the finest that holds the point and its filter
};

/// Against surfaces that shade themselves. All add up.
/// Source: Isidoro, "Shadow Mapping: GPU-based Tips and Techniques", GDC 2006 (the plane).
struct ShadowBias {
    double constant = 0;  ///< [texels] of the map, added to depths when they are drawn
    double slope = 0;     ///< times the depth's slope over a texel, likewise
    double receiver = 0;  ///< [texels] toward the sun, at the point that asks
    double gradient = 0;  ///< likewise: times what the point's own plane falls from corner to corner of a texel
    double gradientMost = 8;  ///< most that `gradient` moves a point by [texels]
    bool plane = false;  ///< a tap is compared with the point's own plane where the tap's texel has its middle
    double normalOffset = 0;  ///< [texels] along the point's normal, times the sine of its angle to the sun
};

enum class Filter : uint8_t {
    kNone,
    kBox2,            ///< 2 x 2 texels, weighted by where the point lies between them
    kBox3,            ///< 3 x 3 texels
    kPoisson,         ///< 8 taps of a Poisson disk
    kPoissonRotated,  ///< the same, turned by an angle of each pixel's own
    kDiskRotated,     ///< 4 taps on a disk, likewise
};

/// What of a map outlives its frame.
enum class Keep : uint8_t {
    kNothing,
    kScrolled,  ///< statics, scrolled by whole texels and whole units of depth
    kCached,    ///< Gnomon's cache
};

struct ShadowMethod {
    std::string name;
    Splits splits{};
    Fit fit = Fit::kEyeBox;
    bool snapped = true;  ///< maps move by whole texels
    DepthFit depth = DepthFit::kScene;
    Selection selection = Selection::kMap;
    int side = 1024;              ///< texels a side of each map
    int depthBits = 32;           ///< 32: float, 16: integer
    bool atlas = false;           ///< all maps in one image, two by two; else an array
    std::vector<double> radii{};  ///< of pushed spheres [m], ascending; empty: such that each reaches its slice's end
    int facets = 8;               ///< 4, 5 or 8
    double facetDetail = 0.05;    ///< S of the facets' warp, as a share of D, in (0, 1]
    double levelError = 0.5;      ///< a map draws the coarsest level of detail that is off by at most so many texels
    bool staticMap = false;       ///< beside the slices' maps, one of all statics over the whole scene, drawn once
    ShadowBias bias{};
    Filter filter = Filter::kNone;
    double blend = 0;  ///< share of a slice, or of a map's half edge, over which it is blended into the next, [0, 1)
    double fade = 0;   ///< share of the way from the eye to the far distance over which shadows fade out, [0, 1)
    Keep keep = Keep::kNothing;
    bool mendedScroll = true;  ///< exposed strips draw all that meets them; else S - S' alone
    int guardBand = 1;         ///< kept windows move in steps of this many texels
    int rays = 4096;           ///< a cache: most rays to prove one cluster hidden; 0: nothing is left out as hidden
};

constexpr int kMaxViews = 8;

}  // namespace culling
