// What the sun lights, traced: against formulas for boxes, spheres and the ground, near the world's origin and far off.
#include "culling/truth.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <array>
#include <limits>
#include <numbers>
#include <optional>
#include <random>
#include <string>

#include "tests/toy_scene.h"

namespace {

using culling::Sunlight;
using culling::Truth;
using culling::TruthFrame;
using culling::View;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
const std::array<glm::dvec3, 3> kPlaces{glm::dvec3(0), glm::dvec3(1e6, 30, -1e6), glm::dvec3(-1e7, 300, 1e7)};
constexpr world::CasterId kGround = 0;

/// A sphere of radius 1, of triangles that are off it by at most 1.9e-5.
world::MeshLevel roundMesh() {
    constexpr uint32_t kAcross = 512, kDown = 256;
    world::MeshLevel level;
    for (uint32_t j = 0; j <= kDown; ++j)
        for (uint32_t i = 0; i < kAcross; ++i) {
            const double a = 2 * std::numbers::pi * i / kAcross, b = std::numbers::pi * j / kDown;
            level.positions.emplace_back(std::sin(b) * std::cos(a), std::cos(b), std::sin(b) * std::sin(a));
        }
    for (uint32_t j = 0; j < kDown; ++j)
        for (uint32_t i = 0; i < kAcross; ++i) {
            const uint32_t a = j * kAcross + i, b = j * kAcross + (i + 1) % kAcross;
            for (const uint32_t k : {a, b, b + kAcross, a, b + kAcross, a + kAcross}) level.indices.push_back(k);
        }
    return level;
}

/// Ground at height 0, boxes and spheres, as formulas; all relative to one place. Caster 0 is the ground.
struct Formula {
    struct Ball {
        glm::dvec3 centre{0};
        double radius = 1;
    };
    struct Met {
        double away = kInfinity;
        glm::dvec3 normal{0};
        world::CasterId what = culling::kNoCaster;
    };
    std::vector<world::Box> boxes;
    std::vector<Ball> balls;

    /// Leaves out the caster that the ray starts on: all of them are convex.
    Met nearest(const glm::dvec3& from, const glm::dvec3& way, world::CasterId apart = culling::kNoCaster) const {
        Met met;
        const auto offer = [&](double away, const glm::dvec3& normal, world::CasterId what) {
            if (away > 0 && away < met.away && what != apart) met = {away, normal, what};
        };
        offer(-from.y / way.y, {0, 1, 0}, kGround);
        for (size_t i = 0; i < boxes.size(); ++i) {
            double in = -kInfinity, out = kInfinity;
            glm::dvec3 normal(0);
            for (int k = 0; k < 3; ++k) {
                const double a = (boxes[i].min[k] - from[k]) / way[k], b = (boxes[i].max[k] - from[k]) / way[k];
                if (std::min(a, b) > in) {
                    in = std::min(a, b);
                    normal = glm::dvec3(0);
                    normal[k] = way[k] > 0 ? -1 : 1;
                }
                out = std::min(out, std::max(a, b));
            }
            if (in <= out) offer(in, normal, world::CasterId(1 + i));
        }
        for (size_t i = 0; i < balls.size(); ++i) {
            const glm::dvec3 to = balls[i].centre - from;
            const double along = glm::dot(to, way), radius = balls[i].radius;
            const double root = along * along - glm::dot(to, to) + radius * radius;
            if (root < 0) continue;
            const double away = along - std::sqrt(root);
            offer(away, glm::normalize(away * way - to), world::CasterId(1 + boxes.size() + i));
        }
        return met;
    }
    /// Of what a ray from the eye meets.
    Sunlight state(const glm::dvec3& eye, const glm::dvec3& way, double farDistance, const glm::dvec3& sun) const {
        const Met met = nearest(eye, way);
        if (met.away > farDistance) return Sunlight::kSky;
        if (glm::dot(met.normal, sun) >= 0) return Sunlight::kAway;
        return nearest(eye + met.away * way, -sun, met.what).away < kInfinity ? Sunlight::kShadowed : Sunlight::kLit;
    }
};

/// The same as casters, at `place`.
struct Traced {
    explicit Traced(const Formula& formula, const glm::dvec3& at = glm::dvec3(0)) : place(at) {
        const uint32_t ground = truth->addMesh(tests::sheetMesh(400, 4).levels[0]).value();
        const uint32_t box = truth->addMesh(tests::boxMesh({1, 1, 1}).levels[0]).value();
        add(ground, tests::placedAt(place));
        for (const world::Box& b : formula.boxes) add(box, placed(b));
        if (formula.balls.empty()) return;
        const uint32_t ball = truth->addMesh(roundMesh()).value();
        for (const Formula::Ball& b : formula.balls) {
            world::Placement placement = tests::placedAt(place + b.centre);
            // Turned and mirrored, which a ball does not show.
            placement.linear = glm::mat3(glm::mat3_cast(glm::normalize(glm::dquat(0.3, 0.5, -0.7, 0.2)))) *
                               glm::mat3(float(-b.radius), 0, 0, 0, float(b.radius), 0, 0, 0, float(b.radius));
            add(ball, placement);
        }
    }
    world::Placement placed(const world::Box& b) const {
        world::Placement placement = tests::placedAt(place + b.centre());
        for (int k = 0; k < 3; ++k) placement.linear[k][k] = static_cast<float>(b.extent()[k]);
        return placement;
    }
    void add(uint32_t mesh, const world::Placement& placement) {
        ASSERT_TRUE(truth->add(casters++, mesh, placement));
    }
    glm::dvec3 place;
    std::unique_ptr<Truth> truth = std::move(Truth::create().value());
    world::CasterId casters = 0;
};

/// A camera at `eye` that looks at `target`, both relative to `place`.
View looking(const glm::dvec3& eye, const glm::dvec3& target, const glm::dvec3& place, double fov = 1) {
    const glm::dvec3 up(0, 1, 0), back = glm::normalize(eye - target), right = glm::normalize(glm::cross(up, back));
    return {place + eye, glm::quat_cast(glm::dmat3(right, glm::cross(back, right), back)), fov, 1.5};
}

glm::dvec3 wayThrough(const View& view, double x, double y) {
    const double up = std::tan(view.verticalFov / 2);
    return glm::normalize(view.orientation * glm::dvec3((2 * x - 1) * up * view.aspect, (1 - 2 * y) * up, -1));
}

/// Traces the formula's scene and looks for pixels that differ from it although the formula says the same of all
/// pixels around.
void expectAgreement(const Formula& formula, const glm::dvec3& eye, const glm::dvec3& target, const glm::dvec3& sun,
                     std::initializer_list<Sunlight> mustOccur) {
    constexpr int kWidth = 243, kHeight = 162;  // no multiples of a packet
    constexpr double kReach = 80;
    for (const glm::dvec3& place : kPlaces) {
        Traced traced(formula, place);
        const View view = looking(eye, target, place);
        const auto frame = traced.truth->trace(view, kWidth, kHeight, kReach, sun);
        ASSERT_TRUE(frame) << frame.error().what;
        std::vector<Sunlight> expected;
        for (int y = 0; y < kHeight; ++y)
            for (int x = 0; x < kWidth; ++x)
                expected.push_back(formula.state(eye, wayThrough(view, (x + 0.5) / kWidth, (y + 0.5) / kHeight), kReach,
                                                 glm::normalize(sun)));
        int differing = 0;
        for (int y = 1; y + 1 < kHeight; ++y)
            for (int x = 1; x + 1 < kWidth; ++x) {
                const auto at = size_t(y * kWidth + x);
                const Sunlight state = frame.value().states[at];
                if (state == expected[at]) continue;
                ++differing;
                bool edge = false;
                for (const int k : {-kWidth - 1, -kWidth, -kWidth + 1, -1, 1, kWidth - 1, kWidth, kWidth + 1})
                    edge |= expected[size_t(int(at) + k)] == state;
                EXPECT_TRUE(edge) << "pixel " << x << "," << y << " is " << int(state) << ", not " << int(expected[at]);
            }
        // A hundredth of the pixels that lie on an edge: of some 1,500.
        EXPECT_LT(differing, 15) << "place " << place.x;
        for (const Sunlight state : mustOccur)
            EXPECT_GT(std::count(expected.begin(), expected.end(), state), 100) << int(state) << " hardly occurs";
        for (size_t i = 0; i < expected.size(); ++i) {
            if (frame.value().casters[i] != kGround) continue;
            // A float holds 80 m to 4e-6.
            EXPECT_NEAR(double(frame.value().points[i].y) + eye.y, 0, 8e-6);
            EXPECT_NEAR(double(frame.value().normals[i].y), 1, 1e-6);
        }
    }
}

constexpr std::initializer_list<Sunlight> kAll = {Sunlight::kSky, Sunlight::kAway, Sunlight::kLit, Sunlight::kShadowed};

TEST(Truth, OfAPoleOnAPlaneIsTheFormulas) {
    expectAgreement({{{{-0.25, 0, -0.25}, {0.25, 8, 0.25}}}, {}}, {-5, 5, 7}, {-1, 3, 0}, {-0.7, -1, -0.3}, kAll);
}

TEST(Truth, OfASphereOverAPlaneIsTheFormulas) {
    expectAgreement({{}, {{{0, 3, 0}, 2}}}, {6, 5, 8}, {0, 2.5, 0}, {-0.5, -0.6, 0.4}, kAll);
}

TEST(Truth, OfASlotBetweenTwoBoxesIsTheFormulas) {
    expectAgreement({{{{-4, 0, -3}, {-0.2, 4, 0}}, {{0.2, 0, -3}, {4, 4, 0}}}, {}}, {3, 6, 11}, {0, 1, 0},
                    {0.15, -0.5, 1}, kAll);
}

TEST(Truth, OfACasterWithoutAThicknessIsTheFormulas) {
    expectAgreement({{{{-2, 3, -2}, {2, 3, 2}}}, {}}, {7, 6, 8}, {0, 1, 0}, {0.4, -1, 0.3},
                    {Sunlight::kSky, Sunlight::kLit, Sunlight::kShadowed});
}

TEST(Truth, OfNothingIsSky) {
    const auto truth = std::move(Truth::create().value());
    ASSERT_TRUE(truth->add(7, truth->addMesh({}).value(), {}));
    const auto frame = truth->trace(looking({0, 1, 5}, {0, 0, 0}, glm::dvec3(0)), 1, 1, 10, {0, -1, 0});
    ASSERT_TRUE(frame);
    EXPECT_EQ(frame.value().states, std::vector{Sunlight::kSky});
    EXPECT_EQ(frame.value().casters, std::vector{culling::kNoCaster});
    EXPECT_EQ(culling::edgeRadius(frame.value().edges[0]), kInfinity);
}

TEST(Truth, TakesPlacementsThatHaveNoInverse) {
    const Formula formula{{{{-2, 0, -2}, {2, 3, 2}}}, {}};
    const View view = looking({6, 5, 9}, {1, 1, 0}, kPlaces[1]);
    Traced plain(formula, kPlaces[1]), traced(formula, kPlaces[1]);
    const uint32_t box = traced.truth->addMesh(tests::boxMesh({1, 1, 1}).levels[0]).value();
    const glm::mat3 line(3, 0, 0, 0, 0, 0, 0, 0, 0), skewed(1, 1, 0, 1, 1, 0, 0, 0, 1e-12f);
    for (const glm::mat3& linear : {glm::mat3(0), glm::mat3(1e-30f), glm::mat3(1e-7f), line, skewed}) {
        world::Placement placement = tests::placedAt(kPlaces[1] + glm::dvec3(3, 1.5, 5));
        placement.linear = linear;
        traced.add(box, placement);
    }
    // Lines and points cover nothing: a rounding may show a pixel of them.
    const TruthFrame a = plain.truth->trace(view, 300, 200, 60, {0.5, -1, 0.2}).value();
    const TruthFrame b = traced.truth->trace(view, 300, 200, 60, {0.5, -1, 0.2}).value();
    int differing = 0;
    for (size_t i = 0; i < a.states.size(); ++i) differing += a.states[i] != b.states[i];
    EXPECT_LE(differing, 5);
}

TEST(Truth, SaysHowFarAShadowEdgeIs) {
    // The sun has no z: seen along it, the pole is a rectangle of z and of the height h = (x + y) / sqrt(2).
    constexpr double kHalf = 0.25, kTall = 8;
    const Formula formula{{{{-kHalf, 0, -kHalf}, {kHalf, kTall, kHalf}}}, {}};
    const double low = -kHalf / std::sqrt(2.0), high = (kHalf + kTall) / std::sqrt(2.0);
    for (const glm::dvec3& place : kPlaces) {
        Traced traced(formula, place);
        const glm::dvec3 eye(5, 6, 7);
        const auto frame =
            traced.truth->trace(looking(eye, {4, 0, 0}, place), 320, 200, 50, {1, -1, 0});
        ASSERT_TRUE(frame);
        int lit = 0, shadowed = 0, none = 0;
        for (size_t i = 0; i < frame.value().states.size(); ++i) {
            if (frame.value().casters[i] != kGround) continue;
            const glm::dvec3 p = eye + glm::dvec3(frame.value().points[i]);
            const double h = (p.x + p.y) / std::sqrt(2.0), edge = culling::edgeRadius(frame.value().edges[i]);
            const double away = std::abs(std::abs(p.z) - kHalf);
            if (std::abs(p.z) > kHalf + 16 || h < low - 16 || h > high + 16) {
                EXPECT_EQ(edge, kInfinity);
            }
            none += edge == kInfinity;
            // In the middle of the rectangle's long sides, as near as the circles see nothing but one side. The start
            // off the surface moves an edge by less than 1e-3.
            if (h < low + 0.5 || h > high - 0.5 || away > 0.2 || away < 1.0 / 64) continue;
            EXPECT_GT(edge, away - 1e-3) << p.x << "," << p.z;
            EXPECT_LT(edge, 2.17 * away + 1e-3) << p.x << "," << p.z;
            ++(frame.value().states[i] == Sunlight::kLit ? lit : shadowed);
        }
        EXPECT_GT(lit, 200);
        EXPECT_GT(shadowed, 200);
        EXPECT_GT(none, 200);
    }
}

TEST(Truth, AgreesWithAMapOf16384TexelsAwayFromEdges) {
    const Formula formula{{{{-0.25, 0, -0.25}, {0.25, 8, 0.25}}, {{2, 0, -5}, {5, 3, -2}}}, {{{-4, 3, -1}, 2}}};
    constexpr double kTexel = 40.0 / 16384;  // [m]
    const culling::LightSpace light = culling::makeLightSpace({-0.5, -1, 0.3}).value();
    // A map knows one depth a texel, that of the centre; here it comes from the formula.
    const auto depthAt = [&](const glm::dvec3& pLight) {
        const glm::dvec2 centre = (glm::floor(glm::dvec2(pLight) / kTexel) + 0.5) * kTexel;
        return formula.nearest(light.toWorld({centre, -100}), light.sun).away - 100;
    };
    for (const glm::dvec3& place : kPlaces) {
        Traced traced(formula, place);
        const glm::dvec3 eye(7, 7, 13);
        const auto frame = traced.truth->trace(looking(eye, {0, 1, 0}, place), 480, 320, 60, light.sun);
        ASSERT_TRUE(frame);
        int differing = 0, near = 0, shadowed = 0, lit = 0;
        for (size_t i = 0; i < frame.value().states.size(); ++i) {
            const Sunlight state = frame.value().states[i];
            if (!culling::sunward(state)) continue;
            const glm::dvec3 p = light.toLight(eye + glm::dvec3(frame.value().points[i]));
            const double facing = -glm::dot(glm::dvec3(frame.value().normals[i]), light.sun);
            // Depth changes by so much from a texel's corner to its centre; a ball is 2e-5 * 2 m off its formula.
            const double bias = kTexel * std::sqrt((1 - facing * facing) / 2) / facing + 1e-3;
            const bool dark = depthAt(p) < p.z - bias;
            const bool differs = dark != (state == Sunlight::kShadowed);
            // No edge within 2^-7 m, 3.2 texels; said for straight ones, and corners are straight to a texel.
            const bool away = frame.value().edges[i] > 0;
            (away ? differing : near) += differs;
            if (away) ++(dark ? shadowed : lit);
        }
        EXPECT_EQ(differing, 0) << place.x;
        EXPECT_GT(near, 0) << "all that a map can be wrong about lies away from edges";
        EXPECT_GT(shadowed, 1500);
        EXPECT_GT(lit, 20000);
    }
}

TEST(Truth, NoConvexCasterShadesItselfHoweverFar) {
    const Formula formula{{{{-30, 0, -20}, {-10, 40, 0}}}, {{{15, 20, 0}, 15}}};
    for (const glm::dvec3& place : kPlaces)
        for (const double distance : {20.0, 200.0, 2000.0}) {
            for (const glm::dvec3 sun : {glm::dvec3(-0.3, -1, -0.5), glm::dvec3(0.02, -0.05, -1)}) {
                Traced traced(formula, place);
                // What is seen fills the image from everywhere; away from the lattice's points.
                const View view = looking({31, 25, distance + 31}, {0, 20, 0}, place, 2 * std::atan(30 / distance));
                const auto frame = traced.truth->trace(view, 150, 100, 4000, sun);
                ASSERT_TRUE(frame);
                int lit = 0;
                for (size_t i = 0; i < frame.value().states.size(); ++i) {
                    const world::CasterId what = frame.value().casters[i];
                    // The box shades the ball nowhere: both suns come from in front.
                    if (what == 1 || what == 2) {
                        EXPECT_NE(frame.value().states[i], Sunlight::kShadowed) << "pixel " << i << " at " << distance;
                    }
                    lit += (what == 1 || what == 2) && frame.value().states[i] == Sunlight::kLit;
                }
                EXPECT_GT(lit, 400) << distance;
            }
        }
}

TEST(Truth, FollowsWhatMovesAndRevisitsWhatWasSeen) {
    Formula formula{{{{-1, 0.5, -1}, {1, 2.5, 1}}}, {}};
    const glm::dvec3 sun = glm::normalize(glm::dvec3(0.5, -1, 0.2)), eye(4, 6, 9);
    for (const glm::dvec3& place : kPlaces) {
        Traced traced(formula, place);
        const View view = looking(eye, {1, 0.5, 0}, place);
        const auto before = traced.truth->trace(view, 300, 200, 60, sun);
        ASSERT_TRUE(before);
        std::vector<culling::SurfacePoint> points;
        std::vector<Sunlight> states;
        for (size_t i = 0; i < before.value().states.size(); ++i) {
            if (before.value().states[i] == Sunlight::kSky) continue;
            points.push_back(surfaceAt(before.value(), i));
            states.push_back(before.value().states[i]);
        }
        const auto differing = [&](const std::vector<Sunlight>& a, const std::vector<Sunlight>& b) {
            int count = 0;
            for (size_t i = 0; i < a.size(); ++i) count += a[i] != b[i];
            return count;
        };
        const auto again = traced.truth->revisit(points, view, 60, sun, {});
        ASSERT_TRUE(again);
        // Some on outlines are found hidden by a rounding.
        EXPECT_LE(differing(again.value(), states), 3);

        const View turned = looking(eye, eye * 2.0, place);
        const std::vector<Sunlight> unseen(points.size(), Sunlight::kSky);
        EXPECT_EQ(traced.truth->revisit(points, turned, 60, sun, {}).value(), unseen);
        const View below = looking({4, -6, 9}, {1, 0.5, 0}, place);
        const std::vector<Sunlight> fromBelow = traced.truth->revisit(points, below, 60, sun, {}).value();
        for (size_t i = 0; i < points.size(); ++i)
            ASSERT_TRUE(points[i].caster != kGround || fromBelow[i] == Sunlight::kSky) << "the ground's other side";

        Formula later = formula;
        later.boxes[0].min.x += 3, later.boxes[0].max.x += 3;
        const world::CasterId mover = 1;
        ASSERT_TRUE(traced.truth->place(mover, traced.placed(later.boxes[0])));
        const auto seen = traced.truth->revisit(points, view, 60, sun, std::span(&mover, 1));
        ASSERT_TRUE(seen);
        int changed = 0, hidden = 0, wrong = 0;
        for (size_t i = 0; i < points.size(); ++i) {
            Sunlight expected = Sunlight::kSky;
            if (points[i].caster == kGround) {
                const glm::dvec3 p = points[i].position - place, way = p - eye;
                if (later.nearest(eye, way, kGround).away > 1)
                    expected = later.nearest(p, -sun, kGround).away < kInfinity ? Sunlight::kShadowed : Sunlight::kLit;
                hidden += expected == Sunlight::kSky;
                changed += culling::sunward(expected) && expected != states[i];
            }
            wrong += seen.value()[i] != expected;
        }
        EXPECT_LE(wrong, 10) << "points that lie on an edge to a rounding";
        EXPECT_GT(changed, 1000);
        EXPECT_GT(hidden, 1000);

        traced.truth->remove(mover);
        const auto bare = traced.truth->trace(view, 300, 200, 60, sun);
        ASSERT_TRUE(bare);
        EXPECT_EQ(std::count(bare.value().states.begin(), bare.value().states.end(), Sunlight::kShadowed), 0);
        EXPECT_EQ(traced.truth->revisit(std::span(points).first(0), view, 60, sun, {}).value().size(), 0u);
        // A caster that is gone leaves no points, said to have moved or not.
        const std::vector<Sunlight> left = traced.truth->revisit(points, view, 60, sun, {}).value();
        for (size_t i = 0; i < points.size(); ++i) EXPECT_EQ(left[i] == Sunlight::kSky, points[i].caster == mover);
    }
}

TEST(Truth, DoesNotDependOnWhereTheEyeCameFrom) {
    // Numbers that are rounded, or all anchors would do.
    const Formula formula{{{{-2.1, 0, -2.3}, {2.7, 3.1, 2.9}}, {{3.3, 0, -7.7}, {6.1, 9.3, -4.1}}}, {}};
    const View view = looking({6.1, 5.3, 9.7}, {1, 1, 0}, kPlaces[1]);
    Traced travelled(formula, kPlaces[1]), fresh(formula, kPlaces[1]);
    for (const double x : {-3000.0, 40.0, 700.0}) {
        const View before = looking({x, 50, 9}, {1, 1, 0}, kPlaces[1]);
        ASSERT_TRUE(travelled.truth->trace(before, 8, 8, 60, {0.5, -1, 0.2}));
    }
    EXPECT_EQ(travelled.truth->trace(view, 300, 200, 60, {0.5, -1, 0.2}).value(),
              fresh.truth->trace(view, 300, 200, 60, {0.5, -1, 0.2}).value());
}

TEST(Truth, OfAPenumbraIsTheDisksSegment) {
    constexpr double kHeight = 20, kRadius = 0.05;  // [m], [rad]: a penumbra of 2 m
    constexpr int kDirections = 256;
    for (const glm::dvec3& place : kPlaces) {
        Traced traced({}, place);
        const uint32_t roof = traced.truth->addMesh(tests::sheetMesh(100, 1).levels[0]).value();
        traced.add(roof, tests::placedAt(place + glm::dvec3(-50, kHeight, 0)));
        const glm::dvec3 eye(3, 4, 0.5);
        const auto frame = traced.truth->trace(looking(eye, {0, 0, 0}, place), 120, 80, 20, {0, -1, 0});
        ASSERT_TRUE(frame);
        const auto shares = traced.truth->sunShares(frame.value(), kRadius, kDirections);
        ASSERT_TRUE(shares);
        int between = 0;
        for (size_t i = 0; i < shares.value().size(); ++i) {
            ASSERT_EQ(frame.value().casters[i], kGround);
            const double x = eye.x + double(frame.value().points[i].x);
            const double c = std::clamp(x / (kHeight * std::tan(kRadius)), -1.0, 1.0);
            const double visible = 1 - (std::acos(c) - c * std::sqrt(1 - c * c)) / std::numbers::pi;
            // A line through the disk cuts about 2 sqrt(256) of its areas, whose points fall to either side.
            EXPECT_NEAR(double(shares.value()[i]), visible, 0.02) << x;
            between += visible > 0.05 && visible < 0.95;
        }
        EXPECT_GT(between, 1000);
    }
    Traced traced({});
    const auto frame = traced.truth->trace(looking({3, 4, 0.5}, {0, 5, -9}, glm::dvec3(0)), 30, 20, 20, {-1, -0.03, 0});
    ASSERT_TRUE(frame);
    const std::vector<float> shares = traced.truth->sunShares(frame.value(), 0.05, 64).value();
    // Of a sun that is 0.03 rad high a part has set, what lies beyond 0.6 of its radius: 0.858 stay.
    for (size_t i = 0; i < shares.size(); ++i)
        EXPECT_NEAR(shares[i], frame.value().states[i] == Sunlight::kSky ? 0.0f : 0.858f, 0.04f);
}

TEST(Truth, RefusesWhatIsNotFiniteAndNamesIt) {
    const double bad[] = {std::numeric_limits<double>::quiet_NaN(), kInfinity, -kInfinity, 2e9};
    const auto names = [](const auto& result, const std::string& name) {
        return !result && result.error().code == world::ErrorCode::kUsage &&
               result.error().what.find(name) != std::string::npos;
    };
    Traced traced({});
    Truth& truth = *traced.truth;
    const View good = looking({0, 5, 9}, {0, 0, 0}, glm::dvec3(0));
    const glm::dvec3 sun(0.1, -1, 0.2);
    const std::vector<culling::SurfacePoint> points{{{0, 0, 0}, {0, 1, 0}, kGround}};
    ASSERT_TRUE(truth.trace(good, 8, 8, 50, sun));
    ASSERT_TRUE(truth.revisit(points, good, 50, sun, {}));
    for (const double b : bad) {
        world::MeshLevel mesh = tests::boxMesh({1, 1, 1}).levels[0];
        mesh.positions[3].y = float(b);
        EXPECT_TRUE(names(truth.addMesh(mesh), "position 3"));
        world::Placement placement;
        placement.translation.z = b;
        EXPECT_TRUE(names(truth.add(9, 0, placement), "caster 9"));
        EXPECT_TRUE(names(truth.place(kGround, placement), "caster 0"));
        placement = {};
        placement.linear[1][2] = float(b);
        EXPECT_TRUE(names(truth.add(9, 0, placement), "caster 9"));
        placement.linear[1][2] = 0;
        placement.linear[0][2] = 1e7f;
        EXPECT_TRUE(names(truth.add(9, 0, placement), "caster 9")) << "the mesh is 400 m long";
        for (int what = 0; what < 4; ++what) {
            View view = good;
            (what == 0 ? view.eye.y : what == 1 ? view.orientation.w : what == 2 ? view.verticalFov : view.aspect) = b;
            EXPECT_TRUE(names(truth.trace(view, 8, 8, 50, sun), "view"));
            EXPECT_TRUE(names(truth.revisit(points, view, 50, sun, {}), "view"));
        }
        EXPECT_TRUE(names(truth.trace(good, 8, 8, b, sun), "far distance"));
        if (b != 2e9) {
            EXPECT_TRUE(names(truth.trace(good, 8, 8, 50, {0, b, 0}), "sun"));
        }
        std::vector<culling::SurfacePoint> spoilt(2, points[0]);
        spoilt[1].position.x = b;
        EXPECT_TRUE(names(truth.revisit(spoilt, good, 50, sun, {}), "point 1"));
        EXPECT_TRUE(names(truth.sunShares(truth.trace(good, 8, 8, 50, sun).value(), b, 4), "angular radius"));
    }
    EXPECT_TRUE(names(truth.trace(good, 0, 8, 50, sun), "image"));
    EXPECT_TRUE(names(truth.trace(good, 8, 1 << 20, 50, sun), "image"));
    EXPECT_TRUE(names(truth.trace(good, 8, 8, 0, sun), "far distance"));
    EXPECT_TRUE(names(truth.trace({}, 8, 8, 50, sun), "field of view"));
    EXPECT_TRUE(names(truth.trace(good, 8, 8, 50, {0, 0, 0}), "sun"));
    EXPECT_TRUE(names(truth.sunShares(truth.trace(good, 8, 8, 50, sun).value(), 0.1, 0), "directions"));
    world::MeshLevel mesh = tests::boxMesh({1, 1, 1}).levels[0];
    mesh.indices[4] = 1000;
    EXPECT_TRUE(names(truth.addMesh(mesh), "index 1000"));
    EXPECT_TRUE(truth.trace(good, 8, 8, 50, sun)) << "what was refused left nothing behind";
}

TEST(Truth, IsTheSameForAnyNumberOfThreads) {
    struct Answers {
        TruthFrame frame;
        std::vector<float> shares;
        std::vector<Sunlight> seen;
        bool operator==(const Answers&) const = default;
    };
    std::vector<Answers> answers;
    for (const size_t threads : {1, 2, 7}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        std::mt19937 rng(5);
        std::uniform_real_distribution<double> unit(-1, 1);
        Formula formula;
        for (int i = 0; i < 6; ++i)
            formula.balls.push_back({glm::dvec3(unit(rng), 0, unit(rng)) * 8.0, 1 + unit(rng) * 0.8});
        Traced traced(formula, kPlaces[1]);
        // Sheets in one place: which of them a ray meets is up to the order of Embree's tree.
        const uint32_t sheet = traced.truth->addMesh(tests::sheetMesh(6, 60).levels[0]).value();
        for (int i = 0; i < 300; ++i) {
            world::Placement placement = tests::placedAt(kPlaces[1] + glm::dvec3(unit(rng), 0.3, unit(rng)) * 9.0);
            placement.linear = glm::mat3(
                glm::mat3_cast(glm::normalize(glm::dquat(unit(rng), unit(rng), unit(rng), unit(rng)))));
            traced.add(sheet, placement);
            traced.add(sheet, placement);
        }
        Answers a;
        const glm::dvec3 sun(0.5, -1, 0.2);
        a.frame = traced.truth->trace(looking({20, 12, 21}, {0, 1, 0}, kPlaces[1]), 300, 200, 60, sun).value();
        a.shares = traced.truth->sunShares(a.frame, 0.02, 20).value();
        std::vector<culling::SurfacePoint> points;
        for (size_t i = 0; i < a.frame.states.size(); ++i)
            if (a.frame.states[i] != Sunlight::kSky) points.push_back(surfaceAt(a.frame, i));
        a.seen = traced.truth->revisit(points, looking({17, 12, 25}, {0, 1, 0}, kPlaces[1]), 60, sun, {}).value();
        EXPECT_GT(std::count(a.seen.begin(), a.seen.end(), Sunlight::kShadowed), 1000);
        answers.push_back(std::move(a));
    }
    EXPECT_TRUE(answers[0] == answers[1]);
    EXPECT_TRUE(answers[0] == answers[2]);
}

}  // namespace
