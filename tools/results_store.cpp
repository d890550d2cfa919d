#include "tools/results_store.h"

#include <cerrno>
#include <charconv>
#include <filesystem>
#include <fstream>
#include <limits>
#include <system_error>
#include <utility>

#include "tools/database_row.h"
#include "tools/input_hash.h"

namespace tools {
namespace {

using world::Database;
using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;
using world::Statement;

constexpr size_t kFramesATime = 256;  ///< between commits of the temporary tables

constexpr const char* kRunTable =
    "CREATE TABLE run(id INTEGER PRIMARY KEY, key TEXT, kind TEXT, name TEXT, verdict TEXT, world TEXT, world_hash TEXT, "
    "source TEXT, chunk_m REAL, path TEXT, path_hash TEXT, movers TEXT, movers_hash TEXT, settings TEXT, frames INTEGER, "
    "device TEXT, driver TEXT, machine TEXT, threads INTEGER, program TEXT, summary TEXT, t_started TEXT, t_wall_s REAL);"
    "CREATE INDEX run_by_key ON run(key);";

struct Table {
    std::string name, columns, key;  ///< without `run`
};

std::string listed(const std::vector<ResultColumn>& columns) {
    std::string list;
    for (const ResultColumn& c : columns) list += ", " + c.column.name + (c.text ? " TEXT" : " NUMERIC");
    return list;
}

std::vector<Table> tables(const ResultColumns& columns) {
    return {{"frame", "frame INTEGER, eye_x REAL, eye_y REAL, eye_z REAL" + listed(columns.frame), "frame"},
            {"cascade", "frame INTEGER, cascade INTEGER" + listed(columns.cascade), "frame, cascade"},
            {"cause", "frame INTEGER, cascade INTEGER, cause TEXT, texels INTEGER, casters INTEGER, triangles INTEGER, draws INTEGER",
             "frame, cascade, cause"},
            {"caster", "frame INTEGER, number INTEGER, name TEXT, x REAL, y REAL, z REAL, triangles INTEGER, draws INTEGER",
             "frame, number"},
            {"caster_sum", "name TEXT, x REAL, y REAL, z REAL, frames INTEGER, triangles INTEGER, draws INTEGER", "name, x, y, z"},
            {"read", "frame INTEGER, number INTEGER, name TEXT, bytes INTEGER, t_thread INTEGER, t_begin_ms REAL, t_ms REAL", "frame, number"},
            {"picture", "frame INTEGER, cascade INTEGER, png BLOB", "frame, cascade"},
            {"method", "number INTEGER, name TEXT, frames INTEGER, judged INTEGER, triangles REAL, texels REAL, draws REAL, false_lit REAL, "
                       "false_shadow REAL, flips REAL, t_ms REAL, t_shading_ms REAL",
             "number"}};
}

std::string placeholders(size_t count) {
    std::string marks = "?";
    for (size_t k = 1; k < count; ++k) marks += ", ?";
    return marks;
}

/// A cell of frames.csv as the number or text that it is; NULL where it is empty. `cell` must stay until the next reset.
void bindCell(Statement& statement, int at, const std::string& cell, bool text) {
    if (cell.empty()) return statement.bindReal(at, std::numeric_limits<double>::quiet_NaN());
    if (text) return statement.bindText(at, cell);
    const char *begin = cell.data(), *end = begin + cell.size();
    int64_t whole = 0;
    if (std::from_chars(begin, end, whole).ptr == end) return statement.bind(at, whole);
    double real = 0;
    std::from_chars(begin, end, real);
    statement.bindReal(at, real);
}

Error foreign(const std::string& file) {
    return {ErrorCode::kBadData, file + ": holds no results of gnomon, or is damaged; give another file, or take it away"};
}

/// SQLite's errors speak of worlds.
Error toldOf(const std::string& file, Error error) { return error.code == ErrorCode::kBadData ? foreign(file) : error; }

/// Whether the file is a results file of this version: true, or false for an empty one.
Result<bool> isOurs(Database& database, const std::string& file) {
    const auto id = numberFrom(database, "PRAGMA application_id"), version = numberFrom(database, "PRAGMA user_version");
    const auto schema = database.schema();
    for (const auto* failed : {&id, &version})
        if (!*failed) return toldOf(file, failed->error());
    if (!schema) return toldOf(file, schema.error());
    if (schema.value().empty() && id.value() == 0) return false;
    if (id.value() != kResultsId) return foreign(file);
    if (version.value() != kResultsVersion)
        return Error{ErrorCode::kBadData,
                     file + ": was written by another version of gnomon (results of version " + std::to_string(version.value()) +
                         ", this program reads " + std::to_string(kResultsVersion) + "); use that one, or give another file"};
    return true;
}

/// Made or recognised under a lock: two processes may find it empty.
Result<Done> prepare(Database& database, const std::string& file) {
    if (const auto done = database.run("BEGIN IMMEDIATE"); !done) return toldOf(file, done.error());
    const auto ours = isOurs(database, file);
    if (!ours) return ours.error();
    if (!ours.value()) {
        std::string sql = kRunTable;
        for (const Table& t : tables(resultColumns()))
            sql += "CREATE TABLE " + t.name + "(run INTEGER, " + t.columns + ", PRIMARY KEY(run, " + t.key + ")) WITHOUT ROWID;";
        sql += "PRAGMA application_id=" + std::to_string(kResultsId) + ";PRAGMA user_version=" + std::to_string(kResultsVersion);
        if (const auto made = database.run(sql); !made) return toldOf(file, made.error());
    }
    if (const auto done = database.run("COMMIT"); !done) return toldOf(file, done.error());
    return Done{};
}

}  // namespace

Error ResultsStore::told(Error error) const { return toldOf(file_, std::move(error)); }

Result<ResultsStore> ResultsStore::open(const std::string& file) {
    std::error_code ignored;
    const bool there = std::filesystem::exists(file, ignored);
    if (std::filesystem::is_directory(file, ignored))
        return Error{ErrorCode::kIo, file + ": is a folder; give a file for --results"};
    if (!there && !std::ofstream(file, std::ios::app))
        return Error{ErrorCode::kIo, file + ": cannot be made; give --results a file in a folder that can be written, with room", errno};
    auto opened = Database::openEmpty(file);
    if (!opened) return toldOf(file, opened.error());
    ResultsStore store(file, std::move(opened.value()));
    // With a rollback journal and no write-ahead log: what is copied or read where nothing can be written is one file.
    store.database_.waitAtMost(kResultsPatienceMs);
    if (const auto done = prepare(store.database_, file); !done) return done.error();
    if (const auto done = store.stage(); !done) return store.told(done.error());
    return store;
}

Result<Done> ResultsStore::stage() {
    std::string sql = "PRAGMA temp_store=FILE; PRAGMA temp.journal_mode=OFF; PRAGMA temp.synchronous=OFF;";
    for (const Table& t : tables(columns_))
        sql += "CREATE TEMP TABLE new_" + t.name + "(" + t.columns + ", PRIMARY KEY(" + t.key + ")) WITHOUT ROWID;";
    if (const auto done = database_.run(sql); !done) return done.error();
    const auto into = [&](const std::string& table, size_t columns) {
        return database_.prepare(("INSERT INTO temp.new_" + table + " VALUES(" + placeholders(columns) + ")").c_str());
    };
    auto frame = into("frame", 4 + columns_.frame.size()), cascade = into("cascade", 2 + columns_.cascade.size()),
         cause = into("cause", 7), caster = into("caster", 8), read = into("read", 7), picture = into("picture", 3), method = into("method", 12);
    auto sum = database_.prepare("INSERT INTO temp.new_caster_sum VALUES(?, ?, ?, ?, 1, ?, ?) ON CONFLICT(name, x, y, z) DO UPDATE SET "
                                 "frames = frames + 1, triangles = triangles + excluded.triangles, draws = draws + excluded.draws");
    for (const auto* statement : {&frame, &cascade, &cause, &caster, &sum, &read, &picture, &method})
        if (!*statement) return statement->error();
    inserts_.emplace(Inserts{std::move(frame.value()), std::move(cascade.value()), std::move(cause.value()),
                             std::move(caster.value()), std::move(sum.value()), std::move(read.value()), std::move(picture.value()), std::move(method.value())});
    return Done{};
}

Result<Done> ResultsStore::add(const ReplayFrame& frame) {
    Result<Done> done = Done{};
    if (pending_ == 0) done = database_.run("BEGIN");
    if (done) done = write(frame);
    if (done && ++pending_ == kFramesATime) {
        pending_ = 0;
        done = database_.run("COMMIT");
    }
    if (done || done.error().code != ErrorCode::kIo) return done;
    return Error{ErrorCode::kIo, done.error().what + "; until the run ends its rows lie in SQLITE_TMPDIR, else in /var/tmp",
                 done.error().native};
}

Result<Done> ResultsStore::write(const ReplayFrame& frame) {
    const auto cells = [&](Statement& statement, int at, const std::vector<ResultColumn>& columns, size_t cascade) {
        std::vector<std::string> texts;  // must stay until the reset
        texts.reserve(columns.size());
        for (const ResultColumn& c : columns) {
            texts.emplace_back();
            c.column.value(frame, cascade, texts.back());
            bindCell(statement, at++, texts.back(), c.text);
        }
        return runOnce(statement);
    };
    Row eye(inserts_->frame);
    eye.put(frame.number);
    for (int k = 0; k < 3; ++k) eye.put(frame.eye[k]);
    if (const auto done = cells(inserts_->frame, 4, columns_.frame, 0); !done) return done;
    for (size_t c = 0; c < frame.report.cascades.size(); ++c) {
        Row key(inserts_->cascade);
        key.put(frame.number);
        key.put(uint64_t(c));
        if (const auto done = cells(inserts_->cascade, 2, columns_.cascade, c); !done) return done;
        for (size_t k = 0; k < cache::kCauses; ++k) {
            const cache::Cost& cost = frame.report.cascades[c].byCause[k];
            if (cost == cache::Cost{}) continue;
            const std::string name = cache::toString(cache::Cause(k));
            Row row(inserts_->cause);
            row.put(frame.number);
            row.put(uint64_t(c));
            row.put(name);
            for (const uint64_t value : {cost.texels, cost.casters, cost.triangles, cost.draws}) row.put(value);
            if (const auto done = runOnce(inserts_->cause); !done) return done;
        }
    }
    for (size_t k = 0; k < frame.dearest.size(); ++k) {
        const server::CasterCost& caster = frame.dearest[k];
        const auto put = [&](Statement& statement, Row row) {
            row.put(caster.name);
            for (int axis = 0; axis < 3; ++axis) row.put(caster.pWorld[axis]);
            row.put(caster.triangles);
            row.put(caster.draws);
            return runOnce(statement);
        };
        if (const auto done = put(inserts_->sum, Row(inserts_->sum)); !done) return done;
        if (k >= kDearest) continue;
        Row row(inserts_->caster);
        row.put(frame.number);
        row.put(uint64_t(k));
        if (const auto done = put(inserts_->caster, row); !done) return done;
    }
    for (size_t k = 0; k < frame.report.reads.size(); ++k) {
        const world::ReadSpan& read = frame.report.reads[k];
        const std::string name = read.mesh ? "mesh " + std::to_string(*read.mesh) : "chunk " + world::toString(read.chunk);
        Row row(inserts_->read);
        row.put(frame.number);
        row.put(uint64_t(k));
        row.put(name);
        row.put(read.bytes);
        row.put(uint64_t(read.times.thread));
        row.put(clockMs(read.times.begin));
        row.put(clockMs(read.times.end) - clockMs(read.times.begin));
        if (const auto done = runOnce(inserts_->read); !done) return done;
    }
    return Done{};
}

Result<Done> ResultsStore::add(const DumpedPicture& picture) {
    Row row(inserts_->picture);
    row.put(picture.frame);
    row.put(picture.cascade);
    row.put(picture.png);
    return runOnce(inserts_->picture);
}

Result<Done> ResultsStore::add(const lab::MethodRecord& method) {
    Row row(inserts_->method);
    row.put(methods_++);
    row.put(method.name);
    row.put(uint64_t(method.frames));
    row.put(uint64_t(method.judged));
    for (const double value : {method.aFrame(method.cost.triangles), method.aFrame(method.cost.texels), method.aFrame(method.cost.draws),
                               method.percent(method.falseLit.all()), method.percent(method.falseShadow.all()),
                               method.flipsPerMillion(), method.ms, method.shadingMs})
        row.put(value);
    return runOnce(inserts_->method);
}

Result<int64_t> ResultsStore::move(const RunRecord& run) {
    auto last = numberFrom(database_, "SELECT max(id) FROM run");
    if (!last) return last;
    const int64_t id = last.value() + 1;
    auto insert = database_.prepare(("INSERT INTO run VALUES(" + placeholders(23) + ")").c_str());
    if (!insert) return insert.error();
    const std::string key = hexOf(run.key());
    Row row(insert.value());
    row.put(id);
    row.put(key);
    eachRunColumn(run, [&](const auto& value) { row.put(value); });
    if (const auto done = runOnce(insert.value()); !done) return done.error();
    for (const Table& t : tables(columns_)) {
        const auto done = database_.run("INSERT INTO main." + t.name + " SELECT " + std::to_string(id) + ", * FROM temp.new_" + t.name);
        if (!done) return done.error();
    }
    return id;
}

Result<int64_t> ResultsStore::commit(const RunRecord& run) {
    Result<Done> done = Done{};
    if (std::exchange(pending_, 0) > 0) done = database_.run("COMMIT");
    if (done) done = database_.run("BEGIN IMMEDIATE");
    if (!done) return told(done.error());
    const auto id = move(run);
    if (id) done = database_.run("COMMIT");
    if (!id || !done) {
        (void)database_.run("ROLLBACK");  // the error that came first is the one to tell
        return told(!id ? id.error() : done.error());
    }
    methods_ = 0;
    std::string sql;
    for (const Table& t : tables(columns_)) sql += "DELETE FROM temp.new_" + t.name + ";";
    if (done = database_.run(sql); !done) return told(done.error());
    return id;
}

Result<Database> openResults(const std::string& file) {
    std::error_code ignored;
    if (!std::filesystem::exists(file, ignored))
        return Error{ErrorCode::kNotFound, file + ": is not there; --results FILE of replay, stress, lab and soak makes it"};
    if (std::filesystem::is_directory(file, ignored))
        return Error{ErrorCode::kIo, file + ": is a folder; give a file that --results made"};
    auto database = Database::openReadOnly(file);
    if (!database) return toldOf(file, database.error());
    const auto ours = isOurs(database.value(), file);
    if (!ours) return ours.error();
    if (!ours.value()) return foreign(file);
    return database;
}

}  // namespace tools
