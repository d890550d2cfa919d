// world/database.h — owner of an SQLite connection and its statements, as far as a world file needs them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "world/result.h"

struct sqlite3;
struct sqlite3_stmt;

namespace world {

constexpr uint32_t kApplicationId = 0x474e4f4d;  ///< "GNOM" in the file's header: ours

/// The only table of a world, as SQLite itself keeps the statement.
constexpr const char* kBlobTable =
    "CREATE TABLE blob(x INTEGER NOT NULL, y INTEGER NOT NULL, z INTEGER NOT NULL, lod INTEGER NOT NULL, "
    "kind INTEGER NOT NULL, codec INTEGER NOT NULL, raw_size INTEGER NOT NULL, checksum INTEGER NOT NULL, "
    "data BLOB NOT NULL, PRIMARY KEY(x, y, z, lod, kind)) WITHOUT ROWID";

/// A prepared statement. Columns and parameters count from 0.
class Statement {
public:
    void bind(int parameter, int64_t value);
    /// `bytes` must stay until the next `reset`.
    void bind(int parameter, std::span<const std::byte> bytes);
    /// True on a row, false at the end. kIo when the disk is full or fails, kBadData for a damaged file.
    Result<bool> step();
    void reset();

    int64_t integer(int column);  ///< 0 for what is no integer
    std::string text(int column);
    std::span<const std::byte> bytes(int column);  ///< valid until the next step or reset

private:
    friend class Database;
    struct Finalize {
        void operator()(sqlite3_stmt* s) const;
    };
    std::unique_ptr<sqlite3_stmt, Finalize> statement_;
    std::string file_;
};

/// A connection; outlives its statements. One thread at a time.
class Database {
public:
    /// Read-only, and without a lock, journal or temporary file: nobody writes to a finished world.
    /// Assumes that the file is hostile.
    static Result<Database> openReadOnly(const std::string& path);
    /// A file of the caller's: empty, or a database that it goes on writing.
    static Result<Database> openEmpty(const std::string& path);

    /// Runs statements that return nothing of interest.
    Result<Done> run(const std::string& sql);
    Result<Statement> prepare(const char* sql);
    /// The statements that made its tables and whatever else it has, in their order.
    Result<std::vector<std::string>> schema();

private:
    struct Close {
        void operator()(sqlite3* db) const;
    };
    static Result<Database> open(const std::string& file, const std::string& name, int flags);
    std::unique_ptr<sqlite3, Close> db_;
    std::string file_;  ///< for errors
};

}  // namespace world
