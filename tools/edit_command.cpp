#include "tools/edit_command.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "world/edited_terrain.h"
#include "world/record_text.h"

namespace tools {
namespace {

using world::Result;
using world::TerrainEdit;

struct EditOptions {
    std::string world, edits;
};

std::vector<std::string_view> wordsOf(std::string_view line) {
    std::vector<std::string_view> words;
    for (line = world::trimmed(line); !line.empty(); line = world::trimmed(line)) {
        words.push_back(line.substr(0, line.find_first_of(" \t")));
        line.remove_prefix(words.back().size());
    }
    return words;
}

/// Nothing for words that are no edit.
std::optional<TerrainEdit> editOf(const std::vector<std::string_view>& words) {
    std::vector<double> n;
    for (size_t i = 2; i < words.size(); ++i) {
        const std::optional<double> number = world::finiteNumber(words[i]);
        if (!number) return std::nullopt;
        n.push_back(*number);
    }
    if (words.size() < 2 || (words[0] != "dig" && words[0] != "fill")) return std::nullopt;
    TerrainEdit edit{words[0] == "dig" ? world::EditKind::kDig : world::EditKind::kFill, {}};
    if (words[1] == "sphere" && n.size() == 4) edit.shape = world::Sphere{{n[0], n[1], n[2]}, n[3]};
    else if (words[1] == "box" && n.size() == 6) edit.shape = world::Box{{n[0], n[1], n[2]}, {n[3], n[4], n[5]}};
    else if (words[1] == "capsule" && n.size() == 7)
        edit.shape = world::Capsule{{n[0], n[1], n[2]}, {n[3], n[4], n[5]}, n[6]};
    else return std::nullopt;
    return edit;
}

Result<int> runEdit(const EditOptions& options) {
    auto lines = world::RecordLines::open(options.edits);
    if (!lines) return lines.error();
    auto editor = world::WorldEditor::open(options.world);
    if (!editor) return editor.error();
    const auto store = world::WorldStore::open(options.world);
    if (!store) return store.error();
    world::EditedTerrain terrain(store.value(), &editor.value());
    std::string_view line;
    for (uint64_t number = 1;;) {
        const auto more = lines.value().next(line);
        if (!more) return more.error();
        if (!more.value()) return 0;
        const std::vector<std::string_view> words = wordsOf(line);
        if (words.empty() || words[0].starts_with('#')) continue;
        const auto refuse = [&](world::ErrorCode code, const std::string& what) {
            return world::Error{code, lines.value().error(what).what};
        };
        const std::optional<TerrainEdit> edit = editOf(words);
        if (!edit)
            return refuse(world::ErrorCode::kUsage,
                          "no edit: write dig or fill, then sphere X Y Z RADIUS, box XMIN YMIN ZMIN XMAX YMAX ZMAX or "
                          "capsule X Y Z X Y Z RADIUS [m]");
        const auto changed = terrain.apply(*edit);
        if (!changed) return refuse(changed.error().code, changed.error().what);
        // Whoever reads this may rely on it: the edit is on the disk.
        std::printf("edit %llu: %zu chunks changed\n", static_cast<unsigned long long>(number++), changed.value().size());
        std::fflush(stdout);
    }
}

}  // namespace

Command addEditCommand(CLI::App& app) {
    const auto options = std::make_shared<EditOptions>();
    CLI::App* parser = app.add_subcommand("edit", "Dig into the terrain of a world file, or fill it up");
    parser->add_option("world", options->world, "world file")->required();
    parser
        ->add_option("edits", options->edits,
                     "text file, or /dev/stdin: an edit a line, dig or fill, then sphere X Y Z RADIUS, box XMIN YMIN "
                     "ZMIN XMAX YMAX ZMAX or capsule X Y Z X Y Z RADIUS [m]; each is told when it is on the disk")
        ->required();
    return {parser, [options] { return runEdit(*options); }};
}

}  // namespace tools
