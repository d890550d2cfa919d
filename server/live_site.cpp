#include "server/live_site.h"

#include <charconv>
#include <optional>
#include <span>

#include "server/embedded/chart.h"
#include "server/embedded/chart_licence.h"
#include "server/embedded/charts_js.h"
#include "server/embedded/icon.h"
#include "server/embedded/maps_js.h"
#include "server/embedded/page.h"
#include "server/embedded/page_css.h"
#include "server/embedded/page_js.h"
#include "server/embedded/plan_js.h"
#include "server/live_json.h"
#include "server/metrics.h"

namespace server {
namespace {

constexpr const char* kHtml = "text/html; charset=utf-8";
constexpr const char* kScript = "text/javascript; charset=utf-8";
constexpr const char* kText = "text/plain; charset=utf-8";

struct Asset {
    std::string_view path;
    const char* type;
    std::span<const unsigned char> bytes;
};

const Asset kAssets[] = {
    {"/", kHtml, embedded::kPage},
    {"/page.css", "text/css; charset=utf-8", embedded::kPageCss},
    {"/page.js", kScript, embedded::kPageJs},
    {"/maps.js", kScript, embedded::kMapsJs},
    {"/plan.js", kScript, embedded::kPlanJs},
    {"/charts.js", kScript, embedded::kChartsJs},
    {"/chart.js", kScript, embedded::kChart},
    {"/chart-licence.txt", kText, embedded::kChartLicence},
    {"/icon.svg", "image/svg+xml", embedded::kIcon},
};

SiteAnswer failure(int status, const std::string& what) { return {status, kText, what + "\n", false, 0}; }

/// The number that a query gives a name; empty if it does not, or gives anything but digits.
std::optional<uint64_t> numberOf(std::string_view query, std::string_view name) {
    while (!query.empty()) {
        const size_t end = std::min(query.find('&'), query.size());
        const std::string_view pair = query.substr(0, end);
        query.remove_prefix(std::min(end + 1, query.size()));
        if (pair.size() <= name.size() || !pair.starts_with(name) || pair[name.size()] != '=') continue;
        const std::string_view text = pair.substr(name.size() + 1);
        uint64_t value = 0;
        const auto [rest, error] = std::from_chars(text.data(), text.data() + text.size(), value);
        if (error != std::errc() || rest != text.data() + text.size()) return std::nullopt;
        return value;
    }
    return std::nullopt;
}

SiteAnswer map(const LiveBoard& board, std::string_view query) {
    const auto session = numberOf(query, "session"), cascade = numberOf(query, "cascade");
    if (!session || !cascade) return failure(400, "give /map?session=ID&cascade=N, both of them numbers");
    const auto picture = board.picture(*session, size_t(*cascade));
    if (!picture) return failure(404, "no picture of that cascade: follow the session by /events first");
    return {200, "application/octet-stream", pictureBody(*picture), false, 0};
}

}  // namespace

SiteAnswer answer(LiveBoard& board, std::string_view target) {
    const size_t mark = std::min(target.find('?'), target.size());
    const std::string_view path = target.substr(0, mark), query = target.substr(std::min(mark + 1, target.size()));
    for (const Asset& asset : kAssets)
        if (path == asset.path) return {200, asset.type, std::string(asset.bytes.begin(), asset.bytes.end()), false, 0};
    if (path == "/events") {
        if (query.empty()) return {200, "text/event-stream", "", true, 0};
        const auto session = numberOf(query, "session");
        if (!session) return failure(400, "give /events?session=ID, a number");
        return {200, "text/event-stream", "", true, *session};
    }
    if (path == "/map") return map(board, query);
    if (path == "/healthz") return {200, kText, "alive\n", false, 0};
    if (path == "/readyz")
        return board.ready() ? SiteAnswer{200, kText, "ready\n", false, 0} : failure(503, "not ready: sessions are not taken now");
    if (path == "/metrics")
        return {200, "text/plain; version=0.0.4; charset=utf-8",
                metricsText(board.totals(), board.ready(), processResidentBytes()), false, 0};
    return failure(404, "there are /, /events, /map, /healthz, /readyz and /metrics");
}

}  // namespace server
