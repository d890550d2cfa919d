#include "tools/report/run_file.h"

#include <charconv>
#include <limits>
#include <utility>

#include "tools/database_row.h"
#include "tools/results_store.h"

namespace tools::report {
namespace {

using world::Database;
using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;
using world::Statement;

std::string named(const std::vector<ResultColumn>& columns) {
    std::string list;
    for (const ResultColumn& c : columns) list += ", " + c.column.name;
    return list;
}

/// What a file holds, for the error of one who asked for something else.
std::string runsOf(Database& database) {
    auto statement = database.prepare("SELECT id, kind FROM run ORDER BY id DESC LIMIT 6");
    std::string list;
    if (!statement) return list;
    for (int k = 0; k < 6; ++k) {
        const auto row = statement.value().step();
        if (!row || !row.value()) break;
        if (k > 0) list += ", ";
        list += '#';
        list += std::to_string(statement.value().integer(0)) + " " + statement.value().text(1);
    }
    return list;
}

size_t causeNamed(const std::string& name) {
    for (size_t k = 0; k < cache::kCauses; ++k)
        if (name == cache::toString(cache::Cause(k))) return k;
    return cache::kCauses;
}

}  // namespace

Error RunFile::told(Error error) const {
    if (error.code == ErrorCode::kBadData) error.what = name_ + ": the file is damaged; take it away, and run again";
    return error;
}

Result<RunFile> RunFile::open(const std::string& word) {
    const size_t hash = word.rfind('#');
    std::string file = word;
    std::optional<int64_t> number;
    if (hash != std::string::npos) {
        int64_t value = 0;
        const char *begin = word.data() + hash + 1, *end = word.data() + word.size();
        if (const auto [at, error] = std::from_chars(begin, end, value); error == std::errc() && at == end) {
            number = value;
            file = word.substr(0, hash);
        }
    }
    auto database = openResults(file);
    if (!database) return database.error();
    if (!number) {
        const auto newest = numberFrom(database.value(), "SELECT max(id) FROM run");
        if (!newest) return newest.error();
        if (newest.value() == 0)
            return Error{ErrorCode::kNotFound, file + ": holds no run: none has come to its end; add one with --results"};
        number = newest.value();
    }
    RunFile run(file, *number, std::move(database.value()));
    if (const auto done = run.readRecord(); !done) return done.error();
    return run;
}

Result<Done> RunFile::readRecord() {
    auto statement = database_.prepare(
        "SELECT kind, name, verdict, world, world_hash, source, chunk_m, path, path_hash, movers, movers_hash, settings, frames, "
        "device, driver, machine, threads, program, summary, t_started, t_wall_s FROM run WHERE id = ?");
    if (!statement) return told(statement.error());
    statement.value().bind(0, number_);
    const auto row = statement.value().step();
    if (!row) return told(row.error());
    if (!row.value())
        return Error{ErrorCode::kNotFound, name_ + ": there is no such run; the newest of " + file_ + " are " + runsOf(database_)};
    Row columns(statement.value());
    eachRunColumn(record_, [&](auto& value) { columns.take(value); });
    return Done{};
}

Result<FrameCursor::Rows> RunFile::rowsOf(const std::string& columns, const std::string& table, const std::string& order) {
    auto statement = database_.prepare(("SELECT " + columns + " FROM " + table + " WHERE run = ? ORDER BY " + order).c_str());
    if (!statement) return told(statement.error());
    statement.value().bind(0, number_);
    FrameCursor::Rows rows{std::move(statement.value()), false};
    const auto row = rows.statement.step();
    if (!row) return told(row.error());
    rows.there = row.value();
    return rows;
}

Result<FrameCursor> RunFile::frames() {
    auto frames = rowsOf("frame, eye_x, eye_y, eye_z" + named(columns_.frame), "frame", "frame");
    auto cascades = rowsOf("frame, cascade" + named(columns_.cascade), "cascade", "frame, cascade");
    auto causes = rowsOf("frame, cascade, cause, texels, casters, triangles, draws", "cause", "frame, cascade, cause");
    auto casters = rowsOf("frame, name, x, y, z, triangles, draws", "caster", "frame, number");
    auto reads = rowsOf("frame, name, bytes, t_thread, t_begin_ms, t_ms", "read", "frame, number");
    for (const auto* rows : {&frames, &cascades, &causes, &casters, &reads})
        if (!*rows) return rows->error();
    return FrameCursor(*this, std::move(frames.value()), std::move(cascades.value()), std::move(causes.value()), std::move(casters.value()),
                       std::move(reads.value()));
}

void FrameCursor::takeCells(Statement& statement, int at, const std::vector<ResultColumn>& columns, std::vector<double>& values,
                            std::vector<std::string>& texts) {
    values.clear();
    texts.clear();
    for (const ResultColumn& c : columns) {
        const bool none = c.text || statement.isNull(at);
        values.push_back(none ? std::numeric_limits<double>::quiet_NaN() : statement.real(at));
        if (c.text) texts.push_back(statement.text(at));
        ++at;
    }
}

Result<bool> FrameCursor::next(FrameRow& row) {
    if (!frames_.there) return false;
    const auto stepped = [&](Rows& rows) -> Result<Done> {
        const auto more = rows.statement.step();
        if (!more) return file_.told(more.error());
        rows.there = more.value();
        return Done{};
    };
    const auto ofFrame = [&](Rows& rows) {
        return rows.there && static_cast<uint64_t>(rows.statement.integer(0)) == row.number;
    };
    Statement& frame = frames_.statement;
    row.number = static_cast<uint64_t>(frame.integer(0));
    for (int k = 0; k < 3; ++k) row.eye[k] = frame.real(1 + k);
    takeCells(frame, 4, file_.columns_.frame, row.values, row.texts);
    if (const auto done = stepped(frames_); !done) return done.error();
    size_t count = 0;
    while (ofFrame(cascades_)) {
        if (row.cascades.size() <= count) row.cascades.emplace_back();
        takeCells(cascades_.statement, 2, file_.columns_.cascade, row.cascades[count].values, row.cascades[count].texts);
        row.cascades[count++].byCause = {};
        if (const auto done = stepped(cascades_); !done) return done.error();
    }
    row.cascades.resize(count);
    while (ofFrame(causes_)) {
        Statement& s = causes_.statement;
        const auto cascade = static_cast<size_t>(s.integer(1));
        const size_t cause = causeNamed(s.text(2));
        if (cascade >= count || cause == cache::kCauses)
            return file_.told(Error{ErrorCode::kBadData, ""});
        cache::Cost& cost = row.cascades[cascade].byCause[cause];
        Row values(s);
        std::string skipped;
        values.take(cost.texels), values.take(cost.texels), values.take(skipped);  // frame, cascade, cause
        values.take(cost.texels), values.take(cost.casters), values.take(cost.triangles), values.take(cost.draws);
        if (const auto done = stepped(causes_); !done) return done.error();
    }
    row.dearest.clear();
    while (ofFrame(casters_)) {
        Row values(casters_.statement);
        server::CasterCost& caster = row.dearest.emplace_back();
        uint64_t skipped = 0;
        values.take(skipped), values.take(caster.name);
        for (int k = 0; k < 3; ++k) values.take(caster.pWorld[k]);
        values.take(caster.triangles), values.take(caster.draws);
        if (const auto done = stepped(casters_); !done) return done.error();
    }
    row.reads.clear();
    while (ofFrame(reads_)) {
        Row values(reads_.statement);
        ReadRow& read = row.reads.emplace_back();
        uint64_t skipped = 0;
        values.take(skipped), values.take(read.name), values.take(read.bytes), values.take(read.thread), values.take(read.beginMs), values.take(read.ms);
        if (const auto done = stepped(reads_); !done) return done.error();
    }
    return true;
}

Result<std::vector<DumpedPicture>> RunFile::pictures() {
    auto rows = rowsOf("frame, cascade, png", "picture", "frame, cascade");
    if (!rows) return rows.error();
    std::vector<DumpedPicture> pictures;
    while (rows.value().there) {
        Row values(rows.value().statement);
        DumpedPicture& picture = pictures.emplace_back();
        values.take(picture.frame), values.take(picture.cascade), values.take(picture.png);
        const auto more = rows.value().statement.step();
        if (!more) return told(more.error());
        rows.value().there = more.value();
    }
    return pictures;
}

Result<std::vector<MethodFigures>> RunFile::methods() {
    auto rows = rowsOf("name, frames, judged, triangles, texels, draws, false_lit, false_shadow, flips, t_ms, t_shading_ms", "method",
                       "number");
    if (!rows) return rows.error();
    std::vector<MethodFigures> methods;
    while (rows.value().there) {
        Row values(rows.value().statement);
        MethodFigures& m = methods.emplace_back();
        values.take(m.name), values.take(m.frames), values.take(m.judged);
        for (double* figure : {&m.triangles, &m.texels, &m.draws, &m.falseLit, &m.falseShadow, &m.flips, &m.ms, &m.shadingMs})
            values.take(*figure);
        const auto more = rows.value().statement.step();
        if (!more) return told(more.error());
        rows.value().there = more.value();
    }
    return methods;
}

Result<std::vector<server::CasterCost>> RunFile::casterSums() {
    auto rows = rowsOf("name, x, y, z, triangles, draws", "caster_sum", "name, x, y, z");
    if (!rows) return rows.error();
    std::vector<server::CasterCost> sums;
    while (rows.value().there) {
        Row values(rows.value().statement);
        server::CasterCost& sum = sums.emplace_back();
        values.take(sum.name);
        for (int k = 0; k < 3; ++k) values.take(sum.pWorld[k]);
        values.take(sum.triangles), values.take(sum.draws);
        const auto more = rows.value().statement.step();
        if (!more) return told(more.error());
        rows.value().there = more.value();
    }
    return sums;
}

Result<std::vector<std::string>> RunFile::repetitions() {
    auto statement = database_.prepare("SELECT id FROM run WHERE key = (SELECT key FROM run WHERE id = ?) ORDER BY id");
    if (!statement) return told(statement.error());
    statement.value().bind(0, number_);
    std::vector<std::string> words;
    for (;;) {
        const auto row = statement.value().step();
        if (!row) return told(row.error());
        if (!row.value()) return words;
        words.push_back(file_ + "#" + std::to_string(statement.value().integer(0)));
    }
}

}  // namespace tools::report
