#include "tools/sweep/plan.h"

#include <CLI/CLI.hpp>
#include <toml++/toml.h>

#include <algorithm>
#include <charconv>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "culling/method_settings.h"
#include "culling/nearest_name.h"
#include "tools/input_hash.h"
#include "tools/method_file.h"
#include "tools/options.h"
#include "tools/replay.h"
#include "tools/replay_command.h"
#include "world/movers.h"
#include "world/path.h"
#include "world/store.h"

namespace tools::sweep {
namespace {

namespace fs = std::filesystem;
using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

/// Options of a replay that a sweep gives itself, or that belong to a path's table.
const std::set<std::string> kNotSettings = {"help", "path", "movers", "frames", "fps", "out", "results", "dump", "dump-frames",
                                            "threads", "worlds", "compare"};
/// What a site may want of sbatch without coming in the way of the array.
const std::vector<std::string> kSbatch = {"account", "comment", "constraint", "cpus-per-task", "exclude", "licenses", "mem", "mem-per-cpu",
                                          "nice", "nodelist", "partition", "qos", "reservation", "throttle", "time"};

using Words = std::vector<std::string>;  ///< of a command line

struct WorldEntry {
    std::string word, file, hash;
};
struct PathEntry {
    std::string file, movers, hash, moversHash;
    Words worlds;   ///< as the plan spells them; empty: all
    Words options;  ///< fps and frames
    uint64_t first = 0;                ///< frame
    int line = 0;
};
struct SettingsEntry {
    Words options;
    int line = 0;
};

/// A value as it would stand on the command line; none for tables, dates and lists.
std::optional<std::string> wordOf(const toml::node& node) {
    char text[32];
    if (const auto* string = node.as_string()) return string->get();
    if (const auto* yes = node.as_boolean()) return yes->get() ? "true" : "false";
    if (const auto* whole = node.as_integer()) return std::to_string(whole->get());
    if (const auto* real = node.as_floating_point()) return std::string(text, std::to_chars(text, text + sizeof text, real->get()).ptr);
    return std::nullopt;
}

class Reader {
public:
    explicit Reader(const std::string& file) : file_(file), folder_(fs::absolute(file).parent_path()), replay_(addReplayCommand(app_).parser) {
        for (const CLI::Option* option : replay_->get_options())
            for (const std::string& name : option->get_lnames())
                if (!kNotSettings.contains(name)) settingNames_.push_back(name);
    }
    Result<Plan> read();

private:
    int lineOf(const toml::node& node) const { return int(node.source().begin.line); }
    Error bad(int line, const std::string& what, ErrorCode code = ErrorCode::kUsage) const {
        return {code, file_ + ":" + std::to_string(line) + ": " + what};
    }
    Error unknown(const toml::node& node, const std::string& key, const std::vector<std::string>& names) const {
        return bad(lineOf(node), "there is no key '" + key + "' here; the nearest is '" + culling::nearestName(key, names) + "'");
    }
    std::string absolute(const std::string& word) const { return fs::absolute(folder_ / word).lexically_normal().string(); }
    Result<std::string> text(const toml::node& node, const std::string& key) const {
        const auto value = node.value<std::string>();
        if (!value || value->empty()) return bad(lineOf(node), key + ": give a text, as in " + key + " = \"...\"");
        return *value;
    }
    Result<Words> texts(const toml::node& node, const std::string& key) const;
    Result<Done> readWorlds(const toml::node& node);
    Result<PathEntry> readPath(const toml::table& table) const;
    Result<Done> loadPath(PathEntry& path, double fps, const std::string& frames) const;
    Result<Done> readSettings(const toml::table& table);
    Result<std::vector<Words>> alternatives(const std::string& key, const toml::node& node) const;
    Result<std::string> canonical(const std::string& key, const toml::node& node) const;
    Result<Done> tryOptions(const SettingsEntry& settings) const;
    Result<Done> readSlurm(const toml::node& node);
    Result<Done> eachTable(const toml::node& node, const std::string& key, const std::function<Result<Done>(const toml::table&)>& take) const;
    Result<Done> combine();

    std::string file_;
    fs::path folder_;
    CLI::App app_;
    CLI::App* replay_;
    std::vector<std::string> settingNames_;
    std::vector<WorldEntry> worlds_;
    std::vector<PathEntry> paths_;
    std::vector<SettingsEntry> settings_;
    Plan plan_;
};

Result<Words> Reader::texts(const toml::node& node, const std::string& key) const {
    const auto* list = node.as_array();
    if (!list || list->empty()) return bad(lineOf(node), key + ": give a list of texts, as in " + key + " = [\"...\"]");
    Words words;
    for (const toml::node& item : *list) {
        const auto word = text(item, key);
        if (!word) return word.error();
        words.push_back(word.value());
    }
    return words;
}

Result<Done> Reader::eachTable(const toml::node& node, const std::string& key,
                               const std::function<Result<Done>(const toml::table&)>& take) const {
    const auto* list = node.as_array();
    if (!list || list->empty()) return bad(lineOf(node), key + " is no list of tables; give [[" + key + "]]");
    for (const toml::node& item : *list) {
        if (!item.is_table()) return bad(lineOf(item), key + " is no list of tables; give [[" + key + "]]");
        if (const auto done = take(*item.as_table()); !done) return done;
    }
    return Done{};
}

Result<Done> Reader::readWorlds(const toml::node& node) {
    const auto words = texts(node, "worlds");
    if (!words) return words.error();
    for (const std::string& word : words.value()) {
        const std::string file = absolute(word);
        const auto store = world::WorldStore::open(file);
        if (!store) return bad(lineOf(node), store.error().what, store.error().code);
        const auto hash = store.value().contentHash();
        if (!hash) return bad(lineOf(node), hash.error().what, hash.error().code);
        worlds_.push_back({word, file, hexOf(hash.value())});
    }
    return Done{};
}

Result<PathEntry> Reader::readPath(const toml::table& table) const {
    PathEntry path;
    path.line = lineOf(table);
    double fps = 0;
    std::string frames;
    for (const auto& [name, node] : table) {
        const std::string key(name.str());
        if (key == "fps") {
            const auto value = node.value<double>();
            if (!value || !(*value > 0)) return bad(lineOf(node), "fps: give a number above 0");
            fps = *value;
            path.options.push_back("--fps=" + *wordOf(node));
        } else if (key == "worlds") {
            auto words = texts(node, key);
            if (!words) return words.error();
            path.worlds = std::move(words.value());
            for (const std::string& word : path.worlds)
                if (std::none_of(worlds_.begin(), worlds_.end(), [&](const WorldEntry& w) { return w.word == word; }))
                    return bad(lineOf(node), "worlds: '" + word + "' is none of the plan's worlds; name it there, too");
        } else if (key == "file" || key == "movers" || key == "frames") {
            const auto word = text(node, key);
            if (!word) return word.error();
            if (key == "frames") path.options.push_back("--frames=" + word.value()), frames = word.value();
            else (key == "file" ? path.file : path.movers) = absolute(word.value());
        } else {
            return unknown(node, key, {"file", "movers", "worlds", "fps", "frames"});
        }
    }
    if (path.file.empty()) return bad(path.line, "this path has no file; give file = \"NAME.tum\"");
    if (const auto done = loadPath(path, fps, frames); !done) return bad(path.line, done.error().what, done.error().code);
    return path;
}

Result<Done> Reader::loadPath(PathEntry& path, double fps, const std::string& frames) const {
    std::optional<FrameRange> range;
    if (!frames.empty()) {
        const auto parsed = parseFrameRange(frames);
        if (!parsed) return parsed.error();
        range = parsed.value();
        path.first = range->begin;
    }
    const auto recorded = world::readTum(path.file);
    if (!recorded) return recorded.error();
    const auto poses = replayPoses(recorded.value(), fps, range);
    if (!poses) return poses.error();
    path.hash = hexOf(hashPoses(poses.value(), 0));
    if (path.movers.empty()) return Done{};
    const auto tracks = world::readMovers(path.movers);
    if (!tracks) return tracks.error();
    path.moversHash = hexOf(hashMovers(tracks.value(), 0));
    return Done{};
}

/// A method file becomes its settings: a shard needs no file but world, path and movers.
Result<std::string> Reader::canonical(const std::string& key, const toml::node& node) const {
    const auto word = wordOf(node);
    if (!word) return bad(lineOf(node), key + ": this is no value of an option");
    if (key == "clock" && *word == "live") return bad(lineOf(node), "clock: live differs from run to run, and shards must not; give lockstep or virtual");
    if (key == "budget-ms") return bad(lineOf(node), "budget-ms: differs from run to run, and shards must not; give budget-texels or budget-triangles");
    if (key != "config") return *word;
    const auto method = methodFromWord(word->ends_with(".toml") ? absolute(*word) : *word);
    if (!method) return bad(lineOf(node), method.error().what, method.error().code);
    server::ShadowConfig config;
    if (const auto good = apply(method.value(), config); !good) return bad(lineOf(node), good.error().what);
    std::string text = "gnomon";
    for (const culling::MethodSetting& setting : culling::settingsOf(method.value())) text += ":" + setting.name + "=" + setting.value;
    return text;
}

/// What each value of a key gives on the command line. A list is of values to try; a list in it, an option that is given
/// several times.
Result<std::vector<Words>> Reader::alternatives(const std::string& key, const toml::node& node) const {
    std::vector<Words> found;
    const auto take = [&](const toml::node& value) -> Result<Done> {
        Words words;
        const auto one = [&](const toml::node& item) -> Result<Done> {
            const auto word = canonical(key, item);
            if (!word) return word.error();
            words.push_back("--" + key + "=" + word.value());
            return Done{};
        };
        const auto* several = value.as_array();
        if (!several)
            if (const auto done = one(value); !done) return done;
        if (several)
            for (const toml::node& item : *several)
                if (const auto done = one(item); !done) return done;
        if (words.empty()) return bad(lineOf(value), key + ": this list is empty; give a value, or leave the key out");
        found.push_back(std::move(words));
        return Done{};
    };
    if (const auto* list = node.as_array()) {
        if (list->empty()) return bad(lineOf(node), key + ": this list is empty; give a value, or leave the key out");
        for (const toml::node& value : *list)
            if (const auto done = take(value); !done) return done.error();
    } else if (const auto done = take(node); !done) {
        return done.error();
    }
    return found;
}

/// Whether a replay would take them, each by itself and together.
Result<Done> Reader::tryOptions(const SettingsEntry& settings) const {
    Words words = {"gnomon", "replay", "NAME.world", "--path=NAME.tum"};
    words.insert(words.end(), settings.options.begin(), settings.options.end());
    std::vector<const char*> arguments;
    for (const std::string& word : words) arguments.push_back(word.c_str());
    CLI::App app;
    (void)addReplayCommand(app);
    try {
        app.parse(int(arguments.size()), arguments.data());
    } catch (const CLI::Error& error) {
        return bad(settings.line, error.what());
    }
    return Done{};
}

Result<Done> Reader::readSettings(const toml::table& table) {
    std::vector<SettingsEntry> made{{{}, lineOf(table)}};
    // By name: TOML knows no order of keys, and how a plan spells its settings changes no key of a shard.
    for (const auto& [name, node] : table) {
        const std::string key(name.str());
        const auto* option = kNotSettings.contains(key) ? nullptr : replay_->get_option_no_throw("--" + key);
        if (!option) return unknown(node, key, settingNames_);
        const auto values = alternatives(key, node);
        if (!values) return values.error();
        std::vector<SettingsEntry> grown;
        if (made.size() * values.value().size() > kMostShards)
            return bad(lineOf(node), "these settings make more than " + std::to_string(kMostShards) + " shards; make several sweeps of them");
        for (const SettingsEntry& before : made)
            for (const Words& value : values.value()) {
                SettingsEntry& entry = grown.emplace_back(before);
                entry.options.insert(entry.options.end(), value.begin(), value.end());
            }
        // Each value once by itself: then the line to name is its own.
        for (const Words& value : values.value())
            if (const auto good = tryOptions({value, lineOf(node)}); !good) return good;
        made = std::move(grown);
    }
    if (const auto good = tryOptions(made.front()); !good) return good;
    settings_.insert(settings_.end(), made.begin(), made.end());
    return Done{};
}

Result<Done> Reader::readSlurm(const toml::node& node) {
    if (!node.is_table()) return bad(lineOf(node), "slurm is no table; give [slurm]");
    for (const auto& [name, value] : *node.as_table()) {
        const std::string key(name.str());
        if (std::find(kSbatch.begin(), kSbatch.end(), key) == kSbatch.end()) return unknown(value, key, kSbatch);
        const auto word = wordOf(value);
        if (!word) return bad(lineOf(value), key + ": this is no value of an option");
        if (key != "throttle") {
            plan_.sbatch.push_back("--" + key + "=" + *word);
            continue;
        }
        const auto count = value.value_exact<int64_t>();
        if (!count || *count < 1 || *count > int64_t(kMostShards)) return bad(lineOf(value), "throttle: give a whole number from 1: tasks at a time");
        plan_.throttle = int(*count);
    }
    return Done{};
}

Result<Done> Reader::combine() {
    size_t combinations = 0;
    for (const PathEntry& path : paths_) combinations += (path.worlds.empty() ? worlds_.size() : path.worlds.size()) * settings_.size();
    if (combinations > kMostShards)
        return bad(1, "this plan makes " + std::to_string(combinations) + " shards, more than " + std::to_string(kMostShards) + "; make several sweeps of it");
    std::map<std::string, std::pair<int, int>> lines;  // of path and settings, by key
    for (const WorldEntry& w : worlds_)
        for (const PathEntry& path : paths_) {
            if (!path.worlds.empty() && std::find(path.worlds.begin(), path.worlds.end(), w.word) == path.worlds.end()) continue;
            for (const SettingsEntry& settings : settings_) {
                Shard shard;
                shard.world = w.file, shard.path = path.file, shard.movers = path.movers;
                shard.worldHash = w.hash, shard.pathHash = path.hash, shard.moversHash = path.moversHash;
                shard.options = path.options;
                shard.label = fs::path(w.file).filename().string() + " " + fs::path(path.file).filename().string();
                uint64_t key = hashText("shard 1", path.first);
                for (const std::string* hash : {&w.hash, &path.hash, &path.moversHash}) key = hashText(*hash, key);
                for (const std::string& option : path.options) shard.label += " " + option;
                for (const std::string& option : settings.options) {
                    key = hashText(option, key);
                    shard.options.push_back(option);
                    shard.label += " " + option;
                }
                shard.key = hexOf(key);
                const auto [at, fresh] = lines.emplace(shard.key, std::pair(path.line, settings.line));
                if (!fresh)
                    return bad(settings.line, shard.label + ": asked for twice, with the path of line " + std::to_string(path.line) +
                                                  " and before by lines " + std::to_string(at->second.first) + " and " +
                                                  std::to_string(at->second.second) + "; leave one out");
                plan_.shards.push_back(std::move(shard));
            }
        }
    return Done{};
}

Result<Plan> Reader::read() {
    std::error_code ignored;
    if (!fs::is_regular_file(file_, ignored)) return Error{ErrorCode::kNotFound, file_ + ": there is no such plan; docs/cluster.md has one to begin with"};
    toml::table table;
    try {
        table = toml::parse_file(file_);
    } catch (const toml::parse_error& error) {
        return bad(int(error.source().begin.line), std::string(error.description()));
    }
    for (const auto& [name, node] : table)
        if (const std::string key(name.str()); key != "worlds" && key != "path" && key != "settings" && key != "slurm")
            return unknown(node, key, {"worlds", "path", "settings", "slurm"});
    const toml::node *worlds = table.get("worlds"), *paths = table.get("path"), *settings = table.get("settings"), *slurm = table.get("slurm");
    if (!worlds) return bad(1, "the plan names no world; give worlds = [\"NAME.world\"]");
    if (!paths) return bad(1, "the plan names no path; give [[path]] with file = \"NAME.tum\"");
    if (settings)
        if (const auto done = eachTable(*settings, "settings", [&](const toml::table& t) { return readSettings(t); }); !done) return done.error();
    if (!settings) settings_.push_back({{}, 1});
    if (slurm)
        if (const auto done = readSlurm(*slurm); !done) return done.error();
    if (const auto done = readWorlds(*worlds); !done) return done.error();
    const auto done = eachTable(*paths, "path", [&](const toml::table& t) -> Result<Done> {
        auto path = readPath(t);
        if (!path) return path.error();
        paths_.push_back(std::move(path.value()));
        return Done{};
    });
    if (!done) return done.error();
    if (const auto combined = combine(); !combined) return combined.error();
    return std::move(plan_);
}

}  // namespace

Result<Plan> readPlan(const std::string& file) { return Reader(file).read(); }

}  // namespace tools::sweep
