#include "tools/sweep/merge.h"

#include <optional>
#include <utility>
#include <vector>

#include "tools/database_row.h"
#include "tools/results_store.h"
#include "tools/sweep/agreement.h"

namespace tools::sweep {
namespace {

namespace fs = std::filesystem;
using world::Database;
using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

/// The one run of a shard's file.
constexpr int64_t kRun = 1;

Error damaged(const fs::path& file) {
    return {ErrorCode::kBadData, file.string() + ": is damaged; take it away, and give gnomon sweep resume"};
}

/// The file, found whole.
Result<Database> openWhole(const fs::path& file) {
    auto database = openResults(file.string());
    if (!database) return database.error().code == ErrorCode::kBadData ? damaged(file) : database.error();
    auto check = database.value().prepare("PRAGMA quick_check(1)");
    if (!check) return damaged(file);
    const auto row = check.value().step();
    if (!row || check.value().text(0) != "ok") return damaged(file);
    // A last page that was cut short may have lost nothing but room.
    const auto pages = numberFrom(database.value(), "SELECT page_count * page_size FROM pragma_page_count, pragma_page_size");
    const auto head = database.value().head();
    if (!pages || !head || uint64_t(pages.value()) != head.value().size) return damaged(file);
    const auto runs = numberFrom(database.value(), "SELECT count(*) FROM run WHERE id = 1 AND frames = (SELECT count(*) FROM frame WHERE run = 1)");
    if (!runs || runs.value() != 1) return damaged(file);
    return database;
}

Result<Done> requireSame(const Shard& shard, const RunPlace& a, const RunPlace& b) {
    const auto found = difference(a, b);
    if (!found) return found.error();
    if (!found.value()) return Done{};
    return Error{ErrorCode::kBadData, "shard " + shard.key + " (" + shard.label + ") ran twice with different results: " + *found.value() +
                                          "; find out which machine is at fault, and take its file away"};
}

/// The file that shards are merged into.
class Target {
public:
    static Result<Target> open(const std::string& file);
    /// The run of a shard; 0: not there yet.
    Result<int64_t> runOf(const Shard& shard);
    Result<Done> add(const Shard& shard, const fs::path& file);
    RunPlace place(int64_t run) { return {database_, run, file_}; }

private:
    Target(std::string file, Database database) : file_(std::move(file)), database_(std::move(database)) {}
    Result<Done> copy(const Shard& shard);
    std::string file_;
    Database database_;
};

Result<Target> Target::open(const std::string& file) {
    if (const auto made = ResultsStore::open(file); !made) return made.error();
    auto database = Database::openEmpty(file);
    if (!database) return database.error();
    database.value().waitAtMost(kResultsPatienceMs);
    if (const auto done = database.value().run("CREATE TABLE IF NOT EXISTS shard(key TEXT PRIMARY KEY, run INTEGER)"); !done) return done.error();
    return Target(file, std::move(database.value()));
}

Result<int64_t> Target::runOf(const Shard& shard) {
    return numberFrom(database_, ("SELECT run FROM shard WHERE key = '" + shard.key + "'").c_str());
}

Result<Done> Target::copy(const Shard& shard) {
    if (const auto done = database_.run("BEGIN IMMEDIATE"); !done) return done;
    const auto last = numberFrom(database_, "SELECT max(id) FROM run");
    if (!last) return last.error();
    const std::string id = std::to_string(last.value() + 1);
    for (const char* table : {"run", "frame", "cascade", "cause", "caster", "caster_sum", "read", "picture", "method"}) {
        auto names = database_.prepare((std::string("SELECT group_concat(name, ', ') FROM pragma_table_info('") + table + "') WHERE name NOT IN ('id', 'run')").c_str());
        if (!names) return names.error();
        if (const auto row = names.value().step(); !row) return row.error();
        const std::string own = table == std::string("run") ? "id" : "run", columns = names.value().text(0);
        names.value().reset();
        const auto done = database_.run("INSERT INTO main." + std::string(table) + "(" + own + ", " + columns + ") SELECT " + id + ", " + columns +
                                        " FROM shard_file." + table + " WHERE " + own + " = " + std::to_string(kRun));
        if (!done) return done;
    }
    if (const auto done = database_.run("INSERT INTO shard VALUES('" + shard.key + "', " + id + ")"); !done) return done;
    return database_.run("COMMIT");
}

Result<Done> Target::add(const Shard& shard, const fs::path& file) {
    auto attach = database_.prepare("ATTACH ? AS shard_file");
    if (!attach) return attach.error();
    const std::string name = file.string();
    attach.value().bindText(0, name);
    if (const auto done = runOnce(attach.value()); !done) return done;
    const auto copied = copy(shard);
    if (!copied) (void)database_.run("ROLLBACK");  // the error that came first is the one to tell
    const auto detached = database_.run("DETACH shard_file");
    return copied ? detached : copied;
}

/// Whether the shard was new.
Result<bool> mergeShard(const Sweep& sweep, const Shard& shard, Target& target) {
    const std::vector<fs::path> files = sweep.allResults(shard);
    auto first = openWhole(files.front());
    if (!first) return first.error();
    const RunPlace place{first.value(), kRun, files.front().string()};
    for (size_t k = 1; k < files.size(); ++k) {
        auto again = openWhole(files[k]);
        if (!again) return again.error();
        if (const auto same = requireSame(shard, place, {again.value(), kRun, files[k].string()}); !same) return same.error();
    }
    const auto run = target.runOf(shard);
    if (!run) return run.error();
    if (run.value() > 0) {
        if (const auto same = requireSame(shard, target.place(run.value()), place); !same) return same.error();
        return false;
    }
    if (const auto added = target.add(shard, files.front()); !added) return added.error();
    return true;
}

}  // namespace

Result<Merged> merge(const Sweep& sweep, const std::string& file, const std::function<void(size_t, size_t)>& follow) {
    auto target = Target::open(file);
    if (!target) return target.error();
    Merged merged;
    for (size_t k = 0; k < sweep.plan.shards.size(); ++k) {
        follow(k, sweep.plan.shards.size());
        const Shard& shard = sweep.plan.shards[k];
        if (!sweep.done(shard)) continue;
        const auto added = mergeShard(sweep, shard, target.value());
        if (!added) return added.error();
        ++merged.there;
        merged.added += added.value();
    }
    return merged;
}

}  // namespace tools::sweep
