#include "tools/chart.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "tools/bench_report.h"

namespace tools {
namespace {

// The plot's area and type [pixels].
constexpr double kWidth = 800, kHeight = 500, kLeft = 90, kRight = 770, kTop = 60, kBottom = 420;
constexpr double kType = 14, kPoint = 4;
constexpr double kGlyph = 0.58 * kType;  ///< a letter's width, on the large side: what a browser sets may differ
constexpr std::array<const char*, 6> kColours{"#1b5e9e", "#b3401a", "#2b7a3d", "#7a3b8f", "#8a6d00", "#444444"};

/// For text and attributes.
std::string escaped(const std::string& text) {
    std::string out;
    for (const char c : text) {
        if (c == '&') out += "&amp;";
        else if (c == '<') out += "&lt;";
        else if (c == '>') out += "&gt;";
        else if (c == '"') out += "&quot;";
        else out += c;
    }
    return out;
}

struct Rect {
    double left, top, right, bottom;
    bool meets(const Rect& o) const { return left < o.right && o.left < right && top < o.bottom && o.top < bottom; }
};

std::string text(double x, double y, const char* anchor, const std::string& colour, const std::string& what) {
    return format("<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\" fill=\"%s\">", x, y, anchor, colour.c_str()) +
           escaped(what) + "</text>\n";
}

std::string stroke(double x1, double y1, double x2, double y2, const char* colour) {
    return format("<line x1=\"%.1f\" y1=\"%.1f\" x2=\"%.1f\" y2=\"%.1f\" stroke=\"%s\"/>\n", x1, y1, x2, y2, colour);
}

/// From data to pixels.
class Axes {
public:
    explicit Axes(const Chart& chart) {
        double mostX = 0, leastY = std::numeric_limits<double>::infinity(), mostY = 0;
        for (const ChartLine& line : chart.lines)
            for (const ChartPoint& p : line.points) {
                mostX = std::max(mostX, p.x);
                mostY = std::max(mostY, p.y);
                if (p.y > 0) leastY = std::min(leastY, p.y);
                zeros_ |= p.y == 0;
            }
        // Four to ten steps of 1, 2 or 5 times a power of ten.
        const double power = std::pow(10, std::floor(std::log10(std::max(mostX, 1e-300) / 4)));
        for (const double factor : {1.0, 2.0, 5.0})
            if (mostX >= 4 * factor * power) step_ = factor * power;
        steps_ = std::max(1, int(std::ceil(mostX / step_)));
        if (mostY > 0) {
            low_ = int(std::floor(std::log10(leastY)));
            high_ = std::max(low_ + 1, int(std::ceil(std::log10(mostY))));
        }
        bottom_ = zeros_ ? kBottom - (kBottom - kTop) / (high_ - low_ + 1) : kBottom;
    }
    double x(double value) const { return kLeft + value / (steps_ * step_) * (kRight - kLeft); }
    double y(double value) const {
        if (value == 0) return kBottom;
        return bottom_ - (std::log10(value) - low_) / (high_ - low_) * (bottom_ - kTop);
    }
    std::string draw() const {
        std::string out;
        const auto mark = [&](double at, const std::string& number) {
            out += stroke(kLeft, at, kRight, at, "#dddddd");
            out += text(kLeft - 8, at + kType / 3, "end", "#222222", number);
        };
        if (zeros_) mark(kBottom, "0");
        for (int decade = low_; decade <= high_; ++decade)
            mark(y(std::pow(10, decade)), format("%g", std::pow(10, decade)));
        for (int k = 0; k <= steps_; ++k) {
            out += stroke(x(k * step_), kBottom, x(k * step_), kBottom + 6, "#222222");
            out += text(x(k * step_), kBottom + 22, "middle", "#222222", format("%g", k * step_));
        }
        return out + stroke(kLeft, kBottom, kRight, kBottom, "#222222") + stroke(kLeft, kTop, kLeft, kBottom, "#222222");
    }

private:
    bool zeros_ = false;
    double step_ = 1;
    int steps_ = 1, low_ = 0, high_ = 1;  ///< of x; decades of y
    double bottom_ = kBottom;             ///< where the lowest decade begins
};

/// Puts labels beside their points, where they cover neither points nor each other.
class Labels {
public:
    void avoid(double x, double y) { taken_.push_back({x - kPoint, y - kPoint, x + kPoint, y + kPoint}); }
    std::string put(double x, double y, const std::string& what, const std::string& colour) {
        const double width = kGlyph * double(what.size()), gap = kPoint + 4;
        Rect best{};
        for (const double row : {-1.0, 1.0, -2.2, 2.2, -3.4, 3.4, -4.6, 4.6}) {  // above and below the line
            for (const double left : {x + gap, x - gap - width}) {
                const double top = y + row * kType - kType / 2;
                best = {left, top, left + width, top + kType};
                const bool inside = left >= kLeft && left + width <= kWidth && top >= 0 && best.bottom <= kBottom;
                if (inside && std::none_of(taken_.begin(), taken_.end(), [&](const Rect& r) { return r.meets(best); })) {
                    taken_.push_back(best);
                    return text(best.left, best.bottom - 2, "start", colour, what);
                }
            }
        }
        taken_.push_back(best);  // too many: it covers something
        return text(best.left, best.bottom - 2, "start", colour, what);
    }

private:
    std::vector<Rect> taken_;
};

}  // namespace

std::string toSvg(const Chart& chart) {
    const Axes axes(chart);
    std::string out = format("<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 %g %g\" width=\"%g\" height=\"%g\" "
                             "font-family=\"sans-serif\" font-size=\"%g\">\n<rect width=\"100%%\" height=\"100%%\" "
                             "fill=\"#ffffff\"/>\n",
                             kWidth, kHeight, kWidth, kHeight, kType);
    out += text(kLeft, 28, "start", "#000000", chart.title) + axes.draw();
    out += text((kLeft + kRight) / 2, kBottom + 52, "middle", "#222222", chart.x);
    out += text(kLeft, kTop - 10, "start", "#222222", chart.y);
    Labels labels;
    for (const ChartLine& line : chart.lines)
        for (const ChartPoint& p : line.points) labels.avoid(axes.x(p.x), axes.y(p.y));
    for (size_t k = 0; k < chart.lines.size(); ++k) {
        const std::string colour = kColours[k % kColours.size()];
        std::string path;
        for (const ChartPoint& p : chart.lines[k].points) path += format("%.1f,%.1f ", axes.x(p.x), axes.y(p.y));
        out += "<polyline points=\"" + path + "\" fill=\"none\" stroke=\"" + colour + "\" stroke-opacity=\"0.5\"/>\n";
        for (const ChartPoint& p : chart.lines[k].points) {
            const double x = axes.x(p.x), y = axes.y(p.y);
            out += format("<circle cx=\"%.1f\" cy=\"%.1f\" r=\"%g\" fill=\"%s\"/>\n", x, y, kPoint, colour.c_str());
            out += labels.put(x, y, chart.lines[k].name + ", " + p.label, colour);
        }
    }
    return out + "</svg>\n";
}

}  // namespace tools
