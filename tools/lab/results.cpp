#include "tools/lab/results.h"

#include <cerrno>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <system_error>
#include <utility>

#include "tools/database_row.h"
#include "tools/lab/page.h"
#include "tools/output_folder.h"

namespace tools::lab {
namespace {

namespace fs = std::filesystem;
using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;
using world::Statement;

constexpr int64_t kLabId = 0x474c4142;  ///< "GLAB" in the file's header
constexpr int64_t kLabVersion = 2;

constexpr const char* kTables =
    "CREATE TABLE run(key INTEGER PRIMARY KEY, world TEXT, path TEXT, movers TEXT, frames INTEGER, judged INTEGER, "
    "begins REAL, ends REAL, far REAL, fov REAL, sun_x REAL, sun_y REAL, sun_z REAL, width INTEGER, height INTEGER, "
    "device TEXT, driver TEXT, threads INTEGER);"
    "CREATE TABLE method(key INTEGER PRIMARY KEY, run INTEGER, name TEXT, settings TEXT, frames INTEGER, "
    "texels INTEGER, casters INTEGER, triangles INTEGER, draws INTEGER, ms REAL, shading_ms REAL, judged INTEGER, pixels INTEGER, "
    "lit_at_edges INTEGER, lit_elsewhere INTEGER, shadow_at_edges INTEGER, shadow_elsewhere INTEGER, difference REAL, soft_difference REAL, "
    "unanswered INTEGER, points INTEGER, flips INTEGER, ratio_50 REAL, ratio_99 REAL, used REAL, "
    "worst_frame INTEGER, worst_wrong INTEGER, picture BLOB);"
    "CREATE INDEX method_of_run ON method(run);"
    "CREATE TABLE frame(method INTEGER, frame INTEGER, triangles INTEGER, ms REAL, pixels INTEGER, "
    "false_lit INTEGER, false_shadow INTEGER, points INTEGER, flips INTEGER, PRIMARY KEY(method, frame)) WITHOUT ROWID;";

/// Folders from before it was there get it when they are opened.
constexpr const char* kOcclusionTable =
    "CREATE TABLE IF NOT EXISTS occlusion(run INTEGER, number INTEGER, way TEXT, judged INTEGER, asked INTEGER, "
    "hidden INTEGER, wrongly_hidden INTEGER, rays INTEGER, triangles INTEGER, texels INTEGER, texels_wrong INTEGER, "
    "deepest REAL, pixels INTEGER, false_lit INTEGER, false_shadow INTEGER, prepare_ms REAL, ms REAL, "
    "PRIMARY KEY(run, number)) WITHOUT ROWID";

constexpr const char* kClaimTable =
    "CREATE TABLE IF NOT EXISTS claim(run INTEGER, number INTEGER, situation TEXT, what TEXT, method TEXT, measure TEXT, "
    "why TEXT, verdict TEXT, value REAL, threshold REAL, fails INTEGER, wrong INTEGER, PRIMARY KEY(run, number)) WITHOUT ROWID";

/// The columns of `method` from `name` on but for `settings`, in their order, written and read by the same list.
template <class Record, class Visit>
void eachColumn(Record& r, Visit visit) {
    visit(r.frames);
    visit(r.cost.texels);
    visit(r.cost.casters);
    visit(r.cost.triangles);
    visit(r.cost.draws);
    visit(r.ms);
    visit(r.shadingMs);
    visit(r.judged);
    visit(r.pixels);
    visit(r.falseLit.atEdges);
    visit(r.falseLit.elsewhere);
    visit(r.falseShadow.atEdges);
    visit(r.falseShadow.elsewhere);
    visit(r.difference);
    visit(r.softDifference);
    visit(r.unanswered);
    visit(r.points);
    visit(r.flips);
    visit(r.ratio50);
    visit(r.ratio99);
    visit(r.usedShare);
    visit(r.worstFrame);
    visit(r.worstWrong);
    visit(r.picture);
}

/// The columns of `occlusion` from `way` on, likewise.
template <class Record, class Visit>
void eachOcclusionColumn(Record& r, Visit visit) {
    visit(r.way);
    visit(r.judged);
    visit(r.asked);
    visit(r.hidden);
    visit(r.wronglyHidden);
    visit(r.rays);
    visit(r.triangles);
    visit(r.texels);
    visit(r.texelsWrong);
    visit(r.deepest);
    visit(r.pixels);
    visit(r.falseLit);
    visit(r.falseShadow);
    visit(r.prepareMs);
    visit(r.ms);
}

/// Those of `claim` from `situation` on, likewise.
template <class Record, class Visit>
void eachClaimColumn(Record& r, Visit visit) {
    visit(r.situation);
    visit(r.what);
    visit(r.method);
    visit(r.measure);
    visit(r.why);
    visit(r.verdict);
    visit(r.value);
    visit(r.limit);
    visit(r.fails);
    visit(r.wrong);
}

std::string settingsText(const std::vector<culling::MethodSetting>& fields) {
    nlohmann::json list = nlohmann::json::array();
    for (const culling::MethodSetting& field : fields) list.push_back({field.name, field.value, field.unit});
    return list.dump();
}

/// None for a text that is not ours.
std::optional<std::vector<culling::MethodSetting>> fieldsFrom(const std::string& text) {
    const auto list = nlohmann::json::parse(text, nullptr, false);
    if (!list.is_array()) return std::nullopt;
    std::vector<culling::MethodSetting> fields;
    for (const auto& entry : list) {
        if (!entry.is_array() || entry.size() != 3) return std::nullopt;
        for (const auto& part : entry)
            if (!part.is_string()) return std::nullopt;
        fields.push_back({entry[0], entry[1], entry[2]});
    }
    return fields;
}

std::string fileIn(const std::string& folder) { return (fs::path(folder) / "lab.sqlite").string(); }

Error foreign(const std::string& file) {
    return {ErrorCode::kBadData, file + ": is not of this lab, or damaged; give another --out, or take it away"};
}

/// SQLite's errors speak of worlds.
Error told(Error error, const std::string& folder) {
    return error.code == ErrorCode::kBadData ? foreign(fileIn(folder)) : error;
}

Result<std::vector<FrameRecord>> framesOf(world::Database& database, uint64_t method) {
    auto statement = database.prepare(
        "SELECT frame, triangles, ms, pixels, false_lit, false_shadow, points, flips FROM frame WHERE method = ? "
        "ORDER BY frame");
    if (!statement) return statement.error();
    statement.value().bind(0, static_cast<int64_t>(method));
    std::vector<FrameRecord> frames;
    for (;;) {
        const auto row = statement.value().step();
        if (!row) return row.error();
        if (!row.value()) return frames;
        FrameRecord frame;
        Row columns(statement.value());
        columns.take(frame.frame);
        columns.take(frame.triangles);
        columns.take(frame.ms);
        if (!statement.value().isNull(3)) {
            FrameRecord::Judged judged;
            for (uint64_t* value : {&judged.pixels, &judged.falseLit, &judged.falseShadow, &judged.points, &judged.flips})
                columns.take(*value);
            frame.judged = judged;
        }
        frames.push_back(frame);
    }
}

}  // namespace

Result<Results> Results::open(const std::string& folder) {
    Results results(folder);
    std::error_code error;
    if (!fs::exists(fileIn(folder), error)) {
        if (fs::exists(folder, error) && !fs::is_directory(folder, error))
            return Error{ErrorCode::kIo, folder + ": is a file; give another folder"};
        return results;
    }
    if (const auto done = results.connect(); !done) return done.error();
    return results;
}

Result<Done> Results::connect() {
    auto opened = world::Database::openEmpty(fileIn(folder_));
    if (!opened) return told(opened.error(), folder_);
    world::Database& database = opened.value();
    database.waitAtMost(world::kPatienceMs);
    // Locked before it is looked at: two processes may find it empty.
    if (const auto done = database.run("BEGIN IMMEDIATE"); !done) return told(done.error(), folder_);
    const auto id = numberFrom(database, "PRAGMA application_id"), version = numberFrom(database, "PRAGMA user_version");
    const auto tables = database.schema();
    for (const auto* failed : {&id, &version})
        if (!*failed) return told(failed->error(), folder_);
    if (!tables) return told(tables.error(), folder_);
    const bool empty = tables.value().empty() && id.value() == 0;
    if (!empty && (id.value() != kLabId || version.value() != kLabVersion)) return foreign(fileIn(folder_));
    if (empty) {
        const auto made = database.run(std::string(kTables) + "PRAGMA application_id=" + std::to_string(kLabId) +
                                       ";PRAGMA user_version=" + std::to_string(kLabVersion));
        if (!made) return told(made.error(), folder_);
    }
    for (const char* table : {kOcclusionTable, kClaimTable})
        if (const auto done = database.run(table); !done) return told(done.error(), folder_);
    if (const auto done = database.run("COMMIT"); !done) return told(done.error(), folder_);
    database_.emplace(std::move(database));
    return Done{};
}

Result<std::vector<MethodRecord>> Results::read(const char* condition, uint64_t key) {
    std::vector<MethodRecord> records;
    if (!database_) return records;
    auto statement = database_->prepare(
        (std::string("SELECT key, name, settings, frames, texels, casters, triangles, draws, ms, shading_ms, judged, pixels, lit_at_edges, "
                     "lit_elsewhere, shadow_at_edges, shadow_elsewhere, difference, soft_difference, unanswered, points, flips, ratio_50, "
                     "ratio_99, used, worst_frame, worst_wrong, picture FROM method WHERE ") + condition +
         " = ? ORDER BY name, key").c_str());
    if (!statement) return told(statement.error(), folder_);
    statement.value().bind(0, static_cast<int64_t>(key));
    for (;;) {
        const auto row = statement.value().step();
        if (!row) return told(row.error(), folder_);
        if (!row.value()) return records;
        uint64_t method = 0;
        std::string settings;
        MethodRecord record;
        Row columns(statement.value());
        columns.take(method);
        columns.take(record.name);
        columns.take(settings);
        eachColumn(record, [&](auto& value) { columns.take(value); });
        auto fields = fieldsFrom(settings);
        if (!fields) return foreign(fileIn(folder_));
        record.fields = std::move(*fields);
        auto frames = framesOf(*database_, method);
        if (!frames) return told(frames.error(), folder_);
        record.series = std::move(frames.value());
        records.push_back(std::move(record));
    }
}

Result<std::optional<MethodRecord>> Results::find(uint64_t method) {
    auto found = read("key", method);
    if (!found) return found.error();
    if (found.value().empty()) return std::optional<MethodRecord>();
    return std::optional(std::move(found.value().front()));
}

Result<std::vector<MethodRecord>> Results::methodsOf(const RunRecord& run) { return read("run", run.key); }

template <class Record, class Each>
Result<std::vector<Record>> Results::readAll(const char* sql, const RunRecord& run, Each each) {
    std::vector<Record> records;
    if (!database_) return records;
    auto statement = database_->prepare(sql);
    if (!statement) return told(statement.error(), folder_);
    statement.value().bind(0, static_cast<int64_t>(run.key));
    for (;;) {
        const auto row = statement.value().step();
        if (!row) return told(row.error(), folder_);
        if (!row.value()) return records;
        Row columns(statement.value());
        each(records.emplace_back(), [&](auto& value) { columns.take(value); });
    }
}

Result<std::vector<OcclusionRecord>> Results::occlusionOf(const RunRecord& run) {
    return readAll<OcclusionRecord>(
        "SELECT way, judged, asked, hidden, wrongly_hidden, rays, triangles, texels, texels_wrong, deepest, pixels, "
        "false_lit, false_shadow, prepare_ms, ms FROM occlusion WHERE run = ? ORDER BY number",
        run, [](auto& record, auto take) { eachOcclusionColumn(record, take); });
}

Result<std::vector<ClaimRecord>> Results::claimsOf(const RunRecord& run) {
    return readAll<ClaimRecord>(
        "SELECT situation, what, method, measure, why, verdict, value, threshold, fails, wrong FROM claim WHERE run = ? "
        "ORDER BY number",
        run, [](auto& record, auto take) { eachClaimColumn(record, take); });
}

Result<Done> Results::write(const RunRecord& run) {
    auto ofRun = database_->prepare(
        "INSERT OR REPLACE INTO run VALUES(?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
    if (!ofRun) return ofRun.error();
    Row row(ofRun.value());
    row.put(run.key);
    for (const std::string* text : {&run.world, &run.path, &run.movers}) row.put(*text);
    for (const uint64_t value : {uint64_t(run.frames), uint64_t(run.judged)}) row.put(value);
    for (const double value : {run.begins, run.ends, run.farDistance, run.verticalFov, run.sun.x, run.sun.y, run.sun.z})
        row.put(value);
    row.put(run.width);
    row.put(run.height);
    row.put(run.device);
    row.put(run.driver);
    row.put(run.threads);
    return runOnce(ofRun.value());
}

Result<Done> Results::write(const RunRecord& run, uint64_t method, const MethodRecord& record) {
    auto ofMethod = database_->prepare(
        "INSERT OR REPLACE INTO method VALUES(?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
    auto cleared = database_->prepare("DELETE FROM frame WHERE method = ?");
    auto drawn = database_->prepare("INSERT INTO frame(method, frame, triangles, ms) VALUES(?, ?, ?, ?)");
    auto judged = database_->prepare("INSERT INTO frame VALUES(?, ?, ?, ?, ?, ?, ?, ?, ?)");
    for (const auto* statement : {&ofMethod, &cleared, &drawn, &judged})
        if (!*statement) return statement->error();
    if (const auto done = write(run); !done) return done;
    const std::string settings = settingsText(record.fields);
    {
        Row row(ofMethod.value());
        row.put(method);
        row.put(run.key);
        row.put(record.name);
        row.put(settings);
        eachColumn(record, [&](const auto& value) { row.put(value); });
    }
    if (const auto done = runOnce(ofMethod.value()); !done) return done;
    cleared.value().bind(0, static_cast<int64_t>(method));
    if (const auto done = runOnce(cleared.value()); !done) return done;
    for (const FrameRecord& frame : record.series) {
        Result<Statement>& statement = frame.judged ? judged : drawn;
        Row row(statement.value());
        for (const uint64_t value : {method, uint64_t(frame.frame), frame.triangles}) row.put(value);
        row.put(frame.ms);
        if (frame.judged)
            for (const uint64_t value : {frame.judged->pixels, frame.judged->falseLit, frame.judged->falseShadow,
                                         frame.judged->points, frame.judged->flips})
                row.put(value);
        if (const auto done = runOnce(statement.value()); !done) return done;
    }
    return Done{};
}

Result<Done> Results::inTransaction(const std::function<Result<Done>()>& write) {
    if (!database_) {
        std::error_code error;
        fs::create_directories(folder_, error);
        const std::string file = fileIn(folder_);
        if (error || !std::ofstream(file, std::ios::app))
            return Error{ErrorCode::kIo, file + ": cannot be made; give --out a folder that can be written, with room",
                         error ? error.value() : errno};
        if (const auto done = connect(); !done) return done;
    }
    if (const auto done = database_->run("BEGIN IMMEDIATE"); !done) return told(done.error(), folder_);
    auto done = write();
    if (done) done = database_->run("COMMIT");
    if (done) return done;
    (void)database_->run("ROLLBACK");  // the error that came first is the one to tell
    return told(done.error(), folder_);
}

Result<Done> Results::save(const RunRecord& run, uint64_t method, const MethodRecord& record) {
    return inTransaction([&] { return write(run, method, record); });
}

template <class Record, class Each>
Result<Done> Results::replaceAll(const char* clear, const char* add, const RunRecord& run, std::span<const Record> records,
                                 Each each) {
    return inTransaction([&]() -> Result<Done> {
        auto cleared = database_->prepare(clear), added = database_->prepare(add);
        for (const auto* statement : {&cleared, &added})
            if (!*statement) return statement->error();
        if (const auto done = write(run); !done) return done;
        cleared.value().bind(0, static_cast<int64_t>(run.key));
        if (const auto done = runOnce(cleared.value()); !done) return done;
        for (size_t number = 0; number < records.size(); ++number) {
            Row row(added.value());
            row.put(run.key);
            row.put(uint64_t(number));
            each(records[number], [&](const auto& value) { row.put(value); });
            if (const auto done = runOnce(added.value()); !done) return done;
        }
        return Done{};
    });
}

Result<Done> Results::saveOcclusion(const RunRecord& run, std::span<const OcclusionRecord> records) {
    return replaceAll("DELETE FROM occlusion WHERE run = ?",
                      "INSERT INTO occlusion VALUES(?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", run, records,
                      [](const auto& record, auto put) { eachOcclusionColumn(record, put); });
}

Result<Done> Results::saveClaims(const RunRecord& run, std::span<const ClaimRecord> records) {
    return replaceAll("DELETE FROM claim WHERE run = ?", "INSERT INTO claim VALUES(?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", run,
                      records, [](const auto& record, auto put) { eachClaimColumn(record, put); });
}

Result<std::string> Results::writePage(const RunRecord& run) {
    const auto methods = methodsOf(run);
    if (!methods) return methods.error();
    const auto occlusion = occlusionOf(run);
    if (!occlusion) return occlusion.error();
    const auto claims = claimsOf(run);
    if (!claims) return claims.error();
    const std::string path = (fs::path(folder_) / "lab.html").string();
    if (const auto done = writeText(path, labPage(run, methods.value(), occlusion.value(), claims.value())); !done) return done.error();
    return path;
}

}  // namespace tools::lab
