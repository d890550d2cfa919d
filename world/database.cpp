#include "world/database.h"

#include <sqlite3.h>

#include <filesystem>

namespace world {
namespace {

Error failure(sqlite3* db, const std::string& file) {
    const int code = sqlite3_extended_errcode(db);
    const std::string why = sqlite3_errmsg(db);
    switch (code & 0xff) {
        case SQLITE_FULL:
        case SQLITE_IOERR:
            return {ErrorCode::kIo, file + ": " + why + ": free some space there, or choose another disk",
                    code};
        case SQLITE_CANTOPEN:
        case SQLITE_PERM:
        case SQLITE_READONLY:
        case SQLITE_BUSY:
            return {ErrorCode::kIo, file + ": " + why + ": check its permissions and who else uses it", code};
        case SQLITE_NOMEM:
            return {ErrorCode::kLimit, file + ": " + why + ": free some memory", code};
        case SQLITE_CONSTRAINT:
            return {ErrorCode::kUsage, file + ": " + why + ": a row is written once", code};
        default:
            return {ErrorCode::kBadData, file + ": " + why + ": the file is damaged, bake it again", code};
    }
}

}  // namespace

void Statement::Finalize::operator()(sqlite3_stmt* s) const { sqlite3_finalize(s); }
void Database::Close::operator()(sqlite3* db) const { sqlite3_close_v2(db); }

void Statement::bind(int parameter, int64_t value) {
    CHECK(sqlite3_bind_int64(statement_.get(), parameter + 1, value) == SQLITE_OK);
}

void Statement::bind(int parameter, std::span<const std::byte> bytes) {
    // An empty span may hold a null pointer, which would bind NULL instead of an empty blob.
    const void* data = bytes.empty() ? "" : static_cast<const void*>(bytes.data());
    CHECK(sqlite3_bind_blob64(statement_.get(), parameter + 1, data, bytes.size(), SQLITE_STATIC) ==
          SQLITE_OK);
}

void Statement::bindReal(int parameter, double value) {
    CHECK(sqlite3_bind_double(statement_.get(), parameter + 1, value) == SQLITE_OK);
}

void Statement::bindText(int parameter, std::string_view text) {
    // As for bytes: an empty view may hold a null pointer.
    const char* data = text.empty() ? "" : text.data();
    CHECK(sqlite3_bind_text64(statement_.get(), parameter + 1, data, text.size(), SQLITE_STATIC, SQLITE_UTF8) ==
          SQLITE_OK);
}

Result<bool> Statement::step() {
    const int code = sqlite3_step(statement_.get());
    if (code == SQLITE_ROW) return true;
    if (code == SQLITE_DONE) return false;
    Error error = failure(sqlite3_db_handle(statement_.get()), file_);
    reset();
    return error;
}

void Statement::reset() { sqlite3_reset(statement_.get()); }

int64_t Statement::integer(int column) {
    if (sqlite3_column_type(statement_.get(), column) != SQLITE_INTEGER) return 0;
    return sqlite3_column_int64(statement_.get(), column);
}

double Statement::real(int column) { return sqlite3_column_double(statement_.get(), column); }

bool Statement::isNull(int column) { return sqlite3_column_type(statement_.get(), column) == SQLITE_NULL; }

std::string Statement::text(int column) {
    const unsigned char* text = sqlite3_column_text(statement_.get(), column);
    const int size = sqlite3_column_bytes(statement_.get(), column);
    return text ? std::string(reinterpret_cast<const char*>(text), static_cast<size_t>(size)) : std::string();
}

std::span<const std::byte> Statement::bytes(int column) {
    if (sqlite3_column_type(statement_.get(), column) != SQLITE_BLOB) return {};
    const void* data = sqlite3_column_blob(statement_.get(), column);
    const int size = sqlite3_column_bytes(statement_.get(), column);
    return data ? std::span(static_cast<const std::byte*>(data), static_cast<size_t>(size))
                : std::span<const std::byte>();
}

Result<Database> Database::open(const std::string& file, int flags) {
    Database database;
    database.file_ = file;
    sqlite3* db = nullptr;
    const std::string name = std::filesystem::absolute(file).string();
    const int code =
        sqlite3_open_v2(name.c_str(), &db, flags | SQLITE_OPEN_NOMUTEX | SQLITE_OPEN_EXRESCODE, nullptr);
    database.db_.reset(db);
    if (!db) return Error{ErrorCode::kLimit, file + ": no memory to open it", code};
    if (code != SQLITE_OK) return failure(db, file);
    return database;
}

Result<Database> Database::openReadOnly(const std::string& path) {
    Result<Database> database = open(path, SQLITE_OPEN_READONLY);
    if (!database) return database;
    database.value().waitAtMost(kPatienceMs);
    sqlite3_db_config(database.value().db_.get(), SQLITE_DBCONFIG_DEFENSIVE, 1, nullptr);
    const Result<Done> set = database.value().run(
        "PRAGMA trusted_schema=0; PRAGMA cell_size_check=1; PRAGMA query_only=1; PRAGMA mmap_size=0");
    if (!set) return set.error();
    return database;
}

Result<Database> Database::openEmpty(const std::string& path) {
    return open(path, SQLITE_OPEN_READWRITE);
}

Result<Database> Database::openEditable(const std::string& path) {
    Result<Database> database = open(path, SQLITE_OPEN_READWRITE);
    if (!database) return database;
    database.value().waitAtMost(kPatienceMs);
    sqlite3_db_config(database.value().db_.get(), SQLITE_DBCONFIG_DEFENSIVE, 1, nullptr);
    // EXTRA: what was committed outlives a loss of power, too, with a rollback journal.
    const Result<Done> set =
        database.value().run("PRAGMA trusted_schema=0; PRAGMA cell_size_check=1; PRAGMA synchronous=EXTRA");
    if (!set) return set.error();
    return database;
}

Result<Done> Database::run(const std::string& sql) {
    if (sqlite3_exec(db_.get(), sql.c_str(), nullptr, nullptr, nullptr) != SQLITE_OK)
        return failure(db_.get(), file_);
    return Done{};
}

Result<FileHead> Database::head() const {
    sqlite3_file* file = nullptr;
    FileHead head;
    sqlite3_int64 size = 0;
    int code = sqlite3_file_control(db_.get(), "main", SQLITE_FCNTL_FILE_POINTER, &file);
    if (code == SQLITE_OK) code = file->pMethods->xFileSize(file, &size);
    if (code == SQLITE_OK) code = file->pMethods->xRead(file, head.bytes.data(), int(head.bytes.size()), 0);
    if (code != SQLITE_OK && code != SQLITE_IOERR_SHORT_READ)
        return Error{ErrorCode::kIo, file_ + ": cannot be read: check its permissions and the disk", code};
    head.size = static_cast<uint64_t>(size);
    return head;
}

void Database::waitAtMost(int ms) { sqlite3_busy_timeout(db_.get(), ms); }

Result<Statement> Database::prepare(const char* sql) {
    Statement statement;
    statement.file_ = file_;
    sqlite3_stmt* raw = nullptr;
    const int code = sqlite3_prepare_v3(db_.get(), sql, -1, SQLITE_PREPARE_PERSISTENT, &raw, nullptr);
    statement.statement_.reset(raw);
    if (code != SQLITE_OK) return failure(db_.get(), file_);
    return statement;
}

Result<std::vector<std::string>> Database::schema() {
    Result<Statement> list = prepare("SELECT sql FROM sqlite_schema");
    if (!list) return list.error();
    std::vector<std::string> statements;
    for (;;) {
        const Result<bool> row = list.value().step();
        if (!row) return row.error();
        if (!row.value()) return statements;
        statements.push_back(list.value().text(0));
    }
}

}  // namespace world
