#include "tools/lab/method_fields.h"

#include <charconv>

namespace tools::lab {
namespace {

using namespace culling;

/// The shortest text that reads back as the same number.
std::string text(double value) {
    char buffer[32];
    return {buffer, std::to_chars(buffer, buffer + sizeof buffer, value).ptr};
}
std::string text(int value) { return std::to_string(value); }
std::string text(bool value) { return value ? "yes" : "no"; }
std::string text(const std::vector<double>& values) {
    std::string list;
    for (const double value : values) list += (list.empty() ? "" : ", ") + text(value);
    return list.empty() ? "none given" : list;
}
std::string text(Fit fit) {
    switch (fit) {
        case Fit::kSliceBox: return "box around the slice";
        case Fit::kEyeBox: return "square around the eye";
        case Fit::kSliceSphere: return "sphere around the slice";
        case Fit::kSplitSphere: return "sphere in the slice's length";
        case Fit::kSliceDiameter: return "square of the slice's diameter";
        case Fit::kPushedSphere: return "sphere pushed forward";
        case Fit::kFacets: return "facets around the eye";
        case Fit::kWarped: return "warped along the view";
    }
    return "";
}
std::string text(DepthFit depth) {
    switch (depth) {
        case DepthFit::kScene: return "the scene's";
        case DepthFit::kClipped: return "the scene's, cut off at the map";
        case DepthFit::kMoving: return "move with the map";
    }
    return "";
}
std::string text(Selection selection) { return selection == Selection::kMap ? "finest map that holds it" : "slice it lies in"; }
std::string text(Filter filter) {
    switch (filter) {
        case Filter::kNone: return "none";
        case Filter::kBox2: return "2 x 2 box";
        case Filter::kBox3: return "3 x 3 box";
        case Filter::kPoisson: return "8 taps, Poisson disk";
        case Filter::kPoissonRotated: return "8 taps, Poisson disk, rotated";
        case Filter::kDiskRotated: return "4 taps on a disk, rotated";
    }
    return "";
}
std::string text(Keep keep) {
    switch (keep) {
        case Keep::kNothing: return "nothing";
        case Keep::kScrolled: return "statics, scrolled";
        case Keep::kCached: return "Gnomon's cache";
    }
    return "";
}

}  // namespace

std::vector<MethodField> fieldsOf(const ShadowMethod& method) {
    // Binds every member: one that is added does not compile until it is told here.
    const auto& [name, splits, fit, snapped, depth, selection, side, depthBits, atlas, radii, facets, facetDetail,
                 levelError, staticMap, bias, filter, blend, fade, keep, mendedScroll, guardBand] = method;
    const auto& [count, ratio, weight] = splits;
    const auto& [constant, slope, receiver, gradient, gradientMost, normalOffset] = bias;
    return {{"cascades", text(count), ""},
            {"split ratio", text(ratio), ""},
            {"split blend", text(weight), ""},
            {"fit", text(fit), ""},
            {"snapped to texels", text(snapped), ""},
            {"depths", text(depth), ""},
            {"selection", text(selection), ""},
            {"map side", text(side), "texels"},
            {"depth", text(depthBits), "bits"},
            {"atlas", text(atlas), ""},
            {"sphere radii", text(radii), radii.empty() ? "" : "m"},
            {"facets", text(facets), ""},
            {"facet detail", text(facetDetail), ""},
            {"error of levels", text(levelError), "texels"},
            {"map of all statics", text(staticMap), ""},
            {"constant bias", text(constant), "texels"},
            {"slope bias", text(slope), ""},
            {"receiver bias", text(receiver), "texels"},
            {"gradient bias", text(gradient), ""},
            {"gradient bias, most", text(gradientMost), "texels"},
            {"normal offset", text(normalOffset), "texels"},
            {"filter", text(filter), ""},
            {"blended share", text(blend), ""},
            {"fading share", text(fade), ""},
            {"kept", text(keep), ""},
            {"scroll mended", text(mendedScroll), ""},
            {"guard band", text(guardBand), "texels"}};
}

}  // namespace tools::lab
