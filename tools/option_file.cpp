#include "tools/option_file.h"

#include <CLI/CLI.hpp>
#include <toml++/toml.h>

#include <filesystem>
#include <sstream>
#include <vector>

#include "culling/nearest_name.h"

namespace tools {

using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

namespace {

/// As it would stand on the command line; empty for what cannot stand there.
std::string wordOf(const toml::node& node) {
    if (const auto* text = node.as_string()) return text->get();
    if (const auto* yes = node.as_boolean()) return yes->get() ? "true" : "false";
    std::ostringstream word;
    word.precision(17);
    if (const auto* whole = node.as_integer()) word << whole->get();
    else if (const auto* real = node.as_floating_point()) word << real->get();
    return word.str();
}

}  // namespace

Result<Done> readOptionFile(CLI::App& parser, const std::string& path) {
    if (!std::filesystem::exists(path)) return Error{ErrorCode::kNotFound, path + ": there is no such file"};
    toml::table table;
    try {
        table = toml::parse_file(path);
    } catch (const toml::parse_error& error) {
        return Error{ErrorCode::kUsage, path + ":" + std::to_string(error.source().begin.line) + ": " + std::string(error.description())};
    }
    for (const auto& [key, node] : table) {
        const std::string name(key.str()), place = path + ":" + std::to_string(node.source().begin.line) + ": ";
        CLI::Option* option = name == "help" || name == "config" ? nullptr : parser.get_option_no_throw("--" + name);
        if (!option) {
            std::vector<std::string> names;
            for (const CLI::Option* known : parser.get_options())
                for (const std::string& longName : known->get_lnames())
                    if (longName != "help" && longName != "config") names.push_back(longName);
            return Error{ErrorCode::kUsage, place + "there is no key '" + name + "'; the nearest is '" + culling::nearestName(name, names) + "'"};
        }
        if (option->count() > 0) continue;
        std::vector<std::string> words;
        if (const auto* list = node.as_array())
            for (const toml::node& item : *list) words.push_back(wordOf(item));
        else words.push_back(wordOf(node));
        try {
            for (const std::string& word : words) option->add_result(word);
            option->run_callback();
        } catch (const CLI::Error& error) {
            return Error{ErrorCode::kUsage, place + error.what()};
        }
    }
    return Done{};
}

}  // namespace tools
