#include "tools/lab/tune.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <optional>
#include <tuple>

#include "culling/method_settings.h"
#include "culling/shadow_views.h"

namespace tools::lab {
namespace {

using culling::ShadowMethod;
using world::Result;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Settings that change together, from what is cheap to what is right.
struct Knob {
    std::vector<std::vector<culling::MethodSetting>> steps;
};

const std::vector<Knob>& knobs() {
    static const std::vector<Knob> all = {
        {{{{"side", "256"}}, {{"side", "384"}}, {{"side", "512"}}, {{"side", "768"}}, {{"side", "1024"}}, {{"side", "1536"}},
          {{"side", "2048"}}, {{"side", "3072"}}, {{"side", "4096"}}}},
        {{{{"cascades", "2"}, {"ratio", "4"}}, {{"cascades", "3"}, {"ratio", "4"}}, {{"cascades", "3"}, {"ratio", "3"}},
          {{"cascades", "4"}, {"ratio", "3"}}, {{"cascades", "5"}, {"ratio", "2.5"}}, {{"cascades", "6"}, {"ratio", "2"}}}},
        // A bias covers what a level of detail may be off by.
        {{{{"level-error", "4"}, {"bias-receiver", "4"}}, {{"level-error", "2"}, {"bias-receiver", "2"}},
          {{"level-error", "1"}, {"bias-receiver", "1"}}, {{"level-error", "0.5"}, {"bias-receiver", "0.5"}},
          {{"level-error", "0.25"}, {"bias-receiver", "0.25"}}, {{"level-error", "0.125"}, {"bias-receiver", "0.125"}}}},
        {{{{"bias-gradient", "0"}}, {{"bias-gradient", "0.1"}}, {{"bias-gradient", "0.3"}}, {{"bias-gradient", "1"}}}},
        {{{{"guard-band", "16"}}, {{"guard-band", "8"}}, {{"guard-band", "4"}}, {{"guard-band", "2"}}, {{"guard-band", "1"}}}},
        {{{{"filter", "none"}}, {{"filter", "box2"}}, {{"filter", "box3"}}}},
        {{{{"blend", "0"}}, {{"blend", "0.2"}}, {{"blend", "0.4"}}, {{"blend", "0.6"}}}},
        {{{{"rays", "0"}}, {{"rays", "1024"}}, {{"rays", "4096"}}}},
        {{{{"depth-bits", "16"}}, {{"depth-bits", "32"}}}}};
    return all;
}

std::string keyOf(const ShadowMethod& method) {
    std::string key;
    for (const culling::MethodSetting& s : culling::settingsOf(method)) key += s.name + '=' + s.value + ' ';
    return key;
}

std::string valueOf(const ShadowMethod& method, const std::string& name) {
    for (const culling::MethodSetting& s : culling::settingsOf(method))
        if (s.name == name) return s.value;
    return {};
}

/// The knob's step that the method stands on, by the first of its settings; nothing for one of its own.
std::optional<size_t> stepOf(const Knob& knob, const ShadowMethod& method) {
    for (size_t i = 0; i < knob.steps.size(); ++i)
        if (std::ranges::all_of(knob.steps[i], [&](const auto& s) { return valueOf(method, s.name) == s.value; })) return i;
    return std::nullopt;
}

/// By how much of the limit it is exceeded; of a limit of 0 by how much.
double excess(double value, double limit) {
    if (!(value > limit)) return 0;
    return limit > 0 ? value / limit - 1 : value;
}

double violation(const Trial& t, const TuneLimits& limits) {
    return excess(t.error.elsewhere, limits.error) + excess(t.instability.elsewhere, limits.instability) +
           excess(t.cost, limits.cost);
}

/// What is better comes first.
std::tuple<double, double, double> rankOf(const Trial& t, const TuneLimits& limits) {
    const double first = limits.cost < kInfinity && limits.error == kInfinity ? t.error.here : t.cost;
    return {violation(t, limits), first, t.error.here};
}

std::string differences(const ShadowMethod& from, const ShadowMethod& to) {
    std::string text;
    for (const culling::MethodSetting& s : culling::settingsOf(to)) {
        if (valueOf(from, s.name) == s.value) continue;
        if (!text.empty()) text += ", ";
        text += s.name + " " + s.value;
    }
    return text.empty() ? "nothing" : text;
}

std::string line(const char* what, const Trial& t) {
    char text[240];
    std::snprintf(text, sizeof text, "%-10s cost %10.0f triangles a frame, error %.4f %% (elsewhere %.4f %%), %.1f flips per million (%.1f)\n",
                  what, t.cost, t.error.here, t.error.elsewhere, t.instability.here, t.instability.elsewhere);
    return text;
}

/// So many of so many, in one pair of frames.
struct Part {
    double count = 0, of = 0;
};

/// Of `unit`. Source: the ratio estimator and its variance, Cochran, "Sampling Techniques", 1977.
Figure figureOf(const std::vector<Part>& parts, double unit) {
    Part sum;
    for (const Part& p : parts) sum = {sum.count + p.count, sum.of + p.of};
    if (sum.of == 0) return {};
    const double share = sum.count / sum.of, n = double(parts.size());
    double squares = 0;
    for (const Part& p : parts) squares += (p.count - share * p.of) * (p.count - share * p.of);
    const double deviation = n < 2 ? 0 : std::sqrt(squares / (n - 1)) / (sum.of / n);  // of one pair's share
    return {unit * share, unit * (share + 2 * deviation * std::sqrt(2 / n))};
}

/// The cheapest trial that keeps some limits.
const Trial* cheapest(const std::vector<Trial>& trials, const TuneLimits& limits) {
    const Trial* best = nullptr;
    for (const Trial& t : trials)
        if (violation(t, limits) == 0 && (!best || t.cost < best->cost)) best = &t;
    return best;
}

}  // namespace

Trial trialOf(const MethodResult& result) {
    const double frames = double(std::max<size_t>(1, result.frames));
    std::vector<Part> wrong, flips;
    for (size_t i = 0; i + 1 < result.judged.size(); i += 2) {
        Measures pair = result.judged[i].measures;
        pair += result.judged[i + 1].measures;
        wrong.push_back({double(pair.wrong()), double(pair.pixels)});
        flips.push_back({double(pair.flips), double(pair.points)});
    }
    return {result.method, figureOf(wrong, 100), figureOf(flips, 1e6),
            (double(result.cost.triangles) + double(result.cost.texels) / kTexelsPerTriangle) / frames};
}

Result<Tuned> tune(const ShadowMethod& start, const TuneLimits& limits, size_t mostTrials,
                   const std::function<Result<Trial>(const ShadowMethod&)>& judge) {
    Tuned tuned;
    std::map<std::string, size_t> known;
    /// Nothing where no more may be tried.
    const auto tryOne = [&](const ShadowMethod& method) -> Result<std::optional<size_t>> {
        const std::string key = keyOf(method);
        if (const auto at = known.find(key); at != known.end()) return std::optional(at->second);
        if (tuned.trials.size() == mostTrials) return std::optional<size_t>();
        auto trial = judge(method);
        if (!trial) return trial.error();
        known[key] = tuned.trials.size();
        tuned.trials.push_back(std::move(trial.value()));
        return std::optional(tuned.trials.size() - 1);
    };
    const auto first = tryOne(start);
    if (!first) return first.error();
    for (bool better = true; better;) {
        better = false;
        for (const Knob& knob : knobs()) {
            const auto at = stepOf(knob, tuned.trials[tuned.best].method);
            for (const int way : {-1, 1}) {
                // As far this way as it gets better.
                for (int step = at ? int(*at) + way : way < 0 ? 0 : int(knob.steps.size()); step >= 0 && step < int(knob.steps.size()); step += way) {
                    ShadowMethod method = tuned.trials[tuned.best].method;
                    for (const culling::MethodSetting& s : knob.steps[size_t(step)])
                        if (const auto done = culling::set(method, s.name, s.value); !done) return done.error();
                    if (!culling::requireMethod(method)) break;
                    const auto tried = tryOne(method);
                    if (!tried) return tried.error();
                    if (!tried.value() || !(rankOf(tuned.trials[*tried.value()], limits) < rankOf(tuned.trials[tuned.best], limits))) break;
                    tuned.best = *tried.value();
                    better = true;
                }
            }
        }
    }
    tuned.met = violation(tuned.trials[tuned.best], limits) == 0;
    return tuned;
}

std::string tuneText(const Tuned& tuned, const TuneLimits& limits) {
    const Trial &start = tuned.trials.front(), &best = tuned.trials[tuned.best];
    std::string text = line("start", start) + line(tuned.met ? "answer" : "nearest", best) + "changed    " +
                       differences(start.method, best.method) + "; " + std::to_string(tuned.trials.size()) + " configurations tried\n";
    char buffer[200];
    const auto each = [&](const char* name, double TuneLimits::*limit, const auto& valueOf) {
        if (limits.*limit == kInfinity) return;
        if (const double by = excess(valueOf(best), limits.*limit); by > 0) {
            std::snprintf(buffer, sizeof buffer, "not met    %s: %g where at most %g is asked, %.3g %s\n", name, valueOf(best),
                          limits.*limit, limits.*limit > 0 ? 100 * by : by, limits.*limit > 0 ? "% too much" : "too much");
            text += buffer;
            return;
        }
        TuneLimits others = limits;
        others.*limit = kInfinity;
        const Trial* without = cheapest(tuned.trials, others);
        if (!tuned.met || !without) return;
        std::snprintf(buffer, sizeof buffer, "%-10s the limit of %g costs %.0f triangles a frame (%.1f %%): without it %.0f, at %g\n", name,
                      limits.*limit, best.cost - without->cost, 100 * (1 - without->cost / best.cost), without->cost, valueOf(*without));
        text += buffer;
    };
    each("error", &TuneLimits::error, [](const Trial& t) { return t.error.elsewhere; });
    each("flips", &TuneLimits::instability, [](const Trial& t) { return t.instability.elsewhere; });
    each("cost", &TuneLimits::cost, [](const Trial& t) { return t.cost; });
    return text;
}

}  // namespace tools::lab
