// Submissions that overlap leave what submissions one by one leave, and take nothing new to do it.
#include <deque>

#include "gpu/device_impl.h"
#include "scene.h"

namespace gpu::test {
namespace {

class FramesInFlight : public MapsTest {
protected:
    Ticket submit(const cache::FramePlan& plan) {
        auto ticket = maps->submit(plan);
        EXPECT_TRUE(ticket) << ticket.error().what;
        return ticket ? ticket.value() : 0;
    }
    GpuTimes finish(Ticket ticket) {
        auto times = maps->finish(ticket);
        EXPECT_TRUE(times) << times.error().what;
        return times ? times.value() : GpuTimes{};
    }
    /// A seeded run of plans with uploads and releases between them; the maps on the way, `lag` plans
    /// being finished behind the last one submitted.
    std::vector<std::vector<float>> run(int framesInFlight, size_t lag) {
        const int side = 96, cascades = 2;
        config.framesInFlight = framesInFlight;
        makeMaps(side, cascades);
        std::mt19937 rng(41);
        std::vector<world::MeshLevel> levels;
        std::vector<cache::GeometryId> ids;
        const auto renew = [&](size_t i) {
            levels[i] = triangleSoup(rng, 1 + static_cast<int>(rng() % 200));
            ids[i] = upload(levels[i]);
        };
        for (size_t i = 0; i < 8; ++i) {
            levels.emplace_back();
            ids.push_back(0);
            renew(i);
        }
        std::vector<std::vector<float>> seen;
        std::deque<Ticket> open;
        Ticket before = 0;
        for (int step = 0; step < 150; ++step) {
            cache::FramePlan plan;
            plan.cascades.resize(cascades);
            for (cache::CascadePlan& cascade : plan.cascades) {
                if (rng() % 5 == 0) continue;
                std::vector<cache::StoreRect> pieces;
                shatter(rng, {glm::ivec2(0), glm::ivec2(side)}, 6, pieces);
                Scene scene = randomScene(rng, side, static_cast<int>(rng() % 60), 0.3, side, levels, ids);
                const auto offset = static_cast<uint32_t>(plan.transforms.size());
                for (cache::DrawItem& item : scene.items) item.transform += offset;
                const cache::DrawPass pass{pieces[0], static_cast<uint32_t>(plan.items.size()),
                                           static_cast<uint32_t>(scene.items.size())};
                plan.items.insert(plan.items.end(), scene.items.begin(), scene.items.end());
                plan.transforms.insert(plan.transforms.end(), scene.transforms.begin(),
                                       scene.transforms.end());
                if (rng() % 4 == 0) cascade.unknowns = {pieces[1]};
                cascade.clears = {pieces[0]};
                cascade.staticPasses = {pass};
                cascade.restores = pieces;
                if (rng() % 2) cascade.activePasses = {{pieces.back(), pass.firstItem, pass.itemCount}};
            }
            open.push_back(submit(plan));
            EXPECT_GT(open.back(), before);
            before = open.back();
            // What the plan still draws makes room for what comes.
            const size_t changed = rng() % levels.size();
            maps->release(ids[changed]);
            renew(changed);
            for (; open.size() > lag; open.pop_front()) finish(open.front());
            if (step % 30 == 29)
                for (int c = 0; c < cascades; ++c)
                    for (const MapKind kind : {MapKind::kCache, MapKind::kWorking})
                        seen.push_back(read(kind, c));
        }
        maps.reset();  // with submissions under way
        return seen;
    }
};

TEST_F(FramesInFlight, LeaveTheSameMapsForAnyNumber) {
    const std::vector<std::vector<float>> alone = run(1, 0);
    ASSERT_GT(covered(alone.back()), 0.1);
    for (const int framesInFlight : {1, 2, 3})
        for (const size_t lag : {1, 2, 5}) {
            const std::vector<std::vector<float>> seen = run(framesInFlight, lag);
            ASSERT_EQ(seen.size(), alone.size());
            for (size_t i = 0; i < seen.size(); ++i)
                ASSERT_EQ(differing(seen[i], alone[i]), 0u)
                    << framesInFlight << " in flight, " << lag << " open, read " << i;
        }
}

TEST_F(FramesInFlight, KeepTheTimesOfTicketsWhosePlaceIsTaken) {
    const int side = 64;
    makeMaps(side);
    std::mt19937 rng(43);
    const world::MeshLevel soup = triangleSoup(rng, 100);
    const Scene scene = randomScene(rng, side, 50, 0.3, side, {soup}, {upload(soup)});
    cache::FramePlan idle;
    idle.cascades.resize(1);
    std::vector<Ticket> busy, atRest;
    for (int i = 0; i < 20; ++i) {
        busy.push_back(submit(scene.whole()));
        atRest.push_back(submit(idle));
        EXPECT_FALSE(finish(atRest.back()).submitted) << "finished at once";
    }
    for (Ticket i = 0; i < ShadowMaps::kTicketsKept; ++i) read(MapKind::kCache);  // they take no ticket
    for (const Ticket ticket : busy) {
        const GpuTimes times = finish(ticket);
        EXPECT_TRUE(times.submitted);
        EXPECT_GT(times.wallMs, 0);
        EXPECT_GT(times.recordMs, 0);
        EXPECT_EQ(finish(ticket).wallMs, times.wallMs) << "it may be asked twice";
    }
    for (const Ticket ticket : atRest) EXPECT_EQ(finish(ticket).wallMs, 0);
}

TEST_F(FramesInFlight, ReleasedSpaceIsTakenOnlyWhenItsReadersHaveFinished) {
    const int side = 512;
    std::mt19937 rng(47);
    const world::MeshLevel soup = triangleSoup(rng, 500), other = triangleSoup(rng, 500);
    ASSERT_EQ(soup.positions.size(), other.positions.size());
    makeMaps(side, 1, soup.positions.size() * 12 + soup.indices.size() * 4);  // room for one of them
    const cache::GeometryId id = upload(soup);
    const uint64_t bytes = maps->geometryBytesUsed();
    const Scene scene = randomScene(rng, side, 300, 10, side, {soup}, {id});
    finish(submit(scene.whole()));
    const std::vector<float> drawn = read(MapKind::kCache);
    ASSERT_GT(covered(drawn), 0.1);
    EXPECT_EQ(maps->upload(other).error().code, world::ErrorCode::kLimit);

    submit(scene.whole());
    maps->release(id);
    EXPECT_EQ(maps->geometryBytesUsed(), 0u) << "whether the GPU reads it or not";
    EXPECT_EQ(upload(other), id) << "the number is free again";
    EXPECT_EQ(maps->geometryBytesUsed(), bytes);
    EXPECT_EQ(differing(read(MapKind::kCache), drawn), 0u);
}

TEST_F(FramesInFlight, NumbersOfMeshesDoNotFollowTheGpu) {
    const int side = 512;
    makeMaps(side);
    std::mt19937 rng(59);
    const world::MeshLevel soup = triangleSoup(rng, 500);
    cache::GeometryId id = upload(soup);
    const uint64_t bytes = maps->geometryBytesUsed();
    for (int i = 0; i < 5; ++i) {
        const Ticket ticket = submit(randomScene(rng, side, 100, 10, side, {soup}, {id}).whole());
        maps->release(id);
        const cache::GeometryId next = upload(soup);
        EXPECT_EQ(next, id) << "while the GPU reads, or when it has finished";
        id = next;
        finish(ticket);
    }
    EXPECT_EQ(maps->geometryBytesUsed(), bytes);
}

TEST_F(FramesInFlight, ASteadyStateCreatesNoObject) {
    const int side = 64;
    config.framesInFlight = 3;
    makeMaps(side, 2);
    std::mt19937 rng(53);
    const world::MeshLevel soup = triangleSoup(rng, 5);
    const Scene scene = randomScene(rng, side, 4000, 0.3, 4, {soup}, {upload(soup)});
    cache::FramePlan plan = scene.whole();
    plan.cascades.resize(2, plan.cascades[0]);
    plan.cascades[1].restores = plan.cascades[1].clears;
    const std::atomic<uint64_t>& created = device->impl().owner.created;
    const uint64_t before = created;
    for (int i = 0; i < config.framesInFlight; ++i) submit(plan);
    EXPECT_GT(created, before) << "each place's buffers have grown";
    const uint64_t grown = created;
    for (int i = 0; i < 30; ++i) finish(submit(plan));
    for (int i = 0; i < 30; ++i) submit(plan);
    EXPECT_EQ(created, grown);
}

using FramesInFlightDeathTest = FramesInFlight;

TEST_F(FramesInFlightDeathTest, StopAtATicketThatIsNotTheirs) {
    GTEST_FLAG_SET(death_test_style, "threadsafe");  // the driver has threads
    makeMaps(16);
    cache::FramePlan idle;
    Ticket ticket = submit(idle);
    EXPECT_DEATH(static_cast<void>(maps->finish(ticket + 1)), "broken invariant");
    EXPECT_DEATH(static_cast<void>(maps->finish(0)), "broken invariant");
    for (Ticket i = 1; i < ShadowMaps::kTicketsKept; ++i) submit(idle);
    EXPECT_FALSE(finish(ticket).submitted);
    submit(idle);
    EXPECT_DEATH(static_cast<void>(maps->finish(ticket)), "broken invariant");
}

}  // namespace
}  // namespace gpu::test
