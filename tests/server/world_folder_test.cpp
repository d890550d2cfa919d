// What a service opens: worlds of its folder, and nothing else.
#include "server/world_folder.h"

#include <fstream>

#include "tests/server/clients.h"

namespace {

namespace fs = std::filesystem;

TEST(WorldFolder, OpensWorldsOnceAndNothingOutside) {
    const std::string folder = tests::temporary("links");
    fs::create_directory(folder);
    fs::copy(tests::servedFolder() + "/streets.world", folder + "/a.world");
    fs::create_symlink("a.world", folder + "/inside.world");
    fs::create_symlink(tests::servedFolder() + "/streets.world", folder + "/outside.world");
    fs::create_symlink("gone", folder + "/dangling.world");
    fs::create_directory(folder + "/sub.world");
    fs::copy(tests::servedFolder() + "/streets.world", folder + "/.hidden.world");
    const auto made = server::WorldFolder::create(folder);
    ASSERT_TRUE(made);
    server::WorldFolder& worlds = *made.value();
    const auto a = worlds.open("a"), again = worlds.open("a");
    ASSERT_TRUE(a && again);
    EXPECT_EQ(a.value(), again.value());
    EXPECT_TRUE(worlds.open("inside"));
    for (const char* name : {"outside", "sub", "dangling", ".hidden", "..", "../links/a", "a/../a", "", "a\n"}) {
        const auto refused = worlds.open(name);
        ASSERT_FALSE(refused) << name;
        EXPECT_EQ(refused.error().what.find(folder), std::string::npos) << refused.error().what;
    }
    const auto names = worlds.names().value();
    EXPECT_EQ(std::count(names.begin(), names.end(), "a"), 1);
    EXPECT_EQ(std::count(names.begin(), names.end(), ".hidden"), 0);
    std::ofstream(folder + "/bad.world") << "no world";
    EXPECT_EQ(worlds.open("bad").error().code, world::ErrorCode::kBadData);
    EXPECT_FALSE(server::WorldFolder::create(folder + "/a.world"));
    EXPECT_FALSE(server::WorldFolder::create(folder + "/none"));
}

}  // namespace
