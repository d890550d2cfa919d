// The methods that have names, and what makes values of one work together.
#include <algorithm>
#include <cmath>

#include "culling/nearest_name.h"
#include "culling/shadow_views.h"

namespace culling {
namespace {

world::Error usage(std::string what) { return {world::ErrorCode::kUsage, std::move(what)}; }

/// Source: Engel, "Cascaded Shadow Maps", ShaderX5, 2006. He gives no numbers for the biases.
ShadowMethod engel() {
    ShadowMethod method{.name = "engel"};
    method.fit = Fit::kSliceBox;
    method.snapped = false;
    method.selection = Selection::kInterval;
    method.atlas = true;
    method.bias = {.constant = 0.5, .slope = 1.5};
    method.filter = Filter::kBox2;
    method.fade = 0.1;
    return method;
}

/// Source: chetanjags, "Real-Time shadows: Cascaded Shadow Maps", 2015; the blend's weight is that of Zhang et al., 2006.
/// The offset is what 8 taps on a disk of 1.5 texels ask, and half a texel's diagonal.
ShadowMethod practical() {
    ShadowMethod method{.name = "practical"};
    method.splits = {.ratio = 0, .blend = 0.5};
    method.fit = Fit::kSplitSphere;
    method.depth = DepthFit::kClipped;
    method.bias = {.constant = 0.1, .normalOffset = 2.25};
    method.filter = Filter::kPoissonRotated;
    method.blend = 0.1;
    method.staticMap = true;
    return method;
}

/// Source: Blow, "Graphics Tech: Shadow Maps (part 1)", 2010: his system of 2004; the bias is the one he gives.
ShadowMethod doughnut() {
    ShadowMethod method{.name = "doughnut"};
    method.bias.receiver = 0.7;
    return method;
}

/// Source: Valient, "Stable Rendering of Cascaded Shadow Maps", ShaderX6, 2008, as Blow tells it.
ShadowMethod valient() {
    ShadowMethod method = doughnut();
    method.name = "valient";
    method.fit = Fit::kSliceSphere;
    method.selection = Selection::kInterval;
    method.atlas = true;
    return method;
}

/// What methods of one map share: as many texels as four maps of 1024 have.
ShadowMethod oneMap(std::string name) {
    ShadowMethod method{.name = std::move(name)};
    method.splits.count = 1;
    method.snapped = false;
    method.side = 2048;
    return method;
}

/// Source: Tran, "Facetted Shadow Mapping for Large Dynamic Game Environments", 2009, which is silent on bias and on
/// S. Texels are up to hundreds of times as long as the shortest: only a bias that looks at the point's own plane
/// fits all of them: 2 texels for a tap 1.4 from the point and half a texel, and 1.4 times that since a neighbouring
/// facet's texels may be so much longer along its F.
ShadowMethod facetted(std::string name, int facets) {
    ShadowMethod method = oneMap(std::move(name));
    method.fit = Fit::kFacets;
    method.facets = facets;
    method.bias = {.receiver = 0.1, .gradient = 2.8};
    method.filter = Filter::kDiskRotated;
    return method;
}

/// Source: Day, "CSM Scrolling", 2012, which is silent on bias and filters. Its maps have 512 texels a
/// side; here all methods have as many texels.
ShadowMethod scroll() {
    ShadowMethod method{.name = "scroll"};
    method.fit = Fit::kSliceDiameter;
    method.depth = DepthFit::kMoving;
    method.selection = Selection::kInterval;
    method.depthBits = 16;
    method.bias.receiver = 1.5;
    method.keep = Keep::kScrolled;
    return method;
}

/// Gnomon's own. The bias covers half a texel of the level's error, which a slope makes longer along the light. A point flips where cascades change only if the eye goes half of what is blended in one
/// frame: a fifth of the finest cascade's reach.
ShadowMethod gnomon() {
    ShadowMethod method{.name = "gnomon"};
    method.bias = {.receiver = 0.5, .gradient = 0.3, .gradientMost = 16, .plane = true};
    method.filter = Filter::kBox2;
    method.blend = 0.4;
    method.keep = Keep::kCached;
    method.guardBand = 4;
    return method;
}

template <class Change>
ShadowMethod with(ShadowMethod method, std::string name, Change change) {
    method.name = std::move(name);
    change(method);
    return method;
}

}  // namespace

std::vector<ShadowMethod> namedMethods() {
    const auto box3 = [](ShadowMethod& m) { m.filter = Filter::kBox3; };
    const auto gradient = [](ShadowMethod& m) { m.bias = {.receiver = 0.1, .gradient = 1.5}; };
    const auto interval = [](ShadowMethod& m) {  // its own fit leaves corners of its slice to the next map
        m.fit = Fit::kSliceSphere;
        m.selection = Selection::kInterval;
    };
    const auto eyeBox = [](ShadowMethod& m) { m.fit = Fit::kEyeBox; };
    const auto sphere = [](ShadowMethod& m) { m.fit = Fit::kSliceSphere; };
    const auto pushed = [](ShadowMethod& m) {
        m.fit = Fit::kPushedSphere;
        m.selection = Selection::kMap;
    };
    const auto warped = [](ShadowMethod& m) {
        m.fit = Fit::kWarped;
        m.selection = Selection::kInterval;
        m.bias = {.receiver = 0.1, .gradient = 1.5};
        m.filter = Filter::kBox2;
    };
    const auto plain = [](ShadowMethod& m) {
        m.fit = Fit::kSliceBox;
        m.selection = Selection::kInterval;
        m.bias = engel().bias;
        m.filter = Filter::kBox2;
    };
    const auto literal = [](ShadowMethod& m) { m.mendedScroll = false; };
    return {engel(),
            with(engel(), "engel-box3", box3),
            with(engel(), "engel-gradient", gradient),
            practical(),
            with(practical(), "practical-interval", interval),
            with(practical(), "practical-box", eyeBox),
            with(practical(), "practical-sphere", sphere),
            doughnut(),
            valient(),
            with(valient(), "pushed-spheres", pushed),
            facetted("facetted", 8),
            facetted("facetted-4", 4),
            facetted("facetted-5", 5),
            facetted("facetted-8", 8),
            with(oneMap(""), "lispsm", warped),
            with(oneMap(""), "single", plain),
            scroll(),
            with(scroll(), "scroll-literal", literal),
            gnomon()};
}

world::Result<ShadowMethod> methodNamed(const std::string& name) {
    std::vector<std::string> names;
    for (ShadowMethod& method : namedMethods()) {
        if (method.name == name) return std::move(method);
        names.push_back(method.name);
    }
    return usage("method " + name + ": there is none of this name; the nearest is " + nearestName(name, names));
}

world::Result<world::Done> requireMethod(const ShadowMethod& m) {
    const auto bad = [&](const std::string& what, const std::string& give) {
        return usage("method " + m.name + ": " + what + "; give " + give);
    };
    const auto text = [](double value) { return std::to_string(value); };
    const auto share = [](double value) { return value >= 0 && value < 1; };  // false for NaN, like all below
    const auto upTo = [](double value, double most) { return value >= 0 && value <= most; };

    const int most = m.staticMap ? kMaxViews - 1 : kMaxViews;
    if (m.splits.count < 1 || m.splits.count > most)
        return bad("cascades: " + std::to_string(m.splits.count), "1 to " + std::to_string(most));
    if (m.splits.ratio != 0 && !(m.splits.ratio > 1 && m.splits.ratio <= 16))
        return bad("split ratio: " + text(m.splits.ratio), "more than 1, at most 16, or 0 for the blend");
    if (!upTo(m.splits.blend, 1)) return bad("blend of splits: " + text(m.splits.blend), "0 to 1");
    if (m.side < 64 || m.side > 8192) return bad("side: " + std::to_string(m.side), "64 to 8192 texels");
    if (m.depthBits != 16 && m.depthBits != 32)
        return bad("bits of depth: " + std::to_string(m.depthBits), "16 or 32");
    if (m.guardBand < 1 || m.guardBand > m.side / 4)
        return bad("guard band: " + std::to_string(m.guardBand), "1 to a quarter of the side");
    if (m.rays < 0 || m.rays > 1 << 20) return bad("rays: " + std::to_string(m.rays), "0 to 1048576");
    if (!upTo(m.levelError, 1e6)) return bad("error of levels: " + text(m.levelError), "0 to 1000000 texels");
    for (const double bias :
         {m.bias.constant, m.bias.slope, m.bias.receiver, m.bias.gradient, m.bias.gradientMost, m.bias.normalOffset})
        if (!upTo(bias, 1000)) return bad("a bias of " + text(bias), "0 to 1000");
    if (!share(m.blend)) return bad("blend: " + text(m.blend), "0 to less than 1");
    if (!share(m.fade)) return bad("fade: " + text(m.fade), "0 to less than 1");

    if (m.fit == Fit::kFacets && m.facets != 4 && m.facets != 5 && m.facets != 8)
        return bad("facets: " + std::to_string(m.facets), "4, 5 or 8");
    if (!(m.facetDetail > 0 && m.facetDetail <= 1))
        return bad("facet detail: " + text(m.facetDetail), "more than 0, at most 1");
    if (!m.radii.empty()) {
        if (m.fit != Fit::kPushedSphere || m.radii.size() != size_t(m.splits.count))
            return bad("radii: " + std::to_string(m.radii.size()),
                       "one for each cascade, and only with pushed spheres");
        double least = 0;
        for (const double radius : m.radii) {
            if (!(std::isfinite(radius) && radius > least))
                return bad("radius: " + text(radius) + " m", "positive ones, ascending");
            least = radius;
        }
    }

    const bool warped = m.fit == Fit::kFacets || m.fit == Fit::kWarped;
    if (warped && m.splits.count != 1) return bad("several cascades of a warped map", "1");
    if (warped && m.depth != DepthFit::kScene) return bad("depths of a warped map", "those of the scene");
    if (m.fit == Fit::kFacets && m.facets == kMaxViews && m.staticMap)
        return bad("a static map beside 8 facets", "fewer facets, or no static map");
    if (m.snapped && (warped || m.fit == Fit::kSliceBox))
        return bad("snapped, with texels that change their size as the camera turns or lie askew",
                   "another fit, or no snapping");
    if (m.keep != Keep::kNothing && !m.snapped)
        return bad("kept, but not snapped: texels that have moved are no longer true",
                   "snapped maps, or keep nothing");
    if (m.keep != Keep::kNothing && m.depth == DepthFit::kClipped)
        return bad("kept, but with depths that follow each move", "depths of the scene, or a moving range");
    if (m.keep == Keep::kCached && m.depth == DepthFit::kMoving)
        return bad("a cache of maps whose depths move", "depths of the scene");
    return world::Done{};
}

}  // namespace culling
