// tests/tools/yardstick_test.cpp — the fixed scene is what figures of it say it is.
#include "tools/yardstick.h"

#include <gtest/gtest.h>

#include <fstream>
#include <iterator>

#include "tests/server/worlds.h"
#include "world/gltf.h"

namespace {

std::string bytesOf(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
}

TEST(Yardstick, HasTenThousandBoxesOnOneGround) {
    const std::string path = tests::temporary("yardstick.glb");
    ASSERT_TRUE(tools::writeYardstick(path, 7));
    const auto source = world::openGltf(path, {0, tools::yardstickSun()});
    ASSERT_TRUE(source) << source.error().what;
    const world::WorldStore store = tests::baked(source.value(), "yardstick.world");
    EXPECT_TRUE(store.check().empty());
    ASSERT_EQ(store.meshes().size(), 2u);
    uint64_t instances = 0, triangles = 0;
    for (const world::ChunkRecord& record : store.chunks()) {
        const auto chunk = store.readChunk(record.key);
        ASSERT_TRUE(chunk) << chunk.error().what;
        instances += chunk.value().instances.size();
        for (const world::Instance& instance : chunk.value().instances)
            triangles += store.meshes()[instance.mesh].levels[0].triangles;
    }
    EXPECT_EQ(instances, 10'001u);
    EXPECT_EQ(triangles, 10'000u * 12 + 204'800);
    // Boxes are strewn all over the ground, some across its border.
    const world::Box& bounds = store.header().bounds;
    EXPECT_EQ(bounds.min.y, 0);
    EXPECT_LE(bounds.max.y, 12);
    for (const double edge : {bounds.extent().x, bounds.extent().z}) {
        EXPECT_GE(edge, 2000);
        EXPECT_LE(edge, 2010);  // half a diagonal of the widest box on each side
    }
}

TEST(Yardstick, IsTheSameForTheSameSeed) {
    for (const auto& [name, seed] : {std::pair{"a.glb", 7u}, {"b.glb", 7u}, {"c.glb", 8u}})
        ASSERT_TRUE(tools::writeYardstick(tests::temporary(name), seed));
    EXPECT_EQ(bytesOf(tests::temporary("a.glb")), bytesOf(tests::temporary("b.glb")));
    EXPECT_NE(bytesOf(tests::temporary("a.glb")), bytesOf(tests::temporary("c.glb")));
}

TEST(Yardstick, TellsWhereItCannotWrite) {
    const auto written = tools::writeYardstick("/missing/folder/yardstick.glb", 7);
    ASSERT_FALSE(written);
    EXPECT_EQ(written.error().code, world::ErrorCode::kIo);
}

}  // namespace
