// tools/database_row.h — values to and from a statement one after the other, so that a row's columns are listed once.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "world/database.h"

namespace tools {

/// Parameters or columns of a statement, in order. Texts and bytes must stay until its next reset.
class Row {
public:
    explicit Row(world::Statement& statement) : statement_(statement) {}
    void put(uint64_t value) { statement_.bind(at_++, static_cast<int64_t>(value)); }
    void put(int64_t value) { statement_.bind(at_++, value); }
    void put(int value) { statement_.bind(at_++, int64_t{value}); }
    void put(bool value) { statement_.bind(at_++, int64_t{value}); }
    void put(double value) { statement_.bindReal(at_++, value); }
    void put(const std::string& text) { statement_.bindText(at_++, text); }
    void put(const std::vector<std::byte>& bytes) { statement_.bind(at_++, std::span<const std::byte>(bytes)); }
    void take(uint64_t& value) { value = static_cast<uint64_t>(statement_.integer(at_++)); }
    void take(int64_t& value) { value = statement_.integer(at_++); }
    void take(int& value) { value = static_cast<int>(statement_.integer(at_++)); }
    void take(bool& value) { value = statement_.integer(at_++) != 0; }
    void take(double& value) { value = statement_.real(at_++); }
    void take(std::string& text) { text = statement_.text(at_++); }
    void take(std::vector<std::byte>& bytes) {
        const auto span = statement_.bytes(at_++);
        bytes.assign(span.begin(), span.end());
    }

private:
    world::Statement& statement_;
    int at_ = 0;
};

/// Runs a statement that gives no rows, and makes it ready to be run again.
inline world::Result<world::Done> runOnce(world::Statement& statement) {
    const auto row = statement.step();
    if (!row) return row.error();
    statement.reset();
    return world::Done{};
}

/// The whole number that a query gives; 0 where it gives none.
inline world::Result<int64_t> numberFrom(world::Database& database, const char* sql) {
    auto statement = database.prepare(sql);
    if (!statement) return statement.error();
    const auto row = statement.value().step();
    if (!row) return row.error();
    return row.value() ? statement.value().integer(0) : 0;
}

}  // namespace tools
