// tools/summary_text.cpp — the summary of a replay as a person reads it: cached beside redrawn, line by line.
#include <cstdarg>
#include <cstdio>

#include "tools/summary.h"

namespace tools {
namespace {

/// printf into a string's end.
[[gnu::format(printf, 2, 3)]] void print(std::string& out, const char* format, ...) {
    va_list arguments, again;
    va_start(arguments, format);
    va_copy(again, arguments);
    const size_t length = static_cast<size_t>(std::vsnprintf(nullptr, 0, format, arguments));
    const size_t before = out.size();
    out.resize(before + length + 1);
    std::vsnprintf(out.data() + before, length + 1, format, again);
    out.resize(before + length);
    va_end(again);
    va_end(arguments);
}

/// "12,345" up to a million, then "1.235 M", then "1.235 G": at most 9 characters.
std::string count(double value) {
    char text[32];
    if (value >= 1e9) {
        std::snprintf(text, sizeof text, "%.3f G", value / 1e9);
    } else if (value >= 1e6) {
        std::snprintf(text, sizeof text, "%.3f M", value / 1e6);
    } else if (value >= 1e3) {
        const auto whole = static_cast<unsigned>(value);
        std::snprintf(text, sizeof text, "%u,%03u", whole / 1000, whole % 1000);
    } else {
        std::snprintf(text, sizeof text, "%.0f", value);
    }
    return text;
}
std::string count(uint64_t value) { return count(static_cast<double>(value)); }

std::string percent(double part, double whole) {
    if (whole <= 0) return "-";
    char text[32];
    const double share = 100 * part / whole;
    std::snprintf(text, sizeof text, share < 10 ? "%.2f %%" : "%.1f %%", share);
    return text;
}
std::string percent(uint64_t part, uint64_t whole) {
    return percent(static_cast<double>(part), static_cast<double>(whole));
}

std::string bytes(uint64_t value) {
    char text[32];
    std::snprintf(text, sizeof text, "%.1f MB", static_cast<double>(value) / 1e6);
    return text;
}

void printHead(std::string& out, const ReplayHead& head, const Summary& sum) {
    const server::ShadowConfig& config = head.config;
    print(out, "%s (%s), path %s%s%s: %llu frames, %.1f s\n", head.world.c_str(), head.source.c_str(),
          head.path.c_str(), head.movers.empty() ? "" : ", movers ", head.movers.c_str(),
          static_cast<unsigned long long>(sum.frames), sum.lastTime - sum.firstTime);
    print(out, "method %s, %d cascades of %d x %d texels, occlusion %s; %s, %s, %d threads\n\n",
          config.method == server::Method::kGnomon ? "gnomon" : "redraw", config.cascades, config.side,
          config.side, config.occlusion ? "exact" : "off", head.device.c_str(), head.driver.c_str(),
          head.threads);
}

void printCosts(std::string& out, const ReplayHead& head, const Summary& sum) {
    out += "Static part: what was drawn, beside the whole redraw of the same frames\n";
    print(out, "%-7s %8s %8s | %9s %9s %9s | %9s %9s %9s | %9s\n", "", "texel", "reach", "drawn", "drawn",
          "drawn", "redraw", "redraw", "redraw", "of all");
    print(out, "%-7s %8s %8s | %9s %9s %9s | %9s %9s %9s | %9s\n", "cascade", "[m]", "[m]", "texels",
          "casters", "triangles", "texels", "casters", "triangles", "triangles");
    const auto row = [&out](const std::string& name, const std::string& texel, const std::string& reach,
                            const cache::Cost& drawn, const cache::Cost& redraw) {
        print(out, "%-7s %8s %8s | %9s %9s %9s | %9s %9s %9s | %9s\n", name.c_str(), texel.c_str(),
              reach.c_str(), count(drawn.texels).c_str(), count(drawn.casters).c_str(),
              count(drawn.triangles).c_str(), count(redraw.texels).c_str(), count(redraw.casters).c_str(),
              count(redraw.triangles).c_str(), percent(drawn.triangles, redraw.triangles).c_str());
    };
    cache::Cost drawn, redraw;
    for (size_t c = 0; c < sum.cascades.size(); ++c) {
        char texel[32], reach[32];
        std::snprintf(texel, sizeof texel, "%.3f", head.texels[c]);
        std::snprintf(reach, sizeof reach, "%.0f", head.splits[c]);
        row(std::to_string(c), texel, reach, sum.cascades[c].total, sum.cascades[c].redraw);
        drawn += sum.cascades[c].total;
        redraw += sum.cascades[c].redraw;
    }
    row("all", "", "", drawn, redraw);
}

void printTimes(std::string& out, const Summary& sum) {
    print(out, "\nTimes: medians over the %zu frames that were also redrawn whole [ms]\n",
          sum.update.cached.size());
    print(out, "%-44s %9s %9s %9s\n", "", "cached", "redraw", "of it");
    const auto row = [&out](const std::string& name, const TimePair& times) {
        const double cached = median(times.cached), redrawn = median(times.redrawn);
        print(out, "%-44s %9.3f %9.3f %9s\n", name.c_str(), cached, redrawn,
              percent(cached, redrawn).c_str());
    };
    for (size_t c = 0; c < sum.cascades.size(); ++c)
        row("cascade " + std::to_string(c) + ", static part, timestamps", sum.cascades[c].staticTimes);
    if (!sum.spots.empty()) row("spot lights, timestamps", sum.spotTimes);
    row("all, static and active: record, draw, wait", sum.update);
}

void printCauses(std::string& out, const Summary& sum) {
    std::array<cache::Cost, cache::kCauses> byCause{};
    std::array<uint64_t, cache::kCauses> frames{};
    cache::Cost total, active;
    for (const CascadeSummary& cascade : sum.cascades) {
        for (size_t k = 0; k < cache::kCauses; ++k) {
            byCause[k] += cascade.byCause[k];
            frames[k] += cascade.framesByCause[k];
        }
        total += cascade.total;
        active += cascade.active;
    }
    out += "\nCauses of static drawing, all cascades (updates: frames times cascades)\n";
    print(out, "%-11s %9s %9s %9s %9s %9s %9s\n", "cause", "updates", "texels", "casters", "triangles",
          "draws", "of tri.");
    const auto row = [&](const char* name, const std::string& updates, const cache::Cost& cost) {
        print(out, "%-11s %9s %9s %9s %9s %9s %9s\n", name, updates.c_str(), count(cost.texels).c_str(),
              count(cost.casters).c_str(), count(cost.triangles).c_str(), count(cost.draws).c_str(),
              percent(cost.triangles, total.triangles).c_str());
    };
    for (size_t k = 0; k < cache::kCauses; ++k)
        row(cache::toString(static_cast<cache::Cause>(k)), count(frames[k]), byCause[k]);
    row("all static", "", total);
    print(out, "%-11s %9s %9s %9s %9s %9s\n", "active", "", count(active.texels).c_str(),
          count(active.casters).c_str(), count(active.triangles).c_str(), count(active.draws).c_str());
}

void printOcclusion(std::string& out, const ReplayHead& head, const Summary& sum) {
    if (!head.config.occlusion) return;
    const OcclusionValue value = occlusionValue(sum);
    const char* verdict = value.msSaved > sum.cpu.occlusionMs ? "it paid" : "it did not pay";
    print(out,
          "Occlusion  %s of the clusters found were hidden (%s of %s); %s rays and %.1f ms for %s "
          "certificates, %s revoked;\n"
          "           %s triangles not drawn, worth about %.1f ms: %s\n",
          percent(value.hidden, value.found).c_str(), count(value.hidden).c_str(), count(value.found).c_str(),
          count(sum.rays).c_str(), sum.cpu.occlusionMs, count(sum.certificates).c_str(),
          count(sum.revocations).c_str(), count(value.trianglesHidden).c_str(), value.msSaved, verdict);
}

/// One line per light: why it was redrawn, and what that and its active casters cost.
void printSpots(std::string& out, const Summary& sum) {
    for (size_t i = 0; i < sum.spots.size(); ++i) {
        const SpotSummary& spot = sum.spots[i];
        cache::Cost statics;
        std::string causes;
        for (size_t k = 0; k < cache::kCauses; ++k) {
            statics += spot.byCause[k];
            if (spot.framesByCause[k] == 0) continue;
            causes += (causes.empty() ? " " : ", ") + count(spot.framesByCause[k]) + " for " +
                      cache::toString(static_cast<cache::Cause>(k));
        }
        print(out,
              "Spot %-5zu redrawn%s: %s texels, %s triangles; active casters in %s frames: %s texels, %s triangles\n", i,
              causes.c_str(), count(statics.texels).c_str(), count(statics.triangles).c_str(),
              count(spot.activeFrames).c_str(), count(spot.active.texels).c_str(),
              count(spot.active.triangles).c_str());
    }
}

/// What was put off, for a budget or because nobody could see it; nothing where nothing was.
void printDebts(std::string& out, const Summary& sum) {
    for (size_t c = 0; c < sum.cascades.size(); ++c) {
        const CascadeSummary& cascade = sum.cascades[c];
        if (cascade.sleepingFrames + cascade.owingFrames == 0) continue;
        print(out,
              "Put off    cascade %zu slept in %s frames; owed texels after %s others: at most %s unknown and %s "
              "stale, the oldest for %s frames\n",
              c, count(cascade.sleepingFrames).c_str(), count(cascade.owingFrames).c_str(),
              count(cascade.mostUnknown).c_str(), count(cascade.mostStale).c_str(), count(cascade.oldestDebt).c_str());
    }
}

}  // namespace

std::string toText(const ReplayHead& head, const Summary& sum) {
    std::string out;
    printHead(out, head, sum);
    printCosts(out, head, sum);
    printTimes(out, sum);
    printCauses(out, sum);
    out += '\n';
    printOcclusion(out, head, sum);
    printSpots(out, sum);
    printDebts(out, sum);
    if (head.config.movingSun) {
        print(out, "Sun        %s steps, %s of them redrawn whole; at most %.3f degrees behind:", count(sum.sunSteps).c_str(),
              count(sum.sunRedraws).c_str(), glm::degrees(sum.mostSunLag));
        for (const double texel : head.texels) print(out, " %.1f", std::tan(sum.mostSunLag) * cache::kSunHeight / texel);
        print(out, " texels at %.0f m above the receiver\n", cache::kSunHeight);
    }
    print(out, "Streaming  %s chunk arrivals in %s frames, %s refined, %s departures; %s read, %s of it again, %s uploaded;\n"
               "           at most %s in memory and %s of geometry; %s errors\n",
          count(sum.chunkArrivals).c_str(), count(sum.arrivalFrames).c_str(), count(sum.refinements).c_str(),
          count(sum.chunkDepartures).c_str(), bytes(sum.bytesRead).c_str(), bytes(sum.bytesAgain).c_str(),
          bytes(sum.bytesUploaded).c_str(), bytes(sum.mostResident).c_str(), bytes(sum.mostGeometry).c_str(),
          count(sum.errors).c_str());
    if (sum.lackingFrames > 0)
        print(out, "Lacking    in %s frames a map lacked chunks, for %.2f s at most: %s texels of frames missing, %s too coarse\n",
              count(sum.lackingFrames).c_str(), sum.longestLack, count(sum.missingTexels).c_str(),
              count(sum.coarseTexels).c_str());
    print(out, "Frames     p50 %.3f ms, p95 %.3f ms, p99.9 %.3f ms, max %.3f ms; %s of %s submitted nothing\n",
          quantile(sum.frameMs, 0.5), quantile(sum.frameMs, 0.95), quantile(sum.frameMs, 0.999),
          quantile(sum.frameMs, 1), count(sum.idleFrames).c_str(), count(sum.frames).c_str());
    const std::string skipped =
        sum.skippedTexels > 0 ? ", " + count(sum.skippedTexels) + " left out as stale" : std::string();
    print(out, "Verified   %s frames, %s texels compared%s, %s differ; plans %016llx\n",
          count(sum.verifiedFrames).c_str(), count(sum.verifiedTexels).c_str(), skipped.c_str(),
          count(sum.differingTexels).c_str(), static_cast<unsigned long long>(sum.planHash));
    return out;
}

}  // namespace tools
