// Recordings: what was written comes back, cut or damaged anywhere.
#include "server/recording.h"

#include <fstream>

#include "tests/server/worlds.h"
#include "tests/world/file_size_limit.h"

namespace {

using server::EntryKind;
using server::RecordingReader;
using server::RecordingWriter;

std::string contents(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
}
void write(const std::string& path, const std::string& bytes) { std::ofstream(path, std::ios::binary | std::ios::trunc) << bytes; }

std::vector<std::string> messages() { return {"", "a", std::string(3000, 'x'), std::string("\0\1\2", 3), "the last"}; }

std::string recorded(const std::string& name) {
    const std::string path = tests::temporary(name);
    auto writer = RecordingWriter::create(path);
    EXPECT_TRUE(writer);
    size_t k = 0;
    for (const std::string& message : messages()) EXPECT_TRUE(writer.value().add(++k % 2 ? EntryKind::kRequest : EntryKind::kReply, message));
    return path;
}

TEST(Recording, GivesBackWhatWasWrittenCutAnywhere) {
    const std::string path = recorded("whole.gnomonrec"), all = contents(path);
    std::vector<size_t> ends{server::kRecordingMagic.size()};
    for (const std::string& m : messages()) ends.push_back(ends.back() + 13 + m.size());
    ASSERT_EQ(ends.back(), all.size());
    const std::string cut = tests::temporary("cut.gnomonrec");
    for (size_t length = 0; length <= all.size(); length += length < 60 || length + 60 > all.size() ? 1 : 37) {
        write(cut, all.substr(0, length));
        auto reader = RecordingReader::open(cut);
        ASSERT_EQ(bool(reader), length >= ends[0]) << length;
        if (!reader) continue;
        size_t got = 0;
        for (;;) {
            const auto entry = reader.value().next();
            ASSERT_TRUE(entry) << entry.error().what;
            if (!entry.value()) break;
            EXPECT_EQ(entry.value()->message, messages()[got]);
            EXPECT_EQ(entry.value()->kind, got % 2 ? EntryKind::kReply : EntryKind::kRequest);
            ++got;
        }
        size_t whole = 0;
        while (whole < messages().size() && ends[whole + 1] <= length) ++whole;
        EXPECT_EQ(got, whole) << length;
        EXPECT_EQ(reader.value().torn(), length != ends[whole]) << length;
    }
}

TEST(Recording, AnyFlippedBitIsSeen) {
    const std::string path = recorded("sound.gnomonrec"), all = contents(path);
    const std::string bad = tests::temporary("bad.gnomonrec");
    for (size_t at = 0; at < all.size(); at += at < 80 ? 1 : 101)
        for (const int bit : {0, 5, 7}) {
            std::string bytes = all;
            bytes[at] = char(bytes[at] ^ (1 << bit));
            write(bad, bytes);
            auto reader = RecordingReader::open(bad);
            if (!reader) continue;
            bool seen = false;
            for (size_t got = 0; !seen;) {
                const auto entry = reader.value().next();
                seen = !entry;  // or a length that reaches beyond the file:
                if (entry && !entry.value()) {
                    seen = reader.value().torn();
                    break;
                }
                if (!entry) break;
                ASSERT_EQ(entry.value()->message, messages()[got++]);
            }
            EXPECT_TRUE(seen) << "byte " << at << ", bit " << bit;
        }
}

TEST(Recording, AFullDiskKeepsWholeEntries) {
    const std::string path = tests::temporary("full.gnomonrec");
    auto writer = RecordingWriter::create(path);
    ASSERT_TRUE(writer);
    uint64_t kept = 0;
    {
        const world_tests::FileSizeLimit limit(10'000);
        for (;;) {
            const auto added = writer.value().add(EntryKind::kRequest, std::string(700, 'm'));
            if (!added) {
                EXPECT_EQ(added.error().code, world::ErrorCode::kIo);
                EXPECT_NE(added.error().what.find("full.gnomonrec"), std::string::npos);
                break;
            }
            ASSERT_LT(++kept, 100u);
        }
        EXPECT_FALSE(writer.value().add(EntryKind::kRequest, "m")) << "it is over";
    }
    auto reader = RecordingReader::open(path);
    ASSERT_TRUE(reader);
    uint64_t got = 0;
    while (reader.value().next().value()) ++got;
    EXPECT_EQ(got, kept);
    EXPECT_FALSE(reader.value().torn());
}

TEST(Recording, AnExistingFileIsNotOverwritten) {
    const std::string path = recorded("kept.gnomonrec");
    EXPECT_FALSE(RecordingWriter::create(path));
    EXPECT_FALSE(RecordingReader::open(tests::temporary("none.gnomonrec")));
}

}  // namespace
