#include "tools/truth_store.h"

#include <cstdio>
#include <fstream>
#include <utility>

#include "world/blob.h"
#include "world/bytes.h"
#include "world/hash.h"

namespace tools {
namespace {

using culling::Sunlight;
using culling::TruthFrame;
using world::BlobKey;
using world::ByteReader;
using world::ByteWriter;
using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

/// Of how answers are traced and written: another number, other keys.
constexpr uint32_t kVersion = 1;
constexpr int64_t kStoreId = 0x474e5452;  ///< "GNTR" in the file's header: no world

BlobKey rowOf(uint64_t key) {
    BlobKey row;
    row.x = static_cast<int32_t>(static_cast<uint32_t>(key));
    row.y = static_cast<int32_t>(static_cast<uint32_t>(key >> 32));
    return row;
}
/// Of an answer that has other numbers in its question.
BlobKey rowOf(ByteWriter question) { return rowOf(world::hashBytes(question.take())); }

std::string nameOf(const BlobKey& key) {
    char name[32];
    std::snprintf(name, sizeof name, "truth %08x%08x", static_cast<unsigned>(key.y), static_cast<unsigned>(key.x));
    return name;
}

/// One coordinate after the other: neighbours in the image are neighbours in the row, which packs the better.
void writePlanes(ByteWriter& w, const std::vector<glm::vec3>& values) {
    for (int k = 0; k < 3; ++k)
        for (const glm::vec3& v : values) w.f32(v[k]);
}
void readPlanes(ByteReader& r, std::vector<glm::vec3>& values) {
    for (int k = 0; k < 3; ++k)
        for (glm::vec3& v : values) v[k] = r.f32();
}

Sunlight readState(ByteReader& r) {
    const uint8_t state = r.u8();
    if (state > static_cast<uint8_t>(Sunlight::kShadowed)) r.fail("a pixel is neither sky, lit nor dark");
    return static_cast<Sunlight>(state);
}

std::vector<std::byte> encodeFrame(const TruthFrame& frame) {
    ByteWriter w;
    w.reserve(56 + 30 * frame.states.size());
    w.i32(frame.width), w.i32(frame.height);
    w.dvec3(frame.eye), w.dvec3(frame.sun);
    for (const Sunlight state : frame.states) w.u8(static_cast<uint8_t>(state));
    for (const uint8_t edge : frame.edges) w.u8(edge);
    for (const world::CasterId id : frame.casters) w.u32(id);
    writePlanes(w, frame.points);
    writePlanes(w, frame.normals);
    return w.take();
}

Result<TruthFrame> decodeFrame(std::span<const std::byte> bytes) {
    ByteReader r(bytes);
    TruthFrame frame;
    frame.width = r.i32(), frame.height = r.i32();
    frame.eye = r.dvec3(), frame.sun = r.dvec3();
    constexpr uint64_t kPixelBytes = 2 + 4 + 24;
    uint64_t pixels = 0;
    if (frame.width > 0 && frame.height > 0) pixels = uint64_t(frame.width) * uint64_t(frame.height);
    if (pixels == 0 || pixels > r.remaining() / kPixelBytes) {
        r.fail("its pixels do not follow");
        pixels = 0;
    }
    frame.states.resize(pixels), frame.edges.resize(pixels), frame.casters.resize(pixels);
    frame.points.resize(pixels), frame.normals.resize(pixels);
    for (Sunlight& state : frame.states) state = readState(r);
    for (uint8_t& edge : frame.edges) {
        edge = r.u8();
        if (edge > culling::kEdgeSteps) r.fail("an edge lies at no step");
    }
    for (world::CasterId& id : frame.casters) id = r.u32();
    readPlanes(r, frame.points);
    readPlanes(r, frame.normals);
    const Result<Done> end = r.end();
    if (!end) return end.error();
    return frame;
}

std::vector<std::byte> encodeStates(const std::vector<Sunlight>& states) {
    ByteWriter w;
    w.u32(static_cast<uint32_t>(states.size()));
    for (const Sunlight state : states) w.u8(static_cast<uint8_t>(state));
    return w.take();
}

Result<std::vector<Sunlight>> decodeStates(std::span<const std::byte> bytes) {
    ByteReader r(bytes);
    std::vector<Sunlight> states(r.count(1, "points"));
    for (Sunlight& state : states) state = readState(r);
    const Result<Done> end = r.end();
    if (!end) return end.error();
    return states;
}

std::vector<std::byte> encodeShares(const std::vector<float>& shares) {
    ByteWriter w;
    w.u32(static_cast<uint32_t>(shares.size()));
    for (const float share : shares) w.f32(share);
    return w.take();
}

Result<std::vector<float>> decodeShares(std::span<const std::byte> bytes) {
    ByteReader r(bytes);
    std::vector<float> shares(r.count(4, "shares"));
    for (float& share : shares) share = r.f32();
    const Result<Done> end = r.end();
    if (!end) return end.error();
    return shares;
}

}  // namespace

uint64_t keyOf(const TruthQuestion& question) {
    ByteWriter w;
    w.u32(kVersion);
    w.u64(question.world);
    const culling::View& view = question.view;
    w.dvec3(view.eye);
    w.f64(view.orientation.w), w.f64(view.orientation.x), w.f64(view.orientation.y), w.f64(view.orientation.z);
    w.f64(view.verticalFov), w.f64(view.aspect);
    w.i32(question.width), w.i32(question.height);
    w.f64(question.farDistance);
    w.dvec3(question.sun);
    for (const MovedCaster& caster : question.moved) {
        w.u32(caster.id);
        for (int k = 0; k < 3; ++k) w.vec3(caster.placement.linear[k]);
        w.dvec3(caster.placement.translation);
    }
    return world::hashBytes(w.take());
}

Result<TruthStore> TruthStore::open(const std::string& path) {
    if (!std::ofstream(path, std::ios::app))
        return Error{ErrorCode::kIo, path + ": cannot be written: its folder must exist and be writable"};
    TruthStore store(path);
    Result<world::Database> database = world::Database::openEmpty(path);
    if (!database) return store.failure(database.error());
    store.database_.emplace(std::move(database.value()));
    const Result<Done> prepared = store.prepare();
    if (!prepared) return store.failure(prepared.error());
    return store;
}

Result<Done> TruthStore::prepare() {
    world::Database& db = *database_;
    db.waitAtMost(world::kPatienceMs);
    Result<Done> done = db.run("BEGIN IMMEDIATE");
    if (!done) return done;
    const Result<std::vector<std::string>> schema = db.schema();
    if (!schema) return schema.error();
    if (schema.value().empty()) {
        done = db.run("PRAGMA application_id=" + std::to_string(kStoreId) + "; " + world::kBlobTable);
        if (!done) return done;
    } else {
        Result<world::Statement> id = db.prepare("PRAGMA application_id");
        if (!id) return id.error();
        const Result<bool> row = id.value().step();
        if (!row) return row.error();
        if (id.value().integer(0) != kStoreId || schema.value() != std::vector<std::string>{world::kBlobTable})
            return Error{ErrorCode::kBadData, "foreign"};
    }
    // A loss of power may take the last answers, which are then traced anew.
    done = db.run("COMMIT; PRAGMA journal_mode=WAL; PRAGMA synchronous=NORMAL");
    if (!done) return done;
    Result<world::Statement> find =
        db.prepare("SELECT codec, raw_size, checksum, data FROM blob WHERE x=? AND y=? AND z=? AND lod=? AND kind=?");
    if (!find) return find.error();
    find_.emplace(std::move(find.value()));
    Result<world::Statement> put = db.prepare("INSERT OR REPLACE INTO blob VALUES(?,?,?,?,?,?,?,?,?)");
    if (!put) return put.error();
    put_.emplace(std::move(put.value()));
    return Done{};
}

/// What the file says of itself in terms of a world means something else here.
Error TruthStore::failure(const Error& error) const {
    if (error.code != ErrorCode::kBadData) return error;
    const std::string what = path_ + ": no store of truths, or a damaged one: name another file, or delete it";
    return {error.code, what, error.native};
}

Result<std::optional<std::vector<std::byte>>> TruthStore::read(const BlobKey& key) {
    find_->reset();
    int parameter = 0;
    for (const int32_t part : {key.x, key.y, key.z, key.lod, static_cast<int32_t>(key.kind)})
        find_->bind(parameter++, int64_t(part));
    const Result<bool> row = find_->step();
    if (!row) return failure(row.error());
    std::optional<std::vector<std::byte>> raw;
    if (row.value()) {
        Result<std::vector<std::byte>> unpacked = world::unpackBlob(
            key, find_->integer(0), find_->integer(1), static_cast<uint64_t>(find_->integer(2)), find_->bytes(3));
        if (unpacked) raw = std::move(unpacked.value());
        else damage_.push_back(nameOf(key) + ": " + unpacked.error().what + ": traced anew");
    }
    find_->reset();  // else it would hold the file against writers
    return raw;
}

Result<Done> TruthStore::write(const BlobKey& key, std::span<const std::byte> raw) {
    const Result<world::PackedBlob> packed = world::packBlob(key, raw);
    if (!packed) return packed.error();
    const world::PackedBlob& blob = packed.value();
    int parameter = 0;
    for (const int64_t value :
         {int64_t(key.x), int64_t(key.y), int64_t(key.z), int64_t(key.lod), static_cast<int64_t>(key.kind),
          static_cast<int64_t>(blob.codec), static_cast<int64_t>(blob.rawSize), static_cast<int64_t>(blob.checksum)})
        put_->bind(parameter++, value);
    put_->bind(parameter, blob.data);
    const Result<bool> stepped = put_->step();
    put_->reset();
    if (!stepped) return failure(stepped.error());
    return Done{};
}

template <class T, class Encode, class Decode>
Result<T> TruthStore::answer(const BlobKey& key, const std::function<Result<T>()>& trace, Encode encode,
                             Decode decode) {
    const Result<std::optional<std::vector<std::byte>>> stored = read(key);
    if (!stored) return stored.error();
    if (stored.value()) {
        Result<T> decoded = decode(*stored.value());
        if (decoded) {
            ++found_;
            return decoded;
        }
        damage_.push_back(nameOf(key) + ": " + decoded.error().what + ": traced anew");
    }
    Result<T> made = trace();
    if (!made) return made;
    ++traced_;
    const Result<Done> written = write(key, encode(made.value()));
    if (!written) return written.error();
    return made;
}

Result<TruthFrame> TruthStore::frame(uint64_t key, const std::function<Result<TruthFrame>()>& trace) {
    return answer(rowOf(key), trace, encodeFrame, decodeFrame);
}

Result<std::vector<Sunlight>> TruthStore::revisit(uint64_t before, uint64_t after,
                                                  const std::function<Result<std::vector<Sunlight>>()>& trace) {
    ByteWriter w;
    w.u64(before), w.u64(after);
    return answer(rowOf(std::move(w)), trace, encodeStates, decodeStates);
}

Result<std::vector<float>> TruthStore::sunShares(uint64_t key, double angularRadius, int directions,
                                                 const std::function<Result<std::vector<float>>()>& trace) {
    ByteWriter w;
    w.u64(key), w.f64(angularRadius), w.i32(directions);
    return answer(rowOf(std::move(w)), trace, encodeShares, decodeShares);
}

}  // namespace tools
