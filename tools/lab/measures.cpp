#include "tools/lab/measures.h"

#include <algorithm>
#include <cmath>

#include "world/check.h"

namespace tools::lab {
namespace {

using culling::Sunlight;

/// An edge may be so many times nearer than the radius at which it was found.
constexpr double kEdgeReach = 2.17;
/// Surfaces seen at a flatter angle than this count as if they were not [cosine]: their pixels are as long as one likes.
constexpr double kFlattest = 0.05;

}  // namespace

Measures& Measures::operator+=(const Measures& o) {
    frames += o.frames;
    pixels += o.pixels;
    falseLit += o.falseLit;
    falseShadow += o.falseShadow;
    difference += o.difference;
    softDifference += o.softDifference;
    unanswered += o.unanswered;
    points += o.points;
    flips += o.flips;
    usedShare += o.usedShare;
    texelsPerPixel.insert(texelsPerPixel.end(), o.texelsPerPixel.begin(), o.texelsPerPixel.end());
    return *this;
}

double Measures::texelRatio(double share) const {
    if (texelsPerPixel.empty()) return 0;
    std::vector<float> sorted = texelsPerPixel;
    const size_t at = std::min(sorted.size() - 1, size_t(share * double(sorted.size())));
    std::nth_element(sorted.begin(), sorted.begin() + std::ptrdiff_t(at), sorted.end());
    return double(sorted[at]);
}

Asked sunwardPixels(const culling::TruthFrame& truth) {
    Asked asked;
    for (size_t i = 0; i < truth.states.size(); ++i) {
        if (!culling::sunward(truth.states[i])) continue;
        const culling::SurfacePoint p = culling::surfaceAt(truth, i);
        asked.pixels.push_back(uint32_t(i));
        asked.receivers.push_back({p.position, p.normal, uint32_t(i)});
    }
    return asked;
}

Measures judge(const culling::TruthFrame& truth, const Asked& asked, std::span<const server::ReceiverLight> answers,
               double verticalFov, uint64_t texels) {
    CHECK(answers.size() == asked.pixels.size());
    CHECK(asked.shares.empty() || asked.shares.size() == answers.size());
    Measures m;
    m.frames = 1;
    m.pixels = answers.size();
    const double pixelAngle = 2 * std::tan(verticalFov / 2) / truth.height;  // [m] at 1 m
    double used = 0;
    for (size_t i = 0; i < answers.size(); ++i) {
        const size_t pixel = asked.pixels[i];
        const server::ReceiverLight& answer = answers[i];
        const bool truly = truth.states[pixel] == Sunlight::kLit;
        m.difference += std::abs(double(answer.light) - (truly ? 1.0 : 0.0));
        if (!asked.shares.empty()) m.softDifference += std::abs(double(answer.light) - double(asked.shares[i]));
        if (lit(answer) != truly) {
            Wrong& wrong = truly ? m.falseShadow : m.falseLit;
            ++(culling::edgeRadius(truth.edges[pixel]) <= kEdgeReach * double(answer.texel) ? wrong.atEdges : wrong.elsewhere);
        }
        if (answer.view < 0) {
            ++m.unanswered;
            continue;
        }
        const glm::dvec3 toPoint(truth.points[pixel]), normal(truth.normals[pixel]);
        const double distance = glm::length(toPoint), edge = distance * pixelAngle;
        m.texelsPerPixel.push_back(float(double(answer.texel) / edge));
        const double toEye = std::max(kFlattest, std::abs(glm::dot(normal, toPoint)) / distance);
        const double toSun = std::abs(glm::dot(normal, truth.sun));
        used += edge * edge / toEye * toSun / (double(answer.texel) * double(answer.texel));
    }
    m.usedShare = used / double(texels);
    return m;
}

Measures judgeFlips(const culling::TruthFrame& truth, const Asked& asked, std::span<const server::ReceiverLight> first,
                    std::span<const server::ReceiverLight> second, std::span<const Sunlight> again) {
    CHECK(first.size() == asked.pixels.size() && second.size() == first.size() && again.size() == first.size());
    Measures m;
    for (size_t i = 0; i < first.size(); ++i) {
        if (again[i] != truth.states[asked.pixels[i]]) continue;
        ++m.points;
        m.flips += std::abs(first[i].light - second[i].light) > 0.5f;
    }
    return m;
}

}  // namespace tools::lab
