#include "tools/method_file.h"

#include <toml++/toml.h>

#include <algorithm>
#include <charconv>
#include <filesystem>
#include <optional>
#include <sstream>

#include "culling/method_settings.h"
#include "culling/shadow_views.h"

namespace tools {
namespace {

using culling::ShadowMethod;
using world::Error;
using world::ErrorCode;
using world::Result;

std::string toText(double value) {
    char text[32];
    return {text, std::to_chars(text, text + sizeof text, value).ptr};
}

/// As `culling::set` reads it; nothing for a table, a date or what else no setting is.
std::optional<std::string> textOf(const toml::node& node) {
    if (const auto* text = node.as_string()) return text->get();
    if (const auto* flag = node.as_boolean()) return flag->get() ? "yes" : "no";
    if (const auto* whole = node.as_integer()) return std::to_string(whole->get());
    if (const auto* number = node.as_floating_point()) return toText(number->get());
    const auto* list = node.as_array();
    if (!list) return std::nullopt;
    std::string text;
    for (const toml::node& item : *list) {
        const auto one = item.value<double>();
        if (!one) return std::nullopt;
        if (!text.empty()) text += '/';
        text += toText(*one);
    }
    return text;
}

std::string placeOf(const toml::source_region& region) { return "line " + std::to_string(region.begin.line) + ": "; }

/// A setting's value as TOML has it.
std::string tomlOf(const std::string& name, const std::string& value) {
    if (value == "yes") return "true";
    if (value == "no") return "false";
    if (name == "radii") {
        std::string list = value;
        std::replace(list.begin(), list.end(), '/', ',');
        return '[' + list + ']';
    }
    double number = 0;
    const auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), number);
    return error == std::errc() && end == value.data() + value.size() ? value : '"' + value + '"';
}

}  // namespace

Result<ShadowMethod> readMethod(const std::string& path) {
    if (!std::filesystem::is_regular_file(path))
        return Error{ErrorCode::kNotFound, path + ": no such file; give the configuration of a method, or its name"};
    const auto bad = [&](const std::string& what) { return Error{ErrorCode::kUsage, path + ": " + what}; };
    toml::table table;
    try {
        table = toml::parse_file(path);
    } catch (const toml::parse_error& error) {  // the library's shared part has no other way
        return bad(placeOf(error.source()) + std::string(error.description()));
    }
    for (const auto& [key, node] : table)
        if (key != "method" && key != "settings")
            return bad(placeOf(node.source()) + "unknown key '" + std::string(key.str()) + "'; there are method and settings");
    const auto name = table["method"].value<std::string>();
    if (!name) return bad("it names no method; give method = \"gnomon\", or another name");
    auto method = culling::methodNamed(*name);
    if (!method) return bad(method.error().what);
    if (const toml::node* settings = table.get("settings")) {
        if (!settings->is_table()) return bad(placeOf(settings->source()) + "settings is no table; give [settings]");
        for (const auto& [key, node] : *settings->as_table()) {
            const auto value = textOf(node);
            if (!value) return bad(placeOf(node.source()) + std::string(key.str()) + " is no value of a setting");
            if (const auto done = culling::set(method.value(), std::string(key.str()), *value); !done)
                return bad(placeOf(node.source()) + done.error().what);
        }
    }
    if (const auto good = culling::requireMethod(method.value()); !good) return bad(good.error().what);
    method.value().name = std::filesystem::path(path).filename().string();
    return method;
}

std::string methodFileText(const ShadowMethod& method, const std::string& base, const std::string& comment) {
    std::string text;
    std::istringstream lines(comment);
    for (std::string line; std::getline(lines, line);) text += "# " + line + '\n';
    text += "method = \"" + base + "\"\n\n[settings]\n";
    for (const culling::MethodSetting& setting : culling::settingsOf(method))
        text += setting.name + " = " + tomlOf(setting.name, setting.value) + '\n';
    return text;
}

Result<world::Done> apply(const ShadowMethod& method, server::ShadowConfig& config) {
    if (method.keep != culling::Keep::kCached)
        return Error{ErrorCode::kUsage, "method " + method.name + " keeps no cache; give one with keep = \"cached\", such as gnomon"};
    config.cascades = method.splits.count;
    config.splitRatio = method.splits.ratio;
    config.side = method.side;
    config.guardBand = method.guardBand;
    config.levelError = method.levelError;
    config.format = method.depthBits == 16 ? gpu::DepthFormat::kD16 : gpu::DepthFormat::kD32;
    config.occlusion = method.rays > 0;
    config.raysPerCluster = uint32_t(std::max(1, method.rays));
    return world::Done{};
}

Result<ShadowMethod> methodFromWord(const std::string& word) {
    return word.ends_with(".toml") ? readMethod(word) : culling::methodFrom(word);
}

}  // namespace tools
