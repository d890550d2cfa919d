// world/database.h — owner of an SQLite connection and its statements, as far as worlds and results of the lab need them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
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
    void bindReal(int parameter, double value);  ///< NaN becomes NULL
    /// `text` must stay until the next `reset`.
    void bindText(int parameter, std::string_view text);
    /// True on a row, false at the end. kIo when the disk is full or fails, kBadData for a damaged file.
    Result<bool> step();
    void reset();

    int64_t integer(int column);  ///< 0 for what is no integer
    double real(int column);  ///< 0 for what is no number
    bool isNull(int column);
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

/// Readers hold a world for milliseconds, a commit for as long as the disk takes to sync.
constexpr int kPatienceMs = 10000;

/// What a file says of itself before it is taken for a database.
struct FileHead {
    std::array<unsigned char, 100> bytes{};  ///< its first ones; zeros where there are fewer
    uint64_t size = 0;                       ///< of the whole file
};

/// A connection; outlives its statements. One thread at a time. Whatever reads a world that may be edited must read it
/// through here: to close a file otherwise would give up this process's locks on it.
class Database {
public:
    /// Read-only: creates nothing, and waits while an edit is written. Assumes that the file is hostile.
    static Result<Database> openReadOnly(const std::string& path);
    /// To change a finished world.
    static Result<Database> openEditable(const std::string& path);
    /// A file of the caller's: empty, or a database that it goes on writing.
    static Result<Database> openEmpty(const std::string& path);

    /// Runs statements that return nothing of interest.
    Result<Done> run(const std::string& sql);
    /// As the file is now. kIo.
    Result<FileHead> head() const;
    /// How long a statement waits for another connection: kPatienceMs to begin with.
    void waitAtMost(int ms);
    Result<Statement> prepare(const char* sql);
    /// The statements that made its tables and whatever else it has, in their order.
    Result<std::vector<std::string>> schema();

private:
    struct Close {
        void operator()(sqlite3* db) const;
    };
    static Result<Database> open(const std::string& file, int flags);
    std::unique_ptr<sqlite3, Close> db_;
    std::string file_;  ///< for errors
};

}  // namespace world
