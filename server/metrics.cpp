#include "server/metrics.h"

#include <unistd.h>

#include <fstream>
#include <sstream>

namespace server {
namespace {

class Text {
public:
    Text() { out_.precision(15); }
    void family(const char* name, const char* type, const char* help) {
        name_ = name;
        out_ << "# HELP " << name << ' ' << help << "\n# TYPE " << name << ' ' << type << '\n';
    }
    template <class T>
    void value(const T& value, const std::string& labels = "", const char* suffix = "") {
        out_ << name_ << suffix << labels << ' ' << value << '\n';
    }
    template <class T>
    void single(const char* name, const char* type, const char* help, const T& only) {
        family(name, type, help);
        value(only);
    }
    /// A counter by cause, the working maps' share among them.
    void byCause(const char* name, const char* help, const LiveTotals& t, uint64_t cache::Cost::*part) {
        family(name, "counter", help);
        for (int c = 0; c < cache::kCauses; ++c)
            value(t.byCause[size_t(c)].*part, label("cause", cache::toString(cache::Cause(c))));
        value(t.active.*part, label("cause", "active"));
    }
    static std::string label(const char* name, const std::string& value) {
        return std::string("{") + name + "=\"" + value + "\"}";
    }
    std::string take() { return std::move(out_).str(); }

private:
    std::ostringstream out_;
    std::string name_;
};

std::string bound(double seconds) {
    std::ostringstream out;
    out << seconds;
    return out.str();
}

}  // namespace

std::string metricsText(const LiveTotals& t, bool ready, uint64_t processBytes) {
    Text text;
    text.single("gnomon_ready", "gauge", "1 while the service takes sessions.", int(ready));
    text.single("gnomon_sessions", "gauge", "Sessions that are open.", t.sessions);
    text.single("gnomon_sessions_watched", "gauge", "Of these, sessions that a live page follows.", t.watched);
    text.single("gnomon_sessions_opened_total", "counter", "Sessions that were opened.", t.sessionsOpened);
    text.single("gnomon_frames_total", "counter", "Frames that were advanced.", t.frames);
    text.single("gnomon_frames_drawn_total", "counter", "Of these, frames that drew anything.", t.framesDrawn);
    text.single("gnomon_item_errors_total", "counter", "Items of frames that were left out for an error.", t.errors);
    text.byCause("gnomon_redrawn_texels_total",
                 "Texels redrawn in cache maps by cause, and restored in working maps (active).", t, &cache::Cost::texels);
    text.byCause("gnomon_drawn_triangles_total", "Triangles drawn into cache maps by cause, and into working maps (active).",
                 t, &cache::Cost::triangles);
    text.byCause("gnomon_draws_total", "Draws into cache maps by cause, and into working maps (active).", t,
                 &cache::Cost::draws);
    text.family("gnomon_frame_seconds", "histogram", "Wall time of frames until they are answered.");
    uint64_t frames = 0;
    for (size_t k = 0; k < t.frameTimes.size(); ++k) {
        frames += t.frameTimes[k];
        const bool last = k == LiveTotals::kBuckets.size();
        text.value(frames, Text::label("le", last ? "+Inf" : bound(LiveTotals::kBuckets[k])), "_bucket");
    }
    text.value(t.frameSeconds, "", "_sum");
    text.value(frames, "", "_count");
    text.single("gnomon_chunk_arrivals_total", "counter", "Chunks that came into memory.", t.chunkArrivals);
    text.single("gnomon_chunk_departures_total", "counter", "Chunks that left memory.", t.chunkDepartures);
    text.single("gnomon_missing_chunks", "gauge", "Chunks that maps need and that are not in memory.", t.missingChunks);
    text.single("gnomon_read_bytes_total", "counter", "Decoded bytes of chunks and meshes that were read.", t.bytesRead);
    text.single("gnomon_uploaded_bytes_total", "counter", "Bytes that were sent to the GPU.", t.bytesUploaded);
    text.single("gnomon_rays_total", "counter", "Rays that were traced for certificates.", t.rays);
    text.single("gnomon_certificates_total", "counter", "Clusters that were proven hidden.", t.certificates);
    text.single("gnomon_terrain_edits_total", "counter", "Edits of the ground that were taken up.", t.edits);
    text.single("gnomon_resident_bytes", "gauge", "Decoded chunks and meshes in memory, over all sessions.",
                t.residentBytes);
    text.single("gnomon_geometry_bytes", "gauge", "Geometry on the GPU, over all sessions.", t.geometryBytes);
    text.single("process_resident_memory_bytes", "gauge", "Memory of the process that is in RAM.", processBytes);
    return text.take();
}

uint64_t processResidentBytes() {
    std::ifstream file("/proc/self/statm");
    uint64_t all = 0, resident = 0;
    return file >> all >> resident ? resident * uint64_t(sysconf(_SC_PAGESIZE)) : 0;
}

}  // namespace server
