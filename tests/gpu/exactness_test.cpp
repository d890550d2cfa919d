// A texel's depth depends on what covers it, never on how the drawing was cut into passes and frames.
#include <algorithm>
#include <cmath>

#include "scene.h"

namespace gpu::test {
namespace {

class Exactness : public MapsTest, public testing::WithParamInterface<DepthFormat> {
protected:
    Exactness() { config.format = GetParam(); }

    void makeLevels(std::mt19937& rng) {
        levels = {box(), triangleSoup(rng, 1), triangleSoup(rng, 7), triangleSoup(rng, 128),
                  triangleSoup(rng, 500)};
        for (const world::MeshLevel& level : levels) ids.push_back(upload(level));
    }
    /// Draws the scene in random disjoint pieces, each in a frame of its own, over whatever the map
    /// holds, with the items that a piece needs and some that it does not.
    void drawInPieces(std::mt19937& rng, const Scene& scene, int cuts) {
        std::vector<cache::StoreRect> pieces;
        shatter(rng, {glm::ivec2(0), glm::ivec2(scene.side)}, cuts, pieces);
        std::shuffle(pieces.begin(), pieces.end(), rng);
        for (const cache::StoreRect& piece : pieces) {
            cache::FramePlan plan;
            plan.transforms = scene.transforms;
            for (size_t i = 0; i < scene.items.size(); ++i)
                if (overlap(scene.bounds[i], piece) || rng() % 8 == 0) plan.items.push_back(scene.items[i]);
            std::shuffle(plan.items.begin(), plan.items.end(), rng);
            plan.cascades.resize(1);
            plan.cascades[0].clears = {piece};
            plan.cascades[0].staticPasses = {{piece, 0, static_cast<uint32_t>(plan.items.size())}};
            execute(plan);
        }
    }

    std::vector<world::MeshLevel> levels;
    std::vector<cache::GeometryId> ids;
};

TEST_P(Exactness, PiecesEqualTheWhole) {
    for (const int side : {64, 200, 1024}) {
        std::mt19937 rng(static_cast<uint32_t>(side));
        ids.clear();
        makeMaps(side);
        makeLevels(rng);
        for (int round = 0; round < (side < 1000 ? 8 : 2); ++round) {
            const Scene scene = randomScene(rng, side, 60, 0.3, side, levels, ids);
            redraw(scene.whole());
            const std::vector<float> whole = read(MapKind::kScratchCache);
            ASSERT_GT(covered(whole), 0.2);
            drawInPieces(rng, scene, 24);
            ASSERT_EQ(differing(read(MapKind::kCache), whole), 0u) << "side " << side << ", round " << round;
        }
        maps.reset();
    }
}

TEST_P(Exactness, PiecesEqualTheWholeForTrianglesFarLargerThanTheMap) {
    const int side = 256;
    std::mt19937 rng(11);
    makeMaps(side);
    makeLevels(rng);
    for (const double reach : {1e3, 1e4, 1e5}) {
        for (int round = 0; round < 4; ++round) {
            const Scene scene = randomScene(rng, side, 40, reach / 30, reach, levels, ids);
            redraw(scene.whole());
            const std::vector<float> whole = read(MapKind::kScratchCache);
            ASSERT_GT(covered(whole), 0.2);
            drawInPieces(rng, scene, 24);
            ASSERT_EQ(differing(read(MapKind::kCache), whole), 0u)
                << "reach " << reach << ", round " << round;
        }
    }
}

TEST_P(Exactness, OrderAndGroupingOfItemsDoNotMatter) {
    const int side = 128;
    std::mt19937 rng(3);
    makeMaps(side);
    makeLevels(rng);
    const Scene scene = randomScene(rng, side, 200, 0.3, 60, levels, ids);
    redraw(scene.whole());
    const std::vector<float> whole = read(MapKind::kScratchCache);
    for (int round = 0; round < 6; ++round) {
        cache::FramePlan plan = scene.whole();
        std::shuffle(plan.items.begin(), plan.items.end(), rng);
        // Passes of random lengths under one scissor, one item each in the first round.
        const cache::StoreRect map = plan.cascades[0].clears[0];
        plan.cascades[0].staticPasses.clear();
        for (uint32_t first = 0; first < plan.items.size();) {
            const uint32_t most = static_cast<uint32_t>(plan.items.size()) - first;
            const uint32_t count = round == 0 ? 1 : std::min(most, static_cast<uint32_t>(rng() % 40));
            plan.cascades[0].staticPasses.push_back({map, first, count});
            first += count;
        }
        execute(plan);
        ASSERT_EQ(differing(read(MapKind::kCache), whole), 0u) << "round " << round;
    }
}

TEST_P(Exactness, InstancedDrawsEqualSeparateOnes) {
    const int side = 256;
    std::mt19937 rng(5);
    makeMaps(side);
    // One mesh drawn often: a single instanced draw. Its copies, uploaded apart, cannot be merged.
    const world::MeshLevel level = triangleSoup(rng, 20);
    const cache::GeometryId shared = upload(level);
    Scene scene = randomScene(rng, side, 150, 0.3, 80, {level}, {shared});
    for (cache::DrawItem& item : scene.items) item = {shared, 0, 60, item.transform};
    execute(scene.whole());
    const std::vector<float> instanced = read(MapKind::kCache);
    ASSERT_GT(covered(instanced), 0.5);
    for (cache::DrawItem& item : scene.items) item.geometry = upload(level);
    redraw(scene.whole());
    ASSERT_EQ(differing(read(MapKind::kScratchCache), instanced), 0u);
}

TEST_P(Exactness, AClearedAndRedrawnRectangleIsAsBefore) {
    const int side = 200;
    std::mt19937 rng(13);
    makeMaps(side);
    makeLevels(rng);
    const Scene scene = randomScene(rng, side, 80, 0.3, 100, levels, ids);
    execute(scene.whole());
    const std::vector<float> before = read(MapKind::kCache);
    std::uniform_int_distribution<int> at(0, side - 1);
    for (int round = 0; round < 20; ++round) {
        const glm::ivec2 a(at(rng), at(rng)), b(at(rng), at(rng));
        const cache::StoreRect rect{glm::min(a, b), glm::max(a, b) + 1};
        cache::FramePlan plan = scene.whole();
        plan.cascades[0].clears = {rect};
        plan.cascades[0].staticPasses[0].scissor = rect;
        plan.cascades[0].staticPasses[0].itemCount = 0;
        execute(plan);
        std::vector<float> cleared = before;
        for (int y = rect.min.y; y < rect.max.y; ++y)
            for (int x = rect.min.x; x < rect.max.x; ++x) cleared[static_cast<size_t>(y * side + x)] = 1;
        ASSERT_EQ(differing(read(MapKind::kCache), cleared), 0u) << "round " << round;
        plan.cascades[0].staticPasses[0].itemCount = static_cast<uint32_t>(plan.items.size());
        execute(plan);
        ASSERT_EQ(differing(read(MapKind::kCache), before), 0u) << "round " << round;
    }
}

INSTANTIATE_TEST_SUITE_P(Formats, Exactness, testing::Values(DepthFormat::kD32, DepthFormat::kD16),
                         [](const auto& test) { return nameOf(test.param); });

}  // namespace
}  // namespace gpu::test
