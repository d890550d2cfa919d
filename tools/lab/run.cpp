#include "tools/lab/run.h"

#include <algorithm>
#include <map>

#include "tools/lab/picture.h"
#include "tools/lab/shading_time.h"
#include "world/check.h"

namespace tools::lab {
namespace {

using culling::SurfacePoint;
using world::CasterId;
using world::Done;
using world::Result;

/// Pairs of frames that are judged where nobody says how many.
constexpr size_t kPairs = 16;
/// Rays to the sun's disk from a point: a share of it is right to about a thirtieth.
constexpr int kDiskRays = 32;

/// The scene's casters at full detail, for rays.
Result<std::unique_ptr<culling::Truth>> tracedScene(const Scene& scene) {
    auto truth = culling::Truth::create();
    if (!truth) return truth.error();
    std::map<const world::Mesh*, uint32_t> meshes;
    const world::CasterTable& table = scene.casters();
    for (CasterId id = 0; id < table.slots(); ++id) {
        const world::Mesh& mesh = table.meshOf(id);
        if (!meshes.contains(&mesh)) {
            const auto added = truth.value()->addMesh(mesh.levels.front());
            if (!added) return added.error();
            meshes[&mesh] = added.value();
        }
        if (const auto added = truth.value()->add(id, meshes.at(&mesh), table[id].placement); !added) return added.error();
    }
    return truth;
}

/// Rays against the scene with its movers where they are at a time. The scene is built for rays when the first is shot.
class Tracer {
public:
    explicit Tracer(Scene& scene) : scene_(scene) {}

    /// Those of the scene's casters that it moved, ascending.
    std::vector<CasterId> moveTo(double time) {
        const auto span = scene_.moveTo(time);
        std::vector<CasterId> moved(span.begin(), span.end());
        std::sort(moved.begin(), moved.end());
        return moved;
    }
    Result<culling::Truth*> truth() {
        if (!truth_) {
            auto made = tracedScene(scene_);
            if (!made) return made.error();
            truth_ = std::move(made.value());
        } else {
            for (const CasterId id : scene_.movers())
                if (const auto placed = truth_->place(id, scene_.casters()[id].placement); !placed) return placed.error();
        }
        return truth_.get();
    }

private:
    Scene& scene_;
    std::unique_ptr<culling::Truth> truth_;
};

/// What a method draws, and its answers, in the frames that are judged.
class Judge {
public:
    Judge(const Setting& setting, const culling::ShadowMethod& method, Engine& engine, MethodResult& result)
        : setting_(setting), method_(method), engine_(engine), result_(result), time_(setting, method) {}

    Result<Done> read(const world::Pose& pose) {
        auto images = engine_.images();
        if (!images) return images.error();
        images_ = std::move(images.value());
        view_ = viewAt(setting_, pose);
        return Done{};
    }
    std::vector<server::ReceiverLight> ask(const Asked& asked) const {
        return server::shade(method_, engine_.views(), engine_.light(), view_, spans(), asked.receivers);
    }
    Result<Done> time(const culling::TruthFrame& truth, const Asked& asked) {
        const auto ms = time_.measure(engine_, view_, spans(), truth, asked);
        if (!ms) return ms.error();
        result_.shadingMs.push_back(ms.value());
        return Done{};
    }
    std::vector<server::ReceiverLight> add(const culling::TruthFrame& truth, const Asked& asked, size_t frame, const FrameCost& cost) {
        auto answers = ask(asked);
        uint64_t texels = 0;
        for (const std::vector<float>& image : images_) texels += image.size();
        result_.judged.push_back({frame, cost, judge(truth, asked, answers, view_.verticalFov, texels)});
        const Measures& measures = result_.judged.back().measures;
        result_.measures += measures;
        if (result_.judged.size() == 1 || measures.wrong() > result_.worst.wrong)
            result_.worst = {frame, measures.wrong(), wrongPicture(truth, asked, answers)};
        return answers;
    }

private:
    std::vector<std::span<const float>> spans() const { return {images_.begin(), images_.end()}; }

    const Setting& setting_;
    const culling::ShadowMethod& method_;
    Engine& engine_;
    MethodResult& result_;
    ShadingTime time_;
    std::vector<std::vector<float>> images_;
    culling::View view_;
};

}  // namespace

std::vector<size_t> judgedFrames(size_t poses, uint64_t every) {
    CHECK(poses >= 2);
    std::vector<size_t> frames;
    const size_t step = std::max<size_t>(2, every > 0 ? std::min<size_t>(every, poses) : poses / kPairs);
    for (size_t at = std::min(step / 2, poses - 2); at + 1 < poses; at += step) frames.push_back(at);
    return frames;
}

Result<std::vector<TruthPair>> traceTruth(const Setting& setting, std::span<const world::Pose> poses,
                                          std::span<const size_t> frames, const RunConfig& config, TruthStore& store,
                                          const std::function<void(size_t, size_t)>& onFrame) {
    std::vector<TruthPair> pairs;
    Tracer tracer(setting.scene);
    const auto hash = setting.scene.hash();
    uint64_t pixels = 0;
    for (const size_t frame : frames) {
        TruthPair pair;
        pair.frame = frame;
        uint64_t keys[2] = {};
        std::vector<CasterId> moved;
        for (const size_t i : {0, 1}) {
            const world::Pose& pose = poses[frame + i];
            moved = tracer.moveTo(pose.time);
            const glm::dvec3 sun = lightAt(setting, pose.time).sun;
            TruthQuestion question{hash, viewAt(setting, pose), config.width, config.height, setting.farDistance, sun, {}};
            for (const CasterId id : setting.scene.movers()) question.moved.push_back({id, setting.scene.casters()[id].placement});
            keys[i] = keyOf(question);
            auto traced = store.frame(keys[i], [&]() -> Result<culling::TruthFrame> {
                const auto truth = tracer.truth();
                if (!truth) return truth.error();
                return truth.value()->trace(question.view, config.width, config.height, setting.farDistance, sun);
            });
            if (!traced) return traced.error();
            Asked& asked = i == 0 ? pair.askedFirst : pair.askedSecond;
            asked = sunwardPixels(traced.value());
            if (config.sunRadius > 0) {
                const auto shares = store.sunShares(keys[i], config.sunRadius, kDiskRays, [&]() -> Result<std::vector<float>> {
                    const auto truth = tracer.truth();
                    if (!truth) return truth.error();
                    return truth.value()->sunShares(traced.value(), config.sunRadius, kDiskRays);
                });
                if (!shares) return shares.error();
                for (const uint32_t pixel : asked.pixels) asked.shares.push_back(shares.value()[pixel]);
            }
            (i == 0 ? pair.first : pair.second) = std::move(traced.value());
        }
        std::vector<SurfacePoint> points;
        std::vector<size_t> asked;  // which of them face the sun
        for (size_t i = 0; i < pair.first.states.size(); ++i) {
            if (pair.first.states[i] == culling::Sunlight::kSky) continue;
            if (culling::sunward(pair.first.states[i])) asked.push_back(points.size());
            points.push_back(culling::surfaceAt(pair.first, i));
        }
        const auto again = store.revisit(keys[0], keys[1], [&]() -> Result<std::vector<culling::Sunlight>> {
            const auto truth = tracer.truth();
            if (!truth) return truth.error();
            return truth.value()->revisit(points, viewAt(setting, poses[frame + 1]), setting.farDistance,
                                          lightAt(setting, poses[frame + 1].time).sun, moved);
        });
        if (!again) return again.error();
        for (const size_t i : asked) pair.again.push_back(again.value()[i]);
        pixels += asked.size() + pair.askedSecond.pixels.size();
        pairs.push_back(std::move(pair));
        onFrame(pairs.size(), frames.size());
    }
    if (pixels == 0)
        return world::Error{world::ErrorCode::kUsage, "the path never sees a surface that faces the sun within the far distance; "
                                                      "give another path, another --sun, or a longer --far"};
    return pairs;
}

Result<MethodResult> judgeMethod(const Setting& setting, std::span<const world::Pose> poses,
                                 std::span<const TruthPair> truth, const culling::ShadowMethod& method,
                                 const std::function<void(size_t, size_t)>& onFrame) {
    CHECK(!poses.empty());
    setting.scene.moveTo(poses.front().time);
    auto engine = makeEngine(setting, method, poses.front());
    if (!engine) return engine.error();
    MethodResult result;
    result.method = method;
    Judge judge(setting, method, *engine.value(), result);
    std::vector<server::ReceiverLight> before;  // answers of the first frame of the pair at hand
    size_t pair = 0;
    for (size_t at = 0; at < poses.size(); ++at) {
        const bool first = pair < truth.size() && truth[pair].frame == at;
        const bool second = pair < truth.size() && truth[pair].frame + 1 == at;
        if (first || second || engine.value()->remembers()) {
            const auto cost = engine.value()->advance(poses[at]);
            if (!cost) return cost.error();
            ++result.frames;
            result.cost += cost.value().cost;
            result.drawn.push_back(at);
            result.triangles.push_back(cost.value().cost.triangles);
            result.ms.push_back(cost.value().ms);
            if (first || second)
                if (const auto read = judge.read(poses[at]); !read) return read.error();
            if (first) before = judge.add(truth[pair].first, truth[pair].askedFirst, at, cost.value());
            if (first && setting.shadingTimed)
                if (const auto timed = judge.time(truth[pair].first, truth[pair].askedFirst); !timed) return timed.error();
            if (second) {
                judge.add(truth[pair].second, truth[pair].askedSecond, at, cost.value());
                const auto after = judge.ask(truth[pair].askedFirst);
                const Measures flips = judgeFlips(truth[pair].first, truth[pair].askedFirst, before, after, truth[pair].again);
                result.judged.back().measures += flips;
                result.measures += flips;
                ++pair;
            }
        }
        onFrame(at + 1, poses.size());
    }
    return result;
}

}  // namespace tools::lab
