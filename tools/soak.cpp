#include "tools/soak.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <random>

#include "culling/light_space.h"
#include "tools/summary.h"
#include "world/hash.h"

namespace tools {

namespace {

constexpr double kFps = 30;
/// Larger meshes are grounds and roofs: they would hide the rest.
constexpr double kLargestObject = 20;  // [m]

constexpr size_t kMostLights = 3;
/// So many chunks around the middle are edited: what edits hold in memory is bounded.
constexpr size_t kEditedChunks = 16;

uint64_t residentBytes() {
    std::ifstream file("/proc/self/statm");
    uint64_t total = 0, resident = 0;
    file >> total >> resident;
    return resident * static_cast<uint64_t>(sysconf(_SC_PAGESIZE));
}

class Life {
public:
    Life(server::ShadowSystem& system, const world::WorldStore& store, const SoakConfig& config)
        : system_(system), store_(store), config_(config), settings_(system.config()), rng_(config.seed), far_(system.config().farDistance) {
        const world::Box bounds = store.header().bounds;
        home_ = bounds.centre();
        reach_ = glm::dvec2(bounds.extent().x, bounds.extent().z) * 0.5;
        height_ = bounds.max.y - bounds.min.y;
        eye_ = home_;
        for (const world::ChunkRecord& record : store.chunks())
            if (!record.terrain.empty()) ground_.push_back(&record);
        std::stable_sort(ground_.begin(), ground_.end(), [this](const auto* a, const auto* b) {
            return glm::distance(a->bounds.centre(), home_) < glm::distance(b->bounds.centre(), home_);
        });
        ground_.resize(std::min(ground_.size(), kEditedChunks));
        for (uint32_t m = 0; m < store.meshes().size(); ++m) {
            const glm::dvec3 size = store.meshes()[m].bounds.extent();
            if (std::max({size.x, size.y, size.z}) <= kLargestObject) meshes_.push_back(m);
        }
    }

    const glm::dvec3& eye() const { return eye_; }

    world::Result<server::FrameReport> step(SoakReport& report) {
        if (left_ == 0) {
            startPhase(report);
            if (auto done = changeSettings(report); !done) return done.error();
            if (auto done = changeLights(report); !done) return done.error();
        }
        --left_;
        moveCamera();
        if (auto done = changeObjects(report); !done) return done.error();
        if (auto done = changeGround(report); !done) return done.error();
        server::FrameInput input;
        input.time = static_cast<double>(frame_++) / kFps;
        input.camera = {eye_, orientation_, fov_, 1.6};
        input.objects = updates_;
        if (system_.config().movingSun) input.sun = moveSun();
        auto advanced = system_.advance(input);
        if (!advanced) return advanced.error();
        if (!advanced.value().errors.empty()) return advanced.value().errors.front();
        return advanced;
    }
    bool limited() const { return limited_; }  ///< the frame had a budget

private:
    enum class Motion { kStand, kWalk, kRun, kTurn };
    struct Object {
        server::ObjectId id = 0;
        world::Placement placement;
        glm::dvec3 speed{0};  ///< [m] a frame; zero while it rests
        bool deforms = false;
    };

    double uniform(double low, double high) { return low + (high - low) * double(rng_()) / 4294967296.0; }
    bool chance(double share) { return uniform(0, 1) < share; }

    void startPhase(SoakReport& report) {
        left_ = 1 + rng_() % 40;
        motion_ = Motion(rng_() % 4);
        heading_ = uniform(0, 2 * 3.14159265358979);
        fov_ = chance(0.4) ? 0.9 : 0;
        const bool sky = chance(0.15);  // above everything, looking up: nothing is in view
        pitch_ = sky ? 1.5 : 0;
        eye_.y = home_.y + (sky ? height_ : 0);
        if (chance(0.15)) {
            ++report.jumps;
            // Near, so that maps overlap, or anywhere, so that chunks come and go.
            const glm::dvec2 stride = chance(0.5) ? glm::dvec2(far_ * 0.3) : reach_;
            const glm::dvec3 from = chance(0.5) ? eye_ : home_;
            eye_ = from + glm::dvec3(uniform(-stride.x, stride.x), 0, uniform(-stride.y, stride.y));
            eye_ = glm::clamp(eye_, home_ - glm::dvec3(reach_.x, 0, reach_.y), home_ + glm::dvec3(reach_.x, 0, reach_.y));
        }
        // Mostly at rest or slow; now and then too fast, and sometimes at once somewhere else.
        const double speeds[] = {0, 0, 0.0002, 0.002, 0.02};
        sunSpeed_ = speeds[rng_() % 5];
        if (chance(0.03)) sunAzimuth_ += uniform(0, 6);
        server::Budget budget;
        if (chance(0.3)) {
            const auto side = static_cast<uint64_t>(system_.config().side);
            budget.texels = 1 + side * side / (4 + rng_() % 60);
            if (chance(0.5)) budget.triangles = 2000 + rng_() % 20000;
        }
        limited_ = budget.texels != cache::Limits::kNone;
        CHECK(system_.setBudget(budget));
    }

    /// Now and then other maps, or back to those of the beginning.
    world::Result<world::Done> changeSettings(SoakReport& report) {
        if (!chance(0.05)) return world::Done{};
        server::MapSettings settings = settings_;
        switch (rng_() % 6) {
            case 0: break;
            case 1: settings.cascades = std::max(1, settings.cascades - 1); break;
            case 2: settings.guardBand = 8; break;
            case 4: settings.levelError = uniform(0.2, 4); break;
            case 3: settings.smallestCaster = uniform(0, 3); break;
            default: settings.format = gpu::DepthFormat::kD16; break;
        }
        ++report.reconfigurations;
        return system_.reconfigure(settings);
    }

    glm::dvec3 moveSun() {
        sunAzimuth_ += sunSpeed_;
        sunHeight_ = std::clamp(sunHeight_ + sunSpeed_ * 0.3, 0.2, 1.4);
        return culling::sunFromAngles(sunAzimuth_, sunHeight_);
    }

    /// Adds, moves or removes a spot light near the camera, or leaves them alone.
    world::Result<world::Done> changeLights(SoakReport& report) {
        culling::SpotLight light;
        light.position = eye_ + glm::dvec3(uniform(-20, 20), uniform(2, 12), uniform(-20, 20));
        light.direction = glm::normalize(glm::dvec3(uniform(-1, 1), -1, uniform(-1, 1)));
        light.halfAngle = uniform(0.2, 0.9);
        light.range = uniform(10, 60);
        light.side = 128;
        if (chance(0.3) && lights_.size() < kMostLights) {
            auto id = system_.addSpot(light);
            if (!id) return id.error();
            lights_.push_back(id.value());
        } else if (chance(0.2) && !lights_.empty()) {
            if (auto moved = system_.moveSpot(lights_.front(), light); !moved) return moved.error();
        } else if (chance(0.1) && !lights_.empty()) {
            if (auto removed = system_.removeSpot(lights_.front()); !removed) return removed.error();
            lights_.erase(lights_.begin());
        } else {
            return world::Done{};
        }
        ++report.lightChanges;
        return world::Done{};
    }

    /// Now and then digs or fills where the ground was when the world was baked.
    world::Result<world::Done> changeGround(SoakReport& report) {
        if (ground_.empty() || !chance(0.05)) return world::Done{};
        const world::ChunkRecord& record = *ground_[rng_() % ground_.size()];
        const auto chunk = store_.readChunk(record.key);
        if (!chunk) return chunk.error();
        const std::vector<glm::vec3>& points = chunk.value().terrain.levels.back().positions;
        const double edge = store_.header().chunkSize, radius = uniform(0.005, 0.1) * edge;
        const glm::dvec3 p = glm::dvec3(points[rng_() % points.size()]) + glm::dvec3(record.key.x, 0, record.key.z) * edge;
        const glm::dvec3 reach(uniform(0.01, 0.1) * edge, uniform(0.01, 0.1) * edge, uniform(0.01, 0.1) * edge);
        world::TerrainEdit edit{chance(0.5) ? world::EditKind::kDig : world::EditKind::kFill, world::Sphere{p, radius}};
        if (chance(0.3)) edit.shape = world::Box{p - reach, p + reach};
        if (chance(0.3)) edit.shape = world::Capsule{p - reach, p + reach, radius};
        ++report.edits;
        return system_.edit(edit);
    }

    void moveCamera() {
        const double speed = motion_ == Motion::kWalk ? 1.5 / kFps : motion_ == Motion::kRun ? 15 / kFps : 0;
        if (motion_ == Motion::kTurn) heading_ += glm::radians(210 / kFps);
        eye_ += glm::dvec3(-std::sin(heading_), 0, -std::cos(heading_)) * speed;
        orientation_ = glm::angleAxis(heading_, glm::dvec3(0, 1, 0)) * glm::angleAxis(pitch_, glm::dvec3(1, 0, 0));
    }

    world::Placement somewhere() {
        world::Placement placement;
        const double turn = uniform(0, 6.28), scale = uniform(0.5, 2), reach = far_ * 0.8;
        const glm::dmat3 linear = glm::mat3_cast(glm::angleAxis(turn, glm::dvec3(0, 1, 0))) * scale;
        placement.linear = glm::mat3(linear);
        placement.translation = eye_ + glm::dvec3(uniform(-reach, reach), uniform(-0.3, 0.3) * height_, uniform(-reach, reach));
        return placement;
    }

    world::Result<world::Done> changeObjects(SoakReport& report) {
        updates_.clear();
        if (objects_.size() < config_.objects && !meshes_.empty() && chance(0.2)) {
            server::ObjectTraits traits;
            traits.deforms = chance(0.1);
            traits.atRest = !traits.deforms && chance(0.4);
            traits.margin = traits.deforms ? float(uniform(0, 1)) : 0;
            const world::Placement placement = somewhere();
            auto id = system_.spawn(meshes_[rng_() % meshes_.size()], placement, traits);
            if (!id) return id.error();
            objects_.push_back({id.value(), placement, glm::dvec3(0), traits.deforms});
            ++report.spawns;
        }
        if (!objects_.empty() && chance(objects_.size() == config_.objects ? 0.5 : 0.05)) {
            const size_t at = rng_() % objects_.size();
            if (auto done = system_.remove(objects_[at].id); !done) return done.error();
            objects_[at] = objects_.back();
            objects_.pop_back();
            ++report.removals;
        }
        if (chance(0.01))  // all stop at once
            for (Object& object : objects_) object.speed = glm::dvec3(0);
        for (Object& object : objects_) {
            if (chance(0.01)) object.speed = glm::dvec3(uniform(-0.3, 0.3), uniform(-0.02, 0.02), uniform(-0.3, 0.3));
            if (chance(0.02)) object.speed = glm::dvec3(0);
            const bool moves = object.speed != glm::dvec3(0);
            if (!moves && !object.deforms) continue;
            object.placement.translation += object.speed;
            updates_.push_back({object.id, object.placement});
            ++report.moves;
        }
        return world::Done{};
    }

    server::ShadowSystem& system_;
    const world::WorldStore& store_;
    const SoakConfig& config_;
    server::MapSettings settings_;  ///< of the beginning
    std::mt19937 rng_;
    glm::dvec3 home_{0}, eye_{0};
    glm::dvec2 reach_{0};
    double height_ = 0, far_ = 0;
    std::vector<uint32_t> meshes_;
    std::vector<const world::ChunkRecord*> ground_;  ///< with terrain
    std::vector<server::SpotId> lights_;
    std::vector<Object> objects_;
    std::vector<server::ObjectUpdate> updates_;
    uint64_t frame_ = 0, left_ = 0;
    Motion motion_ = Motion::kStand;
    double heading_ = 0, pitch_ = 0, fov_ = 0;
    double sunAzimuth_ = 1, sunHeight_ = 0.9, sunSpeed_ = 0;  ///< [rad], [rad] a frame
    glm::dquat orientation_{1, 0, 0, 0};
    bool limited_ = false;
};

void count(const server::FrameReport& frame, SoakReport& report) {
    ++report.frames;
    report.chunkArrivals += frame.chunkArrivals;
    report.chunkDepartures += frame.chunkDepartures;
    report.planHash = world::hashValues(std::span(&frame.planHash, 1), report.planHash);
    report.sunRedraws += frame.sun.redrawn;
    for (const cache::CascadeStatistics& c : frame.cascades) {
        report.sleepers += c.asleep;
        report.unknownTexels += c.unknownTexels;
    }
}

}  // namespace

world::Result<SoakReport> soak(server::ShadowSystem& system, const world::WorldStore& store, const SoakConfig& config,
                               const SoakFrame& onFrame) {
    CHECK(config.verifyEvery > 0);
    Life life(system, store, config);
    SoakReport report;
    glm::dvec3 shown{0};
    std::vector<double> memory[2], content[2];  // of each half
    const auto atFrame = [&](const world::Error& error) {
        return world::Error{error.code, "frame " + std::to_string(report.frames) + ": " + error.what, error.native};
    };
    while (report.frames < config.frames) {
        auto frame = life.step(report);
        if (!frame) return atFrame(frame.error());
        count(frame.value(), report);
        report.sunSteps += frame.value().sun.shown != shown && report.frames > 1;
        shown = frame.value().sun.shown;
        report.limitedFrames += life.limited();
        if (report.frames % config.verifyEvery == 0) {
            auto verified = system.verify();
            if (!verified) return atFrame(verified.error());
            ++report.verified;
            report.texels += verified.value().texels;
            report.stale += verified.value().stale;
            report.differing += verified.value().differing;
            const uint64_t bytes = residentBytes();
            const int half = report.frames <= config.frames / 2 ? 0 : 1;
            memory[half].push_back(double(bytes));
            content[half].push_back(double(frame.value().residentBytes + frame.value().geometryBytes));
            report.mostBytes = std::max(report.mostBytes, bytes);
            if (report.differing > 0) {
                report.first = std::move(verified.value().first);
                return report;
            }
        }
        if (const auto seen = onFrame(frame.value(), life.eye()); !seen) return seen.error();
    }
    report.firstHalfBytes = uint64_t(median(memory[0]));
    report.lastHalfBytes = uint64_t(median(memory[1]));
    report.firstHalfContent = uint64_t(median(content[0]));
    report.lastHalfContent = uint64_t(median(content[1]));
    return report;
}

}  // namespace tools
