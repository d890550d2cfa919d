#include "world/codec.h"

#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <random>

#include "random_world.h"
#include "world/bytes.h"
#include "world/clusters.h"
#include "world/store.h"

namespace {

using namespace world;
using Bytes = std::vector<std::byte>;

constexpr float kInf = std::numeric_limits<float>::infinity();

Box anyBox(std::mt19937& rng) {
    std::uniform_real_distribution<double> at(-1e6, 1e6);
    Box box;
    if (rng() % 8 == 0) return box;
    const glm::dvec3 p(at(rng), at(rng), at(rng)), q(at(rng), at(rng), at(rng));
    box.add(p);
    box.add(q);
    return box;
}

Header randomHeader(std::mt19937& rng) {
    Header header;
    header.chunkSize = 1 + rng() % 1000;
    header.bounds = anyBox(rng);
    header.sun = rng() % 2 ? glm::normalize(glm::dvec3(0.3, -1, 0.2)) : glm::dvec3(0);
    header.voxel = rng() % 4;
    header.source = std::string(rng() % 20, 'x');
    return header;
}

std::vector<LevelRecord> randomLevels(size_t count, std::mt19937& rng) {
    std::vector<LevelRecord> levels;
    while (levels.size() < count) {
        const auto error = static_cast<float>(levels.size());
        levels.push_back({uint32_t(rng()), uint32_t(rng()), uint32_t(rng()), error});
    }
    return levels;
}

std::vector<ChunkRecord> randomDirectory(std::mt19937& rng) {
    std::vector<ChunkRecord> records(rng() % 6);
    int32_t x = std::numeric_limits<int32_t>::min();
    for (ChunkRecord& r : records) {
        r.key = {x, static_cast<int32_t>(rng()), static_cast<int32_t>(rng())};
        x += 1 + static_cast<int32_t>(rng() % 100);
        r.bounds = anyBox(rng);
        r.instances = rng();
        r.terrain = randomLevels(rng() % 5, rng);
        for (uint32_t id = rng() % 3; r.meshes.size() < rng() % 5; id += 1 + rng() % 9)
            r.meshes.push_back(id);
    }
    return records;
}

std::vector<MeshRecord> randomTable(std::mt19937& rng) {
    std::vector<MeshRecord> records(rng() % 5);
    for (MeshRecord& r : records) {
        r.bounds = anyBox(rng);
        r.levels = randomLevels(1 + rng() % 4, rng);
    }
    return records;
}

std::vector<NamedInstance> randomNames(std::mt19937& rng) {
    std::vector<NamedInstance> names(rng() % 5);
    for (size_t i = 0; i < names.size(); ++i)
        names[i] = {"name" + std::to_string(i / 2),
                    {static_cast<int32_t>(i), 0, -3},
                    static_cast<uint32_t>(rng() % 9)};
    return names;
}

std::vector<Instance> randomInstances(std::mt19937& rng) {
    std::uniform_real_distribution<float> f(-1e3f, 1e3f);
    std::vector<Instance> row(rng() % 5);
    for (Instance& i : row) {
        i.mesh = rng();
        for (int c = 0; c < 3; ++c)
            for (int r = 0; r < 3; ++r) i.placement.linear[c][r] = f(rng);
        i.placement.translation = glm::dvec3(f(rng), f(rng), f(rng)) * 1e6;
    }
    return row;
}

MeshLevel randomLevel(std::mt19937& rng) {
    const uint32_t side = rng() % 14;
    MeshLevel level = side == 0 ? MeshLevel{} : world_tests::patch(side, 0.5f, rng);
    buildClusters(level);
    return level;
}

/// One kind of row: makes random ones, and tells of any bytes whether they decode to the same bytes.
struct Kind {
    const char* name;
    std::function<Bytes(std::mt19937&)> make;
    std::function<Result<Bytes>(std::span<const std::byte>)> again;  ///< decode, then encode
};

template <class T>
Kind kind(const char* name, T (*make)(std::mt19937&), Bytes (*encode)(const T&),
          Result<T> (*decode)(std::span<const std::byte>)) {
    return {name, [=](std::mt19937& rng) { return encode(make(rng)); },
            [=](std::span<const std::byte> bytes) -> Result<Bytes> {
                const Result<T> value = decode(bytes);
                if (!value) return value.error();
                return encode(value.value());
            }};
}

template <class T, Bytes (*encode)(std::span<const T>)>
Bytes encodeList(const std::vector<T>& list) {
    return encode(list);
}

std::vector<Kind> kinds() {
    return {kind<Header>("header", randomHeader, encodeHeader, decodeHeader),
            kind<std::vector<ChunkRecord>>("directory", randomDirectory,
                                           encodeList<ChunkRecord, encodeDirectory>, decodeDirectory),
            kind<std::vector<MeshRecord>>("mesh table", randomTable, encodeList<MeshRecord, encodeMeshTable>,
                                          decodeMeshTable),
            kind<std::vector<NamedInstance>>("names", randomNames, encodeList<NamedInstance, encodeNames>,
                                             decodeNames),
            kind<std::vector<Instance>>("instances", randomInstances, encodeList<Instance, encodeInstances>,
                                        decodeInstances),
            kind<MeshLevel>("mesh level", randomLevel, encodeMeshLevel, decodeMeshLevel)};
}

// Encoding is injective (fields are copied as they are), so equal bytes mean equal values.
TEST(Codec, GivesBackWhatItTook) {
    for (const Kind& k : kinds()) {
        std::mt19937 rng(11);
        for (int step = 0; step < 200; ++step) {
            const Bytes bytes = k.make(rng);
            const Result<Bytes> again = k.again(bytes);
            ASSERT_TRUE(again) << k.name << " step " << step << ": " << again.error().what;
            ASSERT_EQ(bytes, again.value()) << k.name << " step " << step;
        }
    }
}

TEST(Codec, KeepsEveryField) {
    std::mt19937 rng(12);
    for (int step = 0; step < 100; ++step) {
        const Header h = randomHeader(rng), h2 = decodeHeader(encodeHeader(h)).value();
        ASSERT_TRUE(h.version == h2.version && h.chunkSize == h2.chunkSize && h.bounds == h2.bounds &&
                    h.sun == h2.sun && h.voxel == h2.voxel && h.source == h2.source);
        const auto d = randomDirectory(rng), d2 = decodeDirectory(encodeDirectory(d)).value();
        ASSERT_EQ(d.size(), d2.size());
        for (size_t i = 0; i < d.size(); ++i)
            ASSERT_TRUE(d[i].key == d2[i].key && d[i].bounds == d2[i].bounds &&
                        d[i].instances == d2[i].instances && d[i].terrain == d2[i].terrain &&
                        d[i].meshes == d2[i].meshes);
        const auto t = randomTable(rng), t2 = decodeMeshTable(encodeMeshTable(t)).value();
        ASSERT_EQ(t.size(), t2.size());
        for (size_t i = 0; i < t.size(); ++i)
            ASSERT_TRUE(t[i].levels == t2[i].levels && t[i].bounds == t2[i].bounds);
        const auto n = randomNames(rng), n2 = decodeNames(encodeNames(n)).value();
        ASSERT_EQ(n, n2);
        const auto r = randomInstances(rng), r2 = decodeInstances(encodeInstances(r)).value();
        ASSERT_EQ(r.size(), r2.size());
        for (size_t i = 0; i < r.size(); ++i)
            ASSERT_TRUE(r[i].mesh == r2[i].mesh && r[i].placement == r2[i].placement);
        const MeshLevel l = randomLevel(rng), l2 = decodeMeshLevel(encodeMeshLevel(l)).value();
        ASSERT_TRUE(l.error == l2.error && l.positions == l2.positions && l.indices == l2.indices);
        ASSERT_EQ(l.clusters.size(), l2.clusters.size());
        for (size_t i = 0; i < l.clusters.size(); ++i)
            ASSERT_TRUE(l.clusters[i].firstIndex == l2.clusters[i].firstIndex &&
                        l.clusters[i].indexCount == l2.clusters[i].indexCount &&
                        l.clusters[i].min == l2.clusters[i].min && l.clusters[i].max == l2.clusters[i].max);
    }
}

TEST(Codec, RefusesEveryTruncationAndAnyTail) {
    for (const Kind& k : kinds()) {
        std::mt19937 rng(13);
        for (int step = 0; step < 12; ++step) {
            Bytes bytes = k.make(rng);
            for (size_t length = 0; length < bytes.size(); ++length) {
                // A copy of its own, so that a checker of addresses sees a read past the end.
                const Bytes part(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(length));
                const Result<Bytes> result = k.again(part);
                ASSERT_FALSE(result) << k.name << " cut to " << length << " of " << bytes.size();
                ASSERT_EQ(result.error().code, ErrorCode::kBadData);
            }
            bytes.push_back(std::byte{0});
            ASSERT_FALSE(k.again(bytes)) << k.name << " with a byte more";
        }
    }
}

// What decodes at all must be what an encoder could have written.
TEST(Codec, SurvivesEveryFlippedBitAndRandomBytes) {
    for (const Kind& k : kinds()) {
        std::mt19937 rng(14);
        for (int step = 0; step < 4; ++step) {
            const Bytes bytes = k.make(rng);
            for (size_t bit = 0; bit < bytes.size() * 8; ++bit) {
                Bytes flipped = bytes;
                flipped[bit / 8] ^= std::byte{1} << bit % 8;
                const Result<Bytes> again = k.again(flipped);
                // A header of a newer version is told by its version alone.
                if (!again || flipped == again.value()) continue;
                ASSERT_STREQ(k.name, "header") << "bit " << bit;
                ASSERT_GT(decodeHeader(flipped).value().version, kWorldVersion) << "bit " << bit;
            }
        }
        for (int step = 0; step < 2000; ++step) {
            Bytes noise(rng() % 200);
            for (std::byte& b : noise) b = std::byte(rng() % 4 ? 0 : rng() & 255);
            const Result<Bytes> again = k.again(noise);
            if (!again || noise == again.value()) continue;
            ASSERT_STREQ(k.name, "header");
            ASSERT_GT(decodeHeader(noise).value().version, kWorldVersion);
        }
    }
}

TEST(Codec, TrustsNoCount) {
    for (const Kind& k : kinds()) {
        if (std::string_view(k.name) == "header") continue;
        for (size_t at = 0; at <= 8; at += 4) {
            Bytes bytes(64);
            for (size_t i = at; i < at + 4; ++i) bytes[i] = std::byte{0xff};
            EXPECT_FALSE(k.again(bytes)) << k.name << " count at " << at;
        }
    }
}

TEST(Codec, RefusesWhatIsNotFiniteOrOutOfRange) {
    std::mt19937 rng(15);
    MeshLevel level = world_tests::patch(3, 0, rng);
    buildClusters(level);
    const auto refused = [&](const std::function<void(MeshLevel&)>& damage) {
        MeshLevel bad = level;
        damage(bad);
        return !decodeMeshLevel(encodeMeshLevel(bad));
    };
    ASSERT_FALSE(refused([](MeshLevel&) {}));
    EXPECT_TRUE(refused([](MeshLevel& l) { l.positions[3].y = kInf; }));
    EXPECT_TRUE(refused([](MeshLevel& l) { l.positions[0].x = std::nanf(""); }));
    EXPECT_TRUE(refused([](MeshLevel& l) { l.error = -1; }));
    EXPECT_TRUE(refused([](MeshLevel& l) { l.indices[5] = static_cast<uint32_t>(l.positions.size()); }));
    EXPECT_TRUE(refused([](MeshLevel& l) { l.clusters.pop_back(); }));
    EXPECT_TRUE(refused([](MeshLevel& l) { l.clusters.push_back(l.clusters.back()); }));
    EXPECT_TRUE(refused([](MeshLevel& l) { l.clusters[0].indexCount -= 1; }));
    EXPECT_TRUE(refused([](MeshLevel& l) { l.clusters[0].firstIndex = 3; }));
    EXPECT_TRUE(refused([](MeshLevel& l) { l.clusters[0].max.z = kInf; }));

    std::vector<Instance> row(1);
    row[0].placement.translation.z = kInf;
    EXPECT_FALSE(decodeInstances(encodeInstances(row)));

    Header header;
    header.chunkSize = 0;
    EXPECT_FALSE(decodeHeader(encodeHeader(header)));
    header.chunkSize = 10;
    EXPECT_TRUE(decodeHeader(encodeHeader(header)));
    header.sun = {0, -2, 0};
    EXPECT_FALSE(decodeHeader(encodeHeader(header)));

    ChunkRecord a, b, twice;
    a.key = {0, 0, 1};
    b.key = {0, 0, 2};
    twice.meshes = {3, 3};
    EXPECT_TRUE(decodeDirectory(encodeDirectory(std::vector{a, b})));
    EXPECT_FALSE(decodeDirectory(encodeDirectory(std::vector{b, a})));
    EXPECT_FALSE(decodeDirectory(encodeDirectory(std::vector{a, a})));
    EXPECT_FALSE(decodeDirectory(encodeDirectory(std::vector{twice})));
    EXPECT_FALSE(decodeMeshTable(encodeMeshTable(std::vector{MeshRecord{}}))) << "a mesh without levels";
    EXPECT_FALSE(decodeNames(encodeNames(std::vector<NamedInstance>{{"b", {}, 0}, {"a", {}, 0}})));
}

TEST(Codec, ReadsTheVersionOfANewerHeader) {
    ByteWriter w;
    w.u32(kWorldVersion + 7);
    w.string("fields of another age");
    const Result<Header> header = decodeHeader(w.take());
    ASSERT_TRUE(header);
    EXPECT_EQ(header.value().version, kWorldVersion + 7);
}

}  // namespace
