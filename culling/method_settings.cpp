#include "culling/method_settings.h"

#include <charconv>
#include <span>
#include <sstream>
#include <utility>
#include <variant>

#include "culling/nearest_name.h"
#include "culling/shadow_views.h"

namespace culling {
namespace {

using world::Done;
using world::Result;

template <class Kind>
struct Named {
    Kind kind;
    const char* name;
};

// By kind: what settings are called, in the order of the enumeration.
constexpr Named<Fit> kFits[] = {{Fit::kSliceBox, "slice-box"},       {Fit::kEyeBox, "eye-box"},
                                {Fit::kSliceSphere, "slice-sphere"}, {Fit::kSplitSphere, "split-sphere"},
                                {Fit::kSliceDiameter, "slice-diameter"}, {Fit::kPushedSphere, "pushed-sphere"},
                                {Fit::kFacets, "facets"},            {Fit::kWarped, "warped"}};
constexpr Named<DepthFit> kDepthFits[] = {{DepthFit::kScene, "scene"}, {DepthFit::kClipped, "clipped"}, {DepthFit::kMoving, "moving"}};
constexpr Named<Selection> kSelections[] = {{Selection::kInterval, "interval"}, {Selection::kMap, "map"}};
constexpr Named<Filter> kFilters[] = {{Filter::kNone, "none"},       {Filter::kBox2, "box2"},
                                      {Filter::kBox3, "box3"},       {Filter::kPoisson, "poisson"},
                                      {Filter::kPoissonRotated, "poisson-rotated"}, {Filter::kDiskRotated, "disk-rotated"}};
constexpr Named<Keep> kKeeps[] = {{Keep::kNothing, "nothing"}, {Keep::kScrolled, "scrolled"}, {Keep::kCached, "cached"}};

std::span<const Named<Fit>> namesOf(Fit) { return kFits; }
std::span<const Named<DepthFit>> namesOf(DepthFit) { return kDepthFits; }
std::span<const Named<Selection>> namesOf(Selection) { return kSelections; }
std::span<const Named<Filter>> namesOf(Filter) { return kFilters; }
std::span<const Named<Keep>> namesOf(Keep) { return kKeeps; }

using Field = std::variant<int*, double*, bool*, std::vector<double>*, Fit*, DepthFit*, Selection*, Filter*, Keep*>;

struct NamedField {
    std::string name;
    Field field;
    std::string unit{};
};

std::vector<NamedField> fieldsOf(ShadowMethod& m) {
    return {{"cascades", &m.splits.count},
            {"ratio", &m.splits.ratio},
            {"split-blend", &m.splits.blend},
            {"fit", &m.fit},
            {"snapped", &m.snapped},
            {"depths", &m.depth},
            {"selection", &m.selection},
            {"side", &m.side, "texels"},
            {"depth-bits", &m.depthBits, "bits"},
            {"atlas", &m.atlas},
            {"radii", &m.radii, "m"},
            {"facets", &m.facets},
            {"facet-detail", &m.facetDetail, "of the reach"},
            {"level-error", &m.levelError, "texels"},
            {"static-map", &m.staticMap},
            {"bias-constant", &m.bias.constant, "texels"},
            {"bias-slope", &m.bias.slope},
            {"bias-receiver", &m.bias.receiver, "texels"},
            {"bias-gradient", &m.bias.gradient},
            {"bias-gradient-most", &m.bias.gradientMost, "texels"},
            {"bias-plane", &m.bias.plane},
            {"bias-normal", &m.bias.normalOffset, "texels"},
            {"filter", &m.filter},
            {"blend", &m.blend},
            {"fade", &m.fade},
            {"keep", &m.keep},
            {"mended-scroll", &m.mendedScroll},
            {"guard-band", &m.guardBand, "texels"},
            {"rays", &m.rays, "a cluster"}};
}

std::string toText(int value) { return std::to_string(value); }
std::string toText(bool value) { return value ? "yes" : "no"; }
std::string toText(double value) {
    char text[32];
    return {text, std::to_chars(text, text + sizeof text, value).ptr};
}
std::string toText(const std::vector<double>& values) {
    std::string text;
    for (const double value : values) {
        if (!text.empty()) text += '/';
        text += toText(value);
    }
    return text;
}
template <class Kind>
    requires std::is_enum_v<Kind>
std::string toText(Kind value) {
    return namesOf(value)[size_t(value)].name;
}

/// Each gives what was expected, or nothing when it was there.
template <class Number>
    requires std::is_arithmetic_v<Number>
std::string read(const std::string& text, Number& value) {
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    return error == std::errc() && end == text.data() + text.size() ? "" : std::is_same_v<Number, int> ? "a whole number" : "a number";
}
std::string read(const std::string& text, bool& value) {
    value = text == "yes";
    return value || text == "no" ? "" : "yes or no";
}
std::string read(const std::string& text, std::vector<double>& values) {
    values.clear();
    std::istringstream list(text);
    for (std::string item; std::getline(list, item, '/');)
        if (!read(item, values.emplace_back()).empty()) return "numbers with / between them";
    return "";
}
template <class Kind>
    requires std::is_enum_v<Kind>
std::string read(const std::string& text, Kind& value) {
    std::string names;
    for (const Named<Kind>& named : namesOf(value)) {
        if (text == named.name) {
            value = named.kind;
            return "";
        }
        if (!names.empty()) names += ", ";
        names += named.name;
    }
    return "one of " + names;
}

world::Error usage(std::string what) { return {world::ErrorCode::kUsage, std::move(what)}; }

}  // namespace

std::vector<MethodSetting> settingsOf(const ShadowMethod& method) {
    ShadowMethod copy = method;
    std::vector<MethodSetting> settings;
    for (const NamedField& f : fieldsOf(copy))
        settings.push_back({f.name, std::visit([](const auto* value) { return toText(*value); }, f.field), f.unit});
    return settings;
}

Result<Done> set(ShadowMethod& method, const std::string& name, const std::string& value) {
    ShadowMethod changed = method;
    std::vector<std::string> names;
    for (const NamedField& f : fieldsOf(changed)) {
        names.push_back(f.name);
        if (f.name != name) continue;
        if (const std::string wanted = std::visit([&](auto* into) { return read(value, *into); }, f.field); !wanted.empty())
            return usage("method " + method.name + ": " + name + "=" + value + "; give " + wanted);
        method = std::move(changed);
        return Done{};
    }
    return usage("method " + method.name + ": there is no setting '" + name + "'; the nearest is " + nearestName(name, names));
}

Result<ShadowMethod> methodFrom(const std::string& text) {
    std::istringstream parts(text);
    std::string part;
    std::getline(parts, part, ':');
    auto method = methodNamed(part);
    if (!method) return method.error();
    while (std::getline(parts, part, ':')) {
        const size_t equals = part.find('=');
        if (equals == std::string::npos) return usage("method " + text + ": '" + part + "' sets nothing; give SETTING=VALUE");
        if (const auto done = set(method.value(), part.substr(0, equals), part.substr(equals + 1)); !done) return done.error();
    }
    method.value().name = text;
    if (const auto good = requireMethod(method.value()); !good) return good.error();
    return method;
}

}  // namespace culling
