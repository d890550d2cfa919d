#include "tools/lab/run.h"

#include <algorithm>
#include <map>

#include "world/check.h"

namespace tools::lab {
namespace {

using culling::SurfacePoint;
using world::CasterId;
using world::Done;
using world::Result;

/// Pairs of frames that are judged where nobody says how many.
constexpr size_t kPairs = 16;

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

/// Puts the scene's movers, and the rays', where they are in a pose. Those that it moved, ascending.
Result<std::vector<CasterId>> moveTo(Scene& scene, culling::Truth& truth, double time) {
    const auto span = scene.moveTo(time);
    std::vector<CasterId> moved(span.begin(), span.end());
    for (const CasterId id : moved)
        if (const auto placed = truth.place(id, scene.casters()[id].placement); !placed) return placed.error();
    std::sort(moved.begin(), moved.end());
    return moved;
}

/// What a method draws, and its answers, in the frames that are judged.
class Judge {
public:
    Judge(const Setting& setting, const culling::ShadowMethod& method, Engine& engine, MethodResult& result)
        : setting_(setting), method_(method), engine_(engine), result_(result) {}

    Result<Done> read(const world::Pose& pose) {
        auto images = engine_.images();
        if (!images) return images.error();
        images_ = std::move(images.value());
        view_ = viewAt(setting_, pose);
        return Done{};
    }
    std::vector<server::ReceiverLight> ask(const Asked& asked) const {
        const std::vector<std::span<const float>> spans(images_.begin(), images_.end());
        return server::shade(method_, engine_.views(), setting_.light, view_, spans, asked.receivers);
    }
    std::vector<server::ReceiverLight> add(const culling::TruthFrame& truth, const Asked& asked, size_t frame, const FrameCost& cost) {
        auto answers = ask(asked);
        uint64_t texels = 0;
        for (const std::vector<float>& image : images_) texels += image.size();
        result_.judged.push_back({frame, cost, judge(truth, asked, answers, setting_.verticalFov, texels)});
        result_.measures += result_.judged.back().measures;
        return answers;
    }

private:
    const Setting& setting_;
    const culling::ShadowMethod& method_;
    Engine& engine_;
    MethodResult& result_;
    std::vector<std::vector<float>> images_;
    culling::View view_;
};

}  // namespace

std::vector<size_t> judgedFrames(size_t poses, uint64_t every) {
    std::vector<size_t> frames;
    const size_t step = every > 0 ? size_t(every) : std::max<size_t>(2, poses / kPairs);
    for (size_t at = step / 2; at + 1 < poses; at += step) frames.push_back(at);
    return frames;
}

Result<std::vector<TruthPair>> traceTruth(const Setting& setting, std::span<const world::Pose> poses,
                                          std::span<const size_t> frames, const RunConfig& config,
                                          const std::function<void(size_t, size_t)>& onFrame) {
    std::vector<TruthPair> pairs;
    auto truth = tracedScene(setting.scene);
    if (!truth) return truth.error();
    uint64_t pixels = 0;
    for (const size_t frame : frames) {
        TruthPair pair;
        pair.frame = frame;
        const auto trace = [&](size_t at, culling::TruthFrame& into) -> Result<Done> {
            auto traced = truth.value()->trace(viewAt(setting, poses[at]), config.width, config.height, setting.farDistance,
                                               setting.light.sun);
            if (!traced) return traced.error();
            into = std::move(traced.value());
            return Done{};
        };
        if (const auto moved = moveTo(setting.scene, *truth.value(), poses[frame].time); !moved) return moved.error();
        if (const auto done = trace(frame, pair.first); !done) return done.error();
        const auto moved = moveTo(setting.scene, *truth.value(), poses[frame + 1].time);
        if (!moved) return moved.error();
        if (const auto done = trace(frame + 1, pair.second); !done) return done.error();
        pair.askedFirst = sunwardPixels(pair.first);
        pair.askedSecond = sunwardPixels(pair.second);
        std::vector<SurfacePoint> points;
        for (const uint32_t pixel : pair.askedFirst.pixels) points.push_back(culling::surfaceAt(pair.first, pixel));
        auto again = truth.value()->revisit(points, viewAt(setting, poses[frame + 1]), setting.farDistance,
                                            setting.light.sun, moved.value());
        if (!again) return again.error();
        pair.again = std::move(again.value());
        pixels += points.size() + pair.askedSecond.pixels.size();
        pairs.push_back(std::move(pair));
        onFrame(pairs.size(), frames.size());
    }
    if (pixels == 0)
        return world::Error{world::ErrorCode::kUsage, "the path never sees a surface that faces the sun; give another path, or another sun"};
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
            result.triangles.push_back(cost.value().cost.triangles);
            result.ms.push_back(cost.value().ms);
            if (first || second)
                if (const auto read = judge.read(poses[at]); !read) return read.error();
            if (first) before = judge.add(truth[pair].first, truth[pair].askedFirst, at, cost.value());
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
