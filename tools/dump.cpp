#include "tools/dump.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <optional>
#include <utility>

#include "server/cascade_images.h"
#include "tools/replay.h"

namespace tools {
namespace {

using Rgb = std::array<uint8_t, 3>;
constexpr Rgb kEmpty{28, 40, 84};
constexpr Rgb kUntouched{22, 22, 26};
constexpr Rgb kExposed{255, 140, 0};
constexpr Rgb kCleared{220, 0, 200};

/// Gray by height over the trend of a map: ground that tilts away from the sun spans most of the depths
/// there are and would leave what stands on it in one gray.
class Relief {
public:
    /// Fits a plane to the depths that occur (least squares) and stretches what is left of 99 % of them.
    Relief(std::span<const float> stored, const cache::Lattice& lattice, cache::Texel window) {
        double n = 0, sz = 0;
        glm::dvec2 sp(0), spz(0);
        glm::dmat2 spp(0);
        const auto each = [&](auto visit) {
            for (int64_t y = 0; y < lattice.side; ++y)
                for (int64_t x = 0; x < lattice.side; ++x) {
                    const cache::Texel at = lattice.slot(window + cache::Texel(x, y));
                    const float depth = stored[size_t(at.y * lattice.side + at.x)];
                    if (depth < 1) visit(glm::dvec2(double(x), double(y)), double(depth));
                }
        };
        each([&](glm::dvec2 p, double depth) {
            n += 1;
            sp += p;
            sz += depth;
            spp += glm::outerProduct(p, p);
            spz += p * depth;
        });
        if (n < 1) return;
        const glm::dvec2 mean = sp / n;
        const glm::dmat2 spread = spp - glm::outerProduct(sp, mean);
        if (std::abs(glm::determinant(spread)) > 1e-6) slope_ = glm::inverse(spread) * (spz - mean * sz);
        level_ = sz / n - glm::dot(slope_, mean);
        std::vector<float> rest;
        each([&](glm::dvec2 p, double depth) { rest.push_back(static_cast<float>(depth - trend(p))); });
        const auto quantile = [&rest](double q) {
            const auto at = rest.begin() + static_cast<ptrdiff_t>(q * double(rest.size() - 1));
            std::nth_element(rest.begin(), at, rest.end());
            return double(*at);
        };
        nearest_ = quantile(0.005);
        farthest_ = quantile(0.995);
    }
    /// (x, y) in window order.
    Rgb shade(float depth, int x, int y) const {
        if (!(depth < 1)) return kEmpty;
        const double span = farthest_ - nearest_, rest = double(depth) - trend({x, y});
        // Single precision leaves noise of this size on a plane: not worth a stretch.
        const double away = span > 1e-7 ? std::clamp((rest - nearest_) / span, 0.0, 1.0) : 0.5;
        const auto gray = static_cast<uint8_t>(std::lround(255 - 200 * away));
        return {gray, gray, gray};
    }

private:
    double trend(glm::dvec2 p) const { return level_ + glm::dot(slope_, p); }
    glm::dvec2 slope_{0};
    double level_ = 0, nearest_ = 0, farthest_ = 0;
};

Rgb tinted(Rgb base, Rgb tint) {
    Rgb out{};
    for (size_t k = 0; k < 3; ++k) out[k] = static_cast<uint8_t>((base[k] + 2 * tint[k]) / 3);
    return out;
}

/// Per stored texel, whether a rectangle covers it.
std::vector<uint8_t> coverage(std::span<const cache::StoreRect> rects, int side) {
    std::vector<uint8_t> covered(size_t(side) * size_t(side), 0);
    for (const cache::StoreRect& r : rects)
        for (int y = r.min.y; y < r.max.y; ++y)
            std::fill_n(covered.begin() + ptrdiff_t(y) * side + r.min.x, r.max.x - r.min.x, uint8_t(1));
    return covered;
}

}  // namespace

RgbImage scrollPicture(const ScrollMaps& maps) {
    const int side = maps.side;
    const size_t area = size_t(side) * size_t(side);
    CHECK(maps.before.size() == area && maps.after.size() == area && maps.redrawn.size() == area);
    const std::vector<uint8_t> cleared = coverage(maps.cleared, side);
    const cache::Lattice lattice{.texel = 1, .side = side};
    const Relief relief(maps.redrawn, lattice, maps.window);

    RgbImage image{side, 3 * side, std::vector<uint8_t>(3 * 3 * area)};
    const auto put = [&](int view, int x, int y, Rgb color) {
        std::copy(color.begin(), color.end(),
                  image.pixels.begin() + 3 * (ptrdiff_t(view) * ptrdiff_t(area) + ptrdiff_t(y) * side + x));
    };
    for (int y = 0; y < side; ++y) {
        for (int x = 0; x < side; ++x) {
            const cache::Texel stored = lattice.slot(maps.window + cache::Texel(x, y));
            const size_t at = size_t(stored.y * side + stored.x);
            // The window's move alone says what it exposed; other clears have other causes.
            const int64_t oldX = x + maps.move.x, oldY = y + maps.move.y;
            const bool exposed = oldX < 0 || oldY < 0 || oldX >= side || oldY >= side;
            const bool drawn = cleared[at] || maps.before[at] != maps.after[at];
            put(0, x, y, relief.shade(maps.redrawn[at], x, y));
            put(1, x, y, !cleared[at] ? relief.shade(maps.before[at], x, y) : exposed ? kExposed : kCleared);
            if (!drawn)
                put(2, x, y, kUntouched);
            else if (!cleared[at])
                put(2, x, y, relief.shade(maps.after[at], x, y));
            else
                put(2, x, y,
                    maps.after[at] < 1 ? relief.shade(maps.after[at], x, y)
                                       : tinted(kUntouched, exposed ? kExposed : kCleared));
        }
    }
    return image;
}

RgbImage smallPicture(const RgbImage& picture) {
    const int side = picture.width, views = picture.height / side;
    const int factor = (side + kSmallView - 1) / kSmallView, small = side / factor;
    RgbImage image{views * small, small, {}};
    image.pixels.reserve(size_t(image.width) * size_t(image.height) * 3);
    for (int y = 0; y < small; ++y)
        for (int x = 0; x < views * small; ++x)
            for (int channel = 0; channel < 3; ++channel) {
                int sum = 0;
                for (int dy = 0; dy < factor; ++dy)
                    for (int dx = 0; dx < factor; ++dx) {
                        const int row = (x / small) * side + y * factor + dy, column = (x % small) * factor + dx;
                        sum += picture.pixels[size_t((row * side + column) * 3 + channel)];
                    }
                image.pixels.push_back(uint8_t(sum / (factor * factor)));
            }
    return image;
}

Dump::Dump(const OutputFolder& folder, size_t frames) : folder_(folder) {
    // The middle of each eighth: the first frame, which draws everything, would show little.
    for (size_t k = 0; k < kFrames; ++k) wanted_.push_back((2 * k + 1) * frames / (2 * kFrames));
    wanted_.erase(std::unique(wanted_.begin(), wanted_.end()), wanted_.end());
}

Dump::Dump(const OutputFolder& folder, std::vector<size_t> wanted) : folder_(folder), wanted_(std::move(wanted)) {
    std::sort(wanted_.begin(), wanted_.end());
}

bool Dump::wants(size_t index) const { return std::binary_search(wanted_.begin(), wanted_.end(), index); }

world::Result<world::Done> Dump::before(server::ShadowSystem& system) {
    before_.clear();
    for (int c = 0; c < system.cascades(); ++c) {
        auto map = system.readMap(c, gpu::MapKind::kCache);
        if (!map) return map.error();
        before_.push_back(std::move(map.value()));
    }
    return world::Done{};
}

world::Result<world::Done> Dump::after(server::ShadowSystem& system, const ReplayFrame& frame) {
    const int side = system.config().side;
    const size_t cascades = before_.size();
    using Map = std::vector<float>;
    std::vector<Map> cached(cascades), redrawn(cascades), working(cascades);
    for (size_t c = 0; c < cascades; ++c) {
        const std::pair<gpu::MapKind, Map*> reads[] = {{gpu::MapKind::kCache, &cached[c]},
                                                       {gpu::MapKind::kScratchCache, &redrawn[c]},
                                                       {gpu::MapKind::kWorking, &working[c]}};
        for (const auto& [kind, map] : reads) {
            auto read = system.readMap(int(c), kind);
            if (!read) return read.error();
            *map = std::move(read.value());
        }
    }
    // Compression takes most of the time, and the pictures have nothing to do with each other.
    std::vector<std::optional<world::Error>> errors(cascades);
    const size_t firstSmall = small_.size();
    small_.resize(firstSmall + cascades);
    tbb::parallel_for(size_t(0), cascades, [&](size_t c) {
        const cache::CascadeStatistics& statistics = frame.report.cascades[c];
        const ScrollMaps maps{side,       statistics.window,          statistics.move, before_[c], cached[c],
                              redrawn[c], system.clearedRects(int(c))};
        char name[64];
        std::snprintf(name, sizeof name, "frame_%06llu_cascade_%zu",
                      static_cast<unsigned long long>(frame.number), c);
        const std::string path = folder_.pathFor(name);
        const RgbImage picture = scrollPicture(maps);
        auto done = writePng(picture, path + ".png");
        auto png = pngOf(smallPicture(picture));
        if (png)
            small_[firstSmall + c] = {frame.number, int(c), std::move(png.value())};
        else
            done = png.error();
        if (done)
            done = writeDepthPng(server::unwrap(working[c], side, statistics.window), side, path + "_depth.png");
        if (!done) errors[c] = done.error();
    });
    for (const auto& error : errors)
        if (error) return *error;
    return world::Done{};
}

}  // namespace tools
