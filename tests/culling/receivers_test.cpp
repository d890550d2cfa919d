// Which cascades nobody can see: against points thrown into every caster.
#include "culling/receivers.h"

#include <gtest/gtest.h>

#include <random>

#include "tests/toy_scene.h"

namespace {

const std::vector<culling::Cascade> kThreeCascades{{5, 0.1}, {20, 0.4}, {80, 1.6}};

/// Whether a cascade serves the point and the view sees it.
bool serves(const culling::View& view, size_t cascade, glm::dvec3 p) {
    const glm::dvec3 local = glm::conjugate(view.orientation) * (p - view.eye);
    const double away = glm::length(local), up = std::tan(view.verticalFov / 2);
    if (local.z >= 0 || std::abs(local.y) > -local.z * up || std::abs(local.x) > -local.z * up * view.aspect) return false;
    return away <= kThreeCascades[cascade].split && (cascade == 0 || away > kThreeCascades[cascade - 1].split);
}

TEST(Receivers, NoCascadeSleepsWhileOneOfItsPointsIsSeen) {
    std::mt19937 rng(31);
    std::uniform_real_distribution<double> unit(-1, 1);
    const auto somewhere = [&](double reach) { return glm::dvec3(unit(rng), unit(rng), unit(rng)) * reach; };
    int asleep = 0, awake = 0, needless = 0;
    for (int step = 0; step < 300; ++step) {
        tests::ToyScene scene(glm::dvec3(0.2, -1, 0.1), kThreeCascades, 200);
        const auto box = scene.addMesh(tests::boxMesh({2, 2, 2}));
        for (int i = 0; i < 6; ++i) {
            const auto placement = tests::placedAt(somewhere(90), 0.2 + std::abs(unit(rng)) * 2);
            i % 3 ? scene.addStatic(box, placement) : scene.addActive(box, placement);
        }
        culling::View view;
        view.eye = somewhere(10);
        view.orientation = glm::normalize(glm::dquat(unit(rng), unit(rng), unit(rng), unit(rng)));
        view.verticalFov = 0.5 + std::abs(unit(rng));
        view.aspect = 1.6;
        const uint32_t unseen =
            culling::unseenCascades(view, kThreeCascades, scene.statics, scene.table, scene.active, false);
        const uint32_t standIn =
            culling::unseenCascades(view, kThreeCascades, scene.statics, scene.table, scene.active, true);
        for (size_t c = 0; c < kThreeCascades.size(); ++c) {
            bool seen = false;
            for (world::CasterId id = 0; id < scene.table.slots(); ++id) {
                const world::Box& b = scene.table[id].bounds;
                for (int n = 0; n < 200; ++n)
                    seen |= serves(view, c, b.centre() + b.extent() * 0.5 * glm::dvec3(unit(rng), unit(rng), unit(rng)));
            }
            const bool sleeps = unseen >> c & 1;
            ASSERT_FALSE(sleeps && seen) << "step " << step << ", cascade " << c;
            // A cascade that stands in for nearer ones sleeps only if they do.
            if (standIn >> c & 1) {
                EXPECT_EQ(unseen & ((2u << c) - 1), (2u << c) - 1);
            }
            asleep += sleeps;
            awake += seen;
            needless += !sleeps && !seen;
        }
    }
    EXPECT_GT(asleep, 200);
    EXPECT_GT(awake, 50);
    EXPECT_LT(needless, awake) << "boxes that graze the view are kept awake, but most are clear";
    EXPECT_EQ(culling::unseenCascades({}, kThreeCascades, world::Octree({glm::dvec3(-1), glm::dvec3(1)}, 1), {}, {}, false), 0u)
        << "a camera that may look anywhere sees everything";
}

}  // namespace
