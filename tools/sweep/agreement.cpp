#include "tools/sweep/agreement.h"

#include <set>
#include <utility>
#include <vector>

#include "tools/database_row.h"

namespace tools::sweep {
namespace {

using world::Database;
using world::Error;
using world::Result;
using world::Statement;

/// Of a run's row: what does not depend on the place where it ran.
const std::set<std::string> kNotCompared = {"id", "run", "key", "device", "driver", "machine", "threads", "program", "summary"};

struct Table {
    std::string name;
    std::vector<std::string> key, values;
};

Result<Table> tableOf(Database& database, const std::string& name) {
    Table table{name, {}, {}};
    auto columns = database.prepare(("SELECT name, pk FROM pragma_table_info('" + name + "') ORDER BY pk, cid").c_str());
    if (!columns) return columns.error();
    for (;;) {
        const auto row = columns.value().step();
        if (!row) return row.error();
        if (!row.value()) return table;
        const std::string column = columns.value().text(0);
        if (kNotCompared.contains(column) || column.starts_with("t_")) continue;
        (columns.value().integer(1) > 0 ? table.key : table.values).push_back(column);
    }
}

/// Rows of a run in the order of their keys. quote() gives back numbers to the last bit.
Result<Statement> rowsOf(const RunPlace& place, const Table& table) {
    std::string columns, order;
    for (const std::string& column : table.key) order += (order.empty() ? "" : ", ") + column;
    for (const std::string& column : table.key) columns += (columns.empty() ? "" : ", ") + column;
    for (const std::string& column : table.values) columns += (columns.empty() ? "quote(" : ", quote(") + column + ")";
    auto rows = place.database.prepare(
        ("SELECT " + columns + " FROM " + table.name + (table.name == "run" ? " WHERE id = ?" : " WHERE run = ?") + (order.empty() ? "" : " ORDER BY " + order)).c_str());
    if (rows) rows.value().bind(0, place.run);
    return rows;
}

std::string keyOf(Statement& row, const Table& table) {
    std::string text;
    for (size_t k = 0; k < table.key.size(); ++k) text += ", " + table.key[k] + " " + row.text(int(k));
    return text;
}

Result<std::optional<std::string>> differenceIn(const RunPlace& a, const RunPlace& b, const Table& table) {
    auto first = rowsOf(a, table), second = rowsOf(b, table);
    if (!first) return first.error();
    if (!second) return second.error();
    for (;;) {
        const auto inA = first.value().step(), inB = second.value().step();
        if (!inA) return inA.error();
        if (!inB) return inB.error();
        if (!inA.value() && !inB.value()) return std::optional<std::string>();
        Statement& some = inA.value() ? first.value() : second.value();
        const std::string place = "table " + table.name + keyOf(some, table);
        if (inA.value() != inB.value()) return std::optional(place + ": there is such a row in " + (inA.value() ? a : b).name + " alone");
        if (const std::string other = "table " + table.name + keyOf(second.value(), table); place != other)
            return std::optional(place + " in " + a.name + " stands where " + other + " does in " + b.name);
        for (size_t k = 0; k < table.values.size(); ++k) {
            const int column = int(table.key.size() + k);
            const std::string left = first.value().text(column), right = second.value().text(column);
            if (left != right) return std::optional(place + ": " + table.values[k] + " is " + left + " in " + a.name + " and " + right + " in " + b.name);
        }
    }
}

}  // namespace

Result<std::optional<std::string>> difference(const RunPlace& a, const RunPlace& b) {
    for (const char* name : {"frame", "cascade", "cause", "caster", "caster_sum", "read", "picture", "method", "run"}) {
        const auto table = tableOf(a.database, name);
        if (!table) return table.error();
        const auto found = differenceIn(a, b, table.value());
        if (!found || found.value()) return found;
    }
    return std::optional<std::string>();
}

}  // namespace tools::sweep
