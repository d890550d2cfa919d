// tools/chart.h — a line chart as a self-contained SVG, labelled where its points are.
// Source: Tufte, "The Visual Display of Quantitative Information", 1983 (direct labels, no frame that says nothing).
#pragma once

#include <string>
#include <vector>

namespace tools {

struct ChartPoint {
    double x = 0, y = 0;  ///< finite, 0 or more
    std::string label;
};

/// Points joined by a line, in their order.
struct ChartLine {
    std::string name;
    std::vector<ChartPoint> points;
};

struct Chart {
    std::string title;
    std::string x, y;  ///< what the axes show, with units
    std::vector<ChartLine> lines;
};

/// The x axis is linear from 0, the y axis logarithmic over whole decades; points at y = 0 lie on a mark of their own below
/// it. 800 x 500 pixels, dark on white. The same text for the same chart.
std::string toSvg(const Chart& chart);

}  // namespace tools
