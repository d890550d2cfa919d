// The cases of the failure suite.
#include <cmath>
#include <glm/gtc/quaternion.hpp>

#include "culling/light_space.h"
#include "tools/lab/suite.h"

namespace tools::lab {
namespace {

using cache::Sabotage;
using Kind = Claim::Kind;
using Poses = std::vector<world::Pose>;

const Measure kFlips{"flips per million", [](const Measures& m) { return m.flipsPerMillion(); }};
const Measure kFalseLit{"false lit, %", [](const Measures& m) { return 100 * m.share(m.falseLit.all()); }};
const Measure kFalseLitAway{"false lit off edges, %", [](const Measures& m) { return 100 * m.share(m.falseLit.elsewhere); }};
const Measure kFalseShadowAway{"false shadow off edges, %", [](const Measures& m) { return 100 * m.share(m.falseShadow.elsewhere); }};
const Measure kWrongAway{"wrong off edges, %", [](const Measures& m) { return 100 * m.share(m.falseLit.elsewhere + m.falseShadow.elsewhere); }};
const Measure kTexels{"texels a pixel, median", [](const Measures& m) { return m.texelRatio(0.5); }};

/// Of answers without filter: a straight edge is drawn up to half a texel from where it is, a quarter in the mean;
/// in two frames whose texels have nothing to do with each other it is drawn a third of a texel apart in the mean,
/// and for texels that creep by the share u of a texel 2 u (1 - u). So this is 4/3, or 8 u (1 - u), and 0 for
/// texels that stay, whatever the scene.
const Measure kFlipsPerWrong{"flips a wrong pixel", [](const Measures& m) {
    const double wrong = m.share(m.falseLit.all() + m.falseShadow.all());
    return wrong == 0 ? 0 : m.flipsPerMillion() / 1e6 / wrong;
}};

const Contestant kGnomon{"gnomon:side=512"};
/// One cascade, and each texel as it is: where a case is about texels.
const Contestant kGnomonOne{"gnomon:side=512:cascades=1:filter=none:blend=0:bias-receiver=1.5:bias-gradient=0:bias-plane=no"};
/// Of what faces the sun [%]: where two maps are blended an answer may be mostly the coarser one's, whose texels are three
/// times as long as the one that edges are told by.
constexpr double kBlended = 0.01;

Claim fails(Contestant who, const Measure& measure, double limit, std::string why) {
    return {Kind::kFails, std::move(who), measure, limit, {}, std::move(why)};
}
Claim failsBeside(Contestant who, const Measure& measure, double times, Contestant than, std::string why) {
    return {Kind::kFails, std::move(who), measure, times, std::move(than), std::move(why)};
}
Claim holds(Contestant who, const Measure& measure, double limit, std::string why) {
    return {Kind::kHolds, std::move(who), measure, limit, {}, std::move(why)};
}
Claim holdsBeside(Contestant who, const Measure& measure, double times, Contestant than, std::string why) {
    return {Kind::kHolds, std::move(who), measure, times, std::move(than), std::move(why)};
}

const std::string kExact = "what the maps hold is exact, and no surface here falls by more than its bias";
const std::string kStays = "no texel moves with the camera";
const std::string kNew = "every texel is another one in each frame: 4/3, and half of that allows for all else";

/// An eye's height above the ground [m].
constexpr double kEyeHeight = 1.7;

/// Looks north, turned to the left by `yaw` and up by `pitch` [degrees].
glm::dquat looking(double yaw, double pitch) {
    return glm::angleAxis(glm::radians(yaw), glm::dvec3(0, 1, 0)) * glm::angleAxis(glm::radians(pitch), glm::dvec3(1, 0, 0));
}

glm::dvec3 sunAt(double azimuth, double elevation) {
    return culling::sunFromAngles(glm::radians(azimuth), glm::radians(elevation));
}

/// As steep on walls as on the ground, or nearly: no surface that faces it falls by more than 1.6 texels a texel.
const glm::dvec3 kHighSun = sunAt(222, 38);

/// `count` poses, `step` seconds apart.
template <class At>
Poses poses(size_t count, double step, At at) {
    Poses made;
    for (size_t i = 0; i < count; ++i) {
        made.push_back(at(double(i)));
        made.back().time = double(i) * step;
    }
    return made;
}

/// Every other frame of so many.
std::vector<size_t> everyOther(size_t poses) {
    std::vector<size_t> frames;
    for (size_t i = 0; i + 1 < poses; i += 2) frames.push_back(i);
    return frames;
}

/// Blocks on the ground around the eye.
SuiteCase blocks(std::string name, std::string what, glm::dvec3 origin = glm::dvec3(0)) {
    SuiteCase c;
    c.name = std::move(name);
    c.what = std::move(what);
    c.stage.origin = origin;
    c.stage.addGround({0, 0}, 256);
    c.stage.addBlocks(7, {0, 0}, 140, 3.5);
    c.sun = kHighSun;
    c.verticalFov = glm::radians(60.0);
    return c;
}

SuiteCase creep() {
    SuiteCase c = blocks("creep", "the eye moves by 12 mm a frame, a twentieth of a texel of the only map");
    c.poses = poses(10, 1 / 30.0, [](double i) {
        return world::Pose{0, {0.31 + 0.012 * i, kEyeHeight, 0.17}, looking(0, -8)};
    });
    c.judged = everyOther(c.poses.size());
    const Contestant unsnapped{"doughnut:side=512:cascades=1:bias-receiver=1.5:snapped=no"};
    const std::string creeps = "texels of 24 cm creep by 1/60 to 1/30 of their edge along their axes: 0.13 to 0.26";
    c.claims = {
        fails(unsnapped, kFlipsPerWrong, 0.1, creeps),
        fails({"engel:side=512:cascades=1:filter=none"}, kFlipsPerWrong, 0.1, creeps),
        holds({"doughnut:side=512:cascades=1:bias-receiver=1.5"}, kFlips, 0, kStays),
        holds({"valient:side=512:cascades=1"}, kFlips, 0, kStays),
        holds(kGnomonOne, kFlips, 0, kStays),
        holdsBeside(kGnomon, kFlips, 0.05, unsnapped, "only points that change their cascade may flip"),
        holds(kGnomon, kWrongAway, kBlended, kExact),
    };
    return c;
}

SuiteCase turning() {
    SuiteCase c = blocks("turning", "the eye turns on the spot, three degrees a frame");
    c.poses = poses(10, 1 / 30.0, [](double i) { return world::Pose{0, {0, kEyeHeight, 0}, looking(3 * i, -8)}; });
    c.judged = everyOther(c.poses.size());
    const Contestant engelOne{"engel:side=512:cascades=1:filter=none"};
    c.claims = {
        fails(engelOne, kFlipsPerWrong, 2.0 / 3, kNew),
        fails({"valient:side=512:cascades=1:snapped=no:bias-receiver=1.5"}, kFlipsPerWrong, 2.0 / 3, kNew),
        holds({"valient:side=512:cascades=1"}, kFlips, 0, "a sphere keeps its size, and its texels their place"),
        holdsBeside({"valient:side=512:cascades=1"}, kFlips, 0.05, engelOne, "boxes shimmer twenty times as much as spheres"),
        fails({"engel:side=512"}, kFlips, 200, "its filter hides what moves by less than half a texel; more is left"),
        fails({"valient:side=512"}, kFlips, 100, "a turn takes points from slice to slice, which differ in their texels"),
        holds({"doughnut:side=512"}, kFlips, 0, kStays),
        holds(kGnomon, kFlips, 0, kStays),
        holds(kGnomon, kWrongAway, kBlended, kExact),
    };
    return c;
}

SuiteCase lowSun(std::string name, std::string what, double azimuth) {
    SuiteCase c = blocks(std::move(name), std::move(what));
    c.sun = sunAt(azimuth, 10);
    c.poses = poses(6, 1 / 30.0, [](double i) { return world::Pose{0, {0, kEyeHeight, -0.1 * i}, looking(0, -5)}; });
    c.judged = everyOther(c.poses.size());
    return c;
}

SuiteCase facing() {
    SuiteCase c = lowSun("facing a low sun", "the sun is ten degrees high and straight ahead: frusta duel", 0);
    c.claims = {
        failsBeside({"lispsm:side=1024"}, kTexels, 1, Contestant{"single:side=1024"},
                    "the view runs along the light: a warp across the light has nothing to gain, and pays for its centre"),
        holdsBeside(kGnomon, kTexels, 0.25, Contestant{"lispsm:side=1024"}, "windows around the eye know of no direction"),
    };
    return c;
}

SuiteCase aside() {
    SuiteCase c = lowSun("low sun aside", "the same from the right, where a warp is of use", 90);
    c.claims = {
        holdsBeside({"lispsm:side=1024"}, kTexels, 0.25, Contestant{"single:side=1024"},
                    "the view lies across the light: near texels gain what far ones lose"),
    };
    return c;
}

SuiteCase twoDegrees() {
    SuiteCase c;
    c.name = "sun at two degrees";
    c.what = "open ground and one block, whose shadow is 29 times as long as it is high";
    c.stage.addGround({0, 0}, 256);
    c.stage.addBox({-8, 1, -30}, {3, 2, 8});
    c.sun = sunAt(90, 2);  // due east: texels lie along the slope, as the formula has it
    c.verticalFov = glm::radians(60.0);
    c.poses = poses(4, 1 / 30.0, [](double i) { return world::Pose{0, {0.1 * i, kEyeHeight, 0}, looking(0, -12)}; });
    c.judged = everyOther(c.poses.size());
    const std::string acne = "ground falls by cot 2 = 28.6 texels a texel: a bias of b leaves 0.5 - b / 28.6 of it in its own shadow: ";
    c.claims = {
        fails({"doughnut:side=512"}, kFalseShadowAway, 43, acne + "0.5 - 0.7 / 28.6 = 47.6 %, and a tenth off for the block"),
        fails({"gnomon:side=512:filter=none:blend=0:bias-receiver=1.5:bias-gradient=0:bias-plane=no"}, kFalseShadowAway, 40,
              acne + "0.5 - 1.5 / 28.6 = 44.8 %, likewise"),
        fails({"gnomon:side=512:bias-gradient=1:bias-gradient-most=8:bias-plane=no"}, kFalseShadowAway, 10,
              acne + "8.5 texels at most leave 20 %, and its filter hides some"),
        holds(kGnomon, kWrongAway, kBlended, "each tap is compared with the point's own plane where it lies: " + kExact),
    };
    return c;
}

SuiteCase farAway(std::string name, double distance) {
    SuiteCase c = blocks(std::move(name), "the same blocks, so far from the world's origin", {distance, 0, -distance});
    c.poses = poses(6, 1 / 30.0, [=](double i) {
        return world::Pose{0, {distance + 0.05 * i, kEyeHeight, -distance - 0.05 * i}, looking(0, -8)};
    });
    c.judged = everyOther(c.poses.size());
    c.claims = {
        fails({"doughnut:side=512:bias-receiver=1.5", Sabotage::kNone, Defect::kFromOrigin}, kWrongAway, 10,
              "floats are 6 cm apart at 1e6 m, 1 m at 1e7: more than the bias of 1 and 4 cm in the nearest two maps"),
        holds({"doughnut:side=512:bias-receiver=1.5"}, kWrongAway, 0, kExact),
        holds(kGnomon, kWrongAway, kBlended, kExact),
        holds(kGnomonOne, kFlips, 0, kStays),
    };
    return c;
}

SuiteCase thin() {
    SuiteCase c;
    c.name = "thin casters";
    c.what = "rows of bars four centimetres thick, within six metres";
    c.stage.addGround({0, 0}, 256);
    for (int row = 0; row < 4; ++row) c.stage.addBars({-5, 0, -2.0 - 1.0 * row}, 40, 0.25, 0.04, 0.8);
    c.sun = kHighSun;
    c.verticalFov = glm::radians(60.0);
    c.poses = poses(6, 1 / 30.0, [](double i) { return world::Pose{0, {0.02 * i, kEyeHeight, 0}, looking(0, -35)}; });
    c.judged = everyOther(c.poses.size());
    c.claims = {
        failsBeside({"single:side=1024"}, kFalseLit, 5, kGnomon, "its texels of 13 cm miss two bars of three, 1 - 4 / 13"),
        failsBeside(kGnomonOne, kFalseLit, 5, kGnomon, "its texels of 24 cm miss five bars of six, 1 - 4 / 24"),
        holds(kGnomon, kWrongAway, kBlended, "texels of 0.9 and 2.7 cm miss none: what is off is off by a texel"),
    };
    return c;
}

SuiteCase seam() {
    SuiteCase c;
    c.name = "along a seam";
    c.what = "the eye bobs by centimetres: where distance chooses, bars' shadows change their map";
    c.stage.addGround({0, 0}, 256);
    for (int row = 0; row < 8; ++row) c.stage.addBars({-5, 0, -0.5 - 1.0 * row}, 100, 0.1, 0.04, 0.5);
    c.sun = kHighSun;
    c.verticalFov = glm::radians(60.0);
    c.poses = poses(10, 1 / 30.0, [](double i) {
        return world::Pose{0, {0.31, kEyeHeight, 0.17 + (std::fmod(i, 2) == 0 ? 0.0 : 0.05)}, looking(0, -35)};
    });
    c.judged = everyOther(c.poses.size());
    c.claims = {
        fails({"valient:side=256"}, kFlips, 100, "distance chooses: 5 cm of ground at each split change to texels three times as long"),
        holds({"practical-interval:side=256"}, kFlips, 0, "it blends over a tenth of a slice: 5 cm change less than half of an answer"),
        holds({"gnomon:side=256"}, kFlips, 0, "windows move by four texels, 7 cm for the finest: none does"),
    };
    return c;
}

SuiteCase tower() {
    SuiteCase c;
    c.name = "a tower behind";
    c.what = "forty metres high, out of view, with its shadow in it";
    c.stage.addGround({0, 0}, 256);
    c.stage.addBox({0, 20, 28}, {6, 40, 6});
    c.sun = sunAt(175, 40);
    c.verticalFov = glm::radians(60.0);
    c.poses = poses(4, 1 / 30.0, [](double i) { return world::Pose{0, {6, kEyeHeight, -0.1 * i}, looking(10, -10)}; });
    c.judged = everyOther(c.poses.size());
    c.claims = {
        fails({"doughnut:side=512", Sabotage::kNone, Defect::kSeenCasters}, kFalseLitAway, 5,
              "the tower's shadow covers 7 % of what is seen"),
        holds({"engel:side=512"}, kFalseLitAway, 0, "what lies before its boxes is drawn into them"),
        holds(kGnomon, kWrongAway, kBlended, kExact),
    };
    return c;
}

SuiteCase cave() {
    SuiteCase c;
    c.name = "a cave";
    c.what = "a passage with walls ten centimetres thick, seen from inside";
    c.stage.addGround({0, 0}, 256);
    c.stage.addBox({0, 4.1, -8}, {6.2, 0.2, 16});
    c.stage.addBox({-3.05, 2, -8}, {0.1, 4, 16});
    c.stage.addBox({3.05, 2, -8}, {0.1, 4, 16});
    c.sun = sunAt(80, 50);
    c.verticalFov = glm::radians(60.0);
    c.poses = poses(4, 1 / 30.0, [](double i) { return world::Pose{0, {1, kEyeHeight, -3 - 0.1 * i}, looking(-20, -45)}; });
    c.judged = everyOther(c.poses.size());
    c.claims = {
        fails(kGnomonOne, kFalseLit, 1,
              "a bias of 1.5 texels of 24 cm reaches 23 cm along the ground under a sun at 50 degrees, through 10 cm of wall: 13 cm along its foot are lit"),
        fails({"doughnut:side=512", Sabotage::kNone, Defect::kSeenCasters}, kFalseLitAway, 5,
              "the roof is out of view, and light comes over the wall as far as 3.4 m from it"),
        holds(kGnomon, kFalseLit, 0, "a bias of 4 cm at most ends inside the wall"),
        holds(kGnomon, kWrongAway, kBlended, kExact),
    };
    return c;
}

SuiteCase zoom() {
    SuiteCase c = blocks("zoom", "the field of view narrows from 60 to 51 degrees, one a frame");
    c.poses = poses(10, 1, [](double) { return world::Pose{0, {0, kEyeHeight, 0}, looking(0, -8)}; });
    c.fovAt = [](double time) { return glm::radians(60 - time); };
    c.judged = everyOther(c.poses.size());
    c.claims = {
        fails({"valient:side=512:cascades=1:bias-receiver=1.5"}, kFlipsPerWrong, 2.0 / 3, "the sphere shrinks with the view: " + kNew),
        fails({"engel:side=512:cascades=1:filter=none"}, kFlipsPerWrong, 2.0 / 3, kNew),
        holds({"doughnut:side=512"}, kFlips, 0, kStays),
        holds(kGnomon, kFlips, 0, "windows do not follow the view's angle"),
        holds(kGnomon, kWrongAway, kBlended, kExact),
    };
    return c;
}

SuiteCase sunSweep() {
    SuiteCase c = blocks("sun sweep", "the sun moves by 0.08 degrees a frame, four in all, two kilometres from the origin", {2000, 0, 1000});
    c.poses = poses(51, 0.1, [](double) { return world::Pose{0, {2000, kEyeHeight, 1000}, looking(0, -8)}; });
    c.sunAt = [](double time) { return sunAt(219 + 1.0 * time, 38); };
    c.cache.sunMotion.blendSeconds = 0;  // maps are judged as they are shown
    for (size_t i = 1; i < 50; i += 4) c.judged.push_back(i);
    const Contestant doughnut{"doughnut:side=512:bias-receiver=1.5"};
    c.claims = {
        fails(doughnut, kFlipsPerWrong, 2.0 / 3, kNew),
        fails({"valient:side=512:bias-receiver=1.5"}, kFlipsPerWrong, 2.0 / 3, kNew),
        holdsBeside(kGnomon, kFlips, 0.3, doughnut, "its sun steps by half a degree, in one frame of six: in two or three of the 13 pairs"),
        holds(kGnomon, kWrongAway, 0.03,
              "it lags by 13 mrad at most, which moves a block's shadow, h / sin^2 e, by 3 cm at half its height: no more "
              "than a texel but in the finest map. A sun that stood still would be at 0.13"),
        failsBeside({"gnomon:side=512", Sabotage::kMixedSuns}, kWrongAway, 10, kGnomon,
                    "half a degree at two kilometres from the origin is 17 m of light space"),
    };
    return c;
}

SuiteCase jumps() {
    SuiteCase c = blocks("jumps", "to and fro by fifteen metres, then away by five hundred, on a budget of texels");
    c.stage.addGround({512, 0}, 256);
    c.stage.addBlocks(8, {512, 0}, 140, 3.5);
    c.poses = poses(48, 1 / 30.0, [](double i) {
        const double x = i < 16 ? 0 : i < 20 ? 15 : i < 24 ? 0 : i < 28 ? 15 : 512;
        return world::Pose{0, {x, kEyeHeight, 0}, looking(90, -8)};
    });
    c.cache.budget.texels = 100000;
    c.judged = {16, 20, 24, 46};
    c.claims = {
        fails({"gnomon:side=512", Sabotage::kUnknownAsEmpty}, kFalseLitAway, 5, "what is not drawn yet has no shadows, and shadows cover a fifth of the view"),
        fails({"gnomon:side=512", Sabotage::kForgottenDebt}, kFalseLitAway, 5, "what one frame leaves undone is never done"),
        holds(kGnomon, kWrongAway, kBlended, "the coarsest map still holds all that is seen after a small jump; 18 frames draw all four after a large one"),
    };
    return c;
}

SuiteCase roof() {
    SuiteCase c;
    c.name = "a roof that leaves";
    c.what = "the one occluder that hid all boxes beneath is deleted";
    c.stage.addGround({0, 0}, 256);
    c.stage.addBox({0, 6, -14}, {30, 0.5, 30}, "roof");
    for (int i = 0; i < 24; ++i) c.stage.addBox({-6 + 4.0 * (i % 6), 1.25, -7 - 4.0 * (i / 6)}, {2, 2.5, 2});
    c.sun = kHighSun;
    c.verticalFov = glm::radians(60.0);
    c.poses = poses(20, 0.5, [](double) { return world::Pose{0, {0, kEyeHeight, 0}, looking(0, -10)}; });
    c.removals = {{"roof", 7}};
    c.judged = {16};
    c.claims = {
        fails({"gnomon:side=512", Sabotage::kStickyCertificate}, kFalseLitAway, 0.5,
              "what the roof hid in the outer two maps is never drawn; nearer boxes ask more rays than a certificate may cost"),
        fails({"gnomon:side=512", Sabotage::kDeafDeparture}, kFalseShadowAway, 20, "the roof's shadow stays: it covers half of the view"),
        holds(kGnomon, kWrongAway, kBlended, kExact),
    };
    return c;
}

SuiteCase crate() {
    SuiteCase c;
    c.name = "static to active and back";
    c.what = "a crate moves, rests until it is static, and moves again";
    c.stage.addGround({0, 0}, 256);
    c.stage.addBox({-4, 1.5, -10}, {3, 3, 3}, "crate");
    world::MoverSample a = c.stage.restOf("crate", 0), b = a, d = a;
    b.time = 2.5;
    b.position = {2, 1.5, -12};
    d.time = 20.5;
    d.position = {6, 1.5, -8};
    c.movers = {{"crate", {a, b, d}}};
    c.sun = kHighSun;
    c.verticalFov = glm::radians(60.0);
    c.poses = poses(26, 1, [](double) { return world::Pose{0, {0, kEyeHeight + 1, 0}, looking(0, -12)}; });
    c.judged = {0, 3, 15, 22};
    c.claims = {
        fails({"gnomon:side=512", Sabotage::kDeafDeparture}, kFalseShadowAway, 1, "the crate's shadow stays where it rested: it covers 2 % of the view"),
        holds(kGnomon, kWrongAway, kBlended, kExact),
    };
    return c;
}

/// A chunk's ground and a hut, whose coarse level stands three times as high.
world::Mesh hut() {
    world::Mesh mesh;
    for (const float height : {2.0f, 6.0f}) {
        world::MeshLevel level;
        addUnitBox(level, {float(kStageChunk) / 2, -0.5f, float(kStageChunk) / 2}, {float(kStageChunk), 1, float(kStageChunk)});
        addUnitBox(level, {16, height / 2, 16}, {4, height, 4});
        level.error = height == 2 ? 0 : 4;
        mesh.levels.push_back(std::move(level));
    }
    return mesh;
}

SuiteCase churn() {
    SuiteCase c;
    c.name = "chunk churn";
    c.what = "chunks come late and coarsely, then finely, as the eye flies on and rests";
    for (int x = -3; x < 12; ++x)
        for (int z = -4; z < 4; ++z) c.stage.terrain[{x, 0, z}] = hut();
    c.sun = kHighSun;
    c.verticalFov = glm::radians(60.0);
    c.poses = poses(90, 0.1, [](double i) {
        return world::Pose{0, {8 * std::min(i, 20.0), 8, 0}, looking(-70, -20)};
    });
    c.cache.streaming.clock = world::Clock::kVirtual;
    c.cache.streaming.disk.latency = 0.2;
    c.judged = {88};
    c.claims = {
        fails({"gnomon:side=512", Sabotage::kDeafDeparture}, kFalseShadowAway, 0.5, "the coarse huts' shadows stay, three times as long"),
        holds(kGnomon, kWrongAway, kBlended, kExact),
    };
    return c;
}

SuiteCase straddlers() {
    SuiteCase c;
    c.name = "border straddlers";
    c.what = "long walls lie across the borders of maps that scroll";
    c.stage.addGround({0, 0}, 384);
    for (int i = 0; i < 40; ++i)
        c.stage.addBox({-60 + 12.0 * (i % 10), 1, -60 + 35.0 * (i / 10)}, i % 2 ? glm::dvec3(40, 2, 0.6) : glm::dvec3(0.6, 2, 30));
    c.sun = kHighSun;
    c.verticalFov = glm::radians(60.0);
    c.poses = poses(24, 1 / 30.0, [](double i) { return world::Pose{0, {-30 + 1.5 * i, kEyeHeight + 3, 20 - 1.1 * i}, looking(-50, -10)}; });
    c.judged = {10, 16, 22};
    const std::string literal = "walls as long as windows are cut at each border, and their shadows cover a tenth of the view";
    c.claims = {
        fails({"scroll-literal:side=512"}, kFalseLitAway, 0.1, "walls are cut at each border; what draws them, below, loses nothing"),
        holds({"scroll:side=512"}, kFalseLitAway, 0, "exposed strips draw all that meets them"),
        fails({"gnomon:side=512", Sabotage::kLiteralScroll}, kFalseLitAway, 1, literal),
        holds(kGnomon, kWrongAway, kBlended, kExact),
    };
    return c;
}

}  // namespace

std::vector<SuiteCase> suiteCases() {
    return {creep(),      turning(), facing(),     aside(), sunSweep(), twoDegrees(), farAway("1e6 m away", 1e6),
            farAway("1e7 m away", 1e7), zoom(),  jumps(), thin(), seam(), roof(), crate(), churn(), straddlers(), tower(), cave()};
}

}  // namespace tools::lab
