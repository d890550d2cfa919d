// A system that has seen much come and go holds no more than before.
#include <tbb/global_control.h>

#include "tests/server/allocated.h"
#include "tests/server/worlds.h"

namespace {

using server::ObjectId;

/// Each round, `small` boxes and then one large roof come and go: the roof gets another caster's number each time.
class Passers {
public:
    Passers(server::ShadowSystem& system, uint32_t box, uint32_t roof) : system_(system), box_(box), roof_(roof) {}
    /// Returns the certificates that came with them.
    uint64_t pass(int small) {
        std::vector<ObjectId> objects;
        for (int i = 0; i < small; ++i)
            objects.push_back(system_.spawn(box_, tests::placedAt({i % 10 - 5, 1, i / 10 - 3}), {.atRest = true}).value());
        objects.push_back(system_.spawn(roof_, tests::placedAt({0, 8, 0}), {.atRest = true}).value());
        const uint64_t certificates = frame().certificates;
        for (const ObjectId object : objects) EXPECT_TRUE(system_.remove(object));
        frame();
        return certificates;
    }
    /// Until nothing waits for certificates any more, which come to what stays a few in each frame.
    void settle() {
        while (frame().rays > 0) {
        }
    }

private:
    server::FrameReport frame() {
        auto report = system_.advance({double(frame_++) / 30, {{0, 2, 0}, {1, 0, 0, 0}}, {}});
        EXPECT_TRUE(report) << report.error().what;
        return std::move(report.value());
    }
    server::ShadowSystem& system_;
    uint32_t box_, roof_;
    uint64_t frame_ = 0;
};

TEST(LongLife, KeepsNothingOfWhatIsGone) {
    world::BakeSource source = tests::streets(glm::dvec3(0));
    world::Mesh roof = tests::sheetMesh(60, 100);  // 20,000 triangles
    roof.levels[0].clusters.clear();
    source.meshes.push_back(std::move(roof));
    const world::WorldStore store = tests::baked(source, "long.world");
    server::ShadowConfig config;
    config.cascades = 2;
    config.side = 128;
    config.farDistance = 45;
    config.geometryBytes = 16 << 20;
    const auto device = gpu::Device::create({});  // without validation, which takes notes of its own
    ASSERT_TRUE(device) << device.error().what;
    const auto system = server::ShadowSystem::create(*device.value(), store, config);
    ASSERT_TRUE(system) << system.error().what;

    // Each thread keeps the memory that the largest search took on it, whatever came and went; of two, the other may meet
    // the roof at any time.
    const tbb::global_control alone(tbb::global_control::max_allowed_parallelism, 1);
    constexpr int kMost = 60;
    Passers passers(*system.value(), 0, uint32_t(source.meshes.size() - 1));
    for (int i = 0; i < 5; ++i) passers.pass(kMost);
    passers.settle();
    const int64_t before = tests::allocatedBytes();
    uint64_t certificates = 0;
    for (int small = 0; small <= kMost; ++small) certificates += passers.pass(small);
    passers.settle();
    const int64_t after = tests::allocatedBytes();
    EXPECT_GT(certificates, 1000u) << "roofs that hide nothing leave nothing to be kept";
    // A list that is kept for its memory grows by 8 kB once, and no more in further lives. What was kept of the roofs'
    // proofs came to 22 kB, of their rectangles to 169, of 1,891 objects to 234.
    EXPECT_LT(after - before, 12 << 10);
}

}  // namespace
