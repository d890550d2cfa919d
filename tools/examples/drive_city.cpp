// tools/examples/drive_city.cpp — a client to copy: drives a camera along a recorded path through a served world, with
// movers, and prints what each cascade of each frame cost, as CSV.
//   drive_city ADDRESS WORLD PATH.tum [MOVERS.csv]
// Columns are those of `gnomon replay` (docs/columns.md), so the two can be held against each other.
#include <cinttypes>
#include <cstdio>
#include <optional>
#include <string>
#include <vector>

#include "server/client.h"
#include "world/movers.h"
#include "world/path.h"

namespace {

namespace v1 = gnomon::v1;
using world::Done;
using world::Result;

void put(v1::Vector* to, const glm::dvec3& v) {
    to->set_x(v.x);
    to->set_y(v.y);
    to->set_z(v.z);
}

void put(v1::Quaternion* to, const glm::dquat& q) {
    to->set_x(q.x);
    to->set_y(q.y);
    to->set_z(q.z);
    to->set_w(q.w);
}

/// Recorded motion as a session is told of it: each object is adopted by name, numbered by its place in the recording, and
/// posed anew whenever its sample is another one.
class Movers {
public:
    explicit Movers(std::vector<world::MoverTrack> tracks) : tracks_(std::move(tracks)), told_(tracks_.size()) {}

    void tell(double time, v1::Frame& frame) {
        for (size_t i = 0; i < tracks_.size(); ++i) {
            if (!told_[i]) {
                v1::ObjectUpdate* adopt = frame.add_objects();
                adopt->set_object(i);
                adopt->mutable_adopt()->set_name(tracks_[i].name);
            }
            const world::MoverSample& sample = world::sampleAt(tracks_[i], time);
            if (told_[i] == &sample) continue;
            told_[i] = &sample;
            v1::ObjectUpdate* update = frame.add_objects();
            update->set_object(i);
            put(update->mutable_pose()->mutable_position(), sample.position);
            put(update->mutable_pose()->mutable_orientation(), sample.orientation);
            update->mutable_pose()->set_scale(sample.scale);
        }
    }

private:
    std::vector<world::MoverTrack> tracks_;
    std::vector<const world::MoverSample*> told_;  ///< what the session was told last; null: it does not know the object
};

void printHeader() {
    std::printf("frame,cascade,window_x,window_y,static_texels,static_casters,static_triangles,static_draws,active_texels,active_casters,"
                "active_triangles,active_draws,redraw_texels,redraw_casters,redraw_triangles,redraw_draws,clusters_found,clusters_hidden,"
                "asleep,unknown_texels,stale_texels,oldest_debt,missing_texels,coarse_texels,frame_chunk_arrivals,frame_chunk_departures,"
                "frame_chunk_refinements,frame_chunks_missing,frame_chunks_coarse,frame_bytes_read,frame_resident_bytes,"
                "frame_geometry_bytes,frame_bytes_uploaded,frame_rays,frame_certificates,frame_revocations,plan_hash,cache_hash,"
                "working_hash,causes\n");
}

void print(const v1::Cost& cost) {
    std::printf(",%" PRIu64 ",%" PRIu64 ",%" PRIu64 ",%" PRIu64, cost.texels(), cost.casters(), cost.triangles(), cost.draws());
}

/// A row a cascade; the last column lists what each cause cost: scroll:TEXELS:CASTERS:TRIANGLES:DRAWS and so on.
void print(const v1::FrameReply& r) {
    for (int c = 0; c < r.cascades_size(); ++c) {
        const v1::Cascade& k = r.cascades(c);
        std::printf("%" PRIu64 ",%d,%" PRId64 ",%" PRId64, r.sequence(), c, k.window_x(), k.window_y());
        print(k.total());
        print(k.active());
        print(k.whole());
        std::printf(",%" PRIu64 ",%" PRIu64 ",%d,%" PRIu64 ",%" PRIu64 ",%" PRIu64 ",%" PRIu64 ",%" PRIu64, k.clusters_found(),
                    k.clusters_hidden(), int(k.asleep()), k.unknown_texels(), k.stale_texels(), k.oldest_debt(), k.missing_texels(),
                    k.coarse_texels());
        std::printf(",%u,%u,%u,%u,%u,%" PRIu64 ",%" PRIu64 ",%" PRIu64 ",%" PRIu64 ",%" PRIu64 ",%" PRIu64 ",%" PRIu64, r.chunk_arrivals(),
                    r.chunk_departures(), r.chunk_refinements(), r.missing_chunks(), r.coarse_chunks(), r.bytes_read(), r.resident_bytes(),
                    r.geometry_bytes(), r.bytes_uploaded(), r.rays(), r.certificates(), r.revocations());
        std::printf(",%016" PRIx64 ",%016" PRIx64 ",%016" PRIx64 ",", r.plan_hash(), k.cache_hash(), k.working_hash());
        for (int i = 0; i < k.causes_size(); ++i) {
            const v1::Cost& cost = k.causes(i).cost();
            std::printf("%s%s:%" PRIu64 ":%" PRIu64 ":%" PRIu64 ":%" PRIu64, i == 0 ? "" : ";", k.causes(i).cause().c_str(), cost.texels(),
                        cost.casters(), cost.triangles(), cost.draws());
        }
        std::printf("\n");
    }
}

Result<Done> drive(const std::string& address, const std::string& name, const std::string& pathFile, const std::string& moversFile) {
    const auto path = world::readTum(pathFile);
    if (!path) return path.error();
    std::vector<world::MoverTrack> tracks;
    if (!moversFile.empty()) {
        auto read = world::readMovers(moversFile);
        if (!read) return read.error();
        tracks = std::move(read.value());
    }
    Movers movers(std::move(tracks));

    auto client = server::Client::connect(address);
    if (!client) return client.error();
    if (const auto healthy = client.value().healthy(); !healthy)
        return world::Error{healthy.error().code, address + ": " + healthy.error().what + "; start `gnomon serve` there"};
    v1::OpenSession open;
    open.set_world(name);
    const auto session = client.value().session(open);
    if (!session) return session.error();

    printHeader();
    for (size_t i = 0; i < path.value().size(); ++i) {
        const world::Pose& pose = path.value()[i];
        v1::Frame frame;
        frame.set_sequence(i);
        frame.set_time(pose.time);
        v1::Camera* camera = frame.add_cameras();
        put(camera->mutable_position(), pose.position);
        put(camera->mutable_orientation(), pose.orientation);
        frame.mutable_wants()->set_hashes(true);
        frame.mutable_wants()->set_whole_redraws(true);
        movers.tell(pose.time, frame);
        const auto reply = session.value()->frame(frame);
        if (!reply) return reply.error();
        for (const v1::ItemError& error : reply.value().errors())
            std::fprintf(stderr, "frame %zu: %s\n", i, error.what().c_str());
        print(reply.value());
    }
    return session.value()->close();
}

}  // namespace

int main(int argc, char** argv) {
    if (argc < 4 || argc > 5) {
        std::fprintf(stderr, "usage: drive_city ADDRESS WORLD PATH.tum [MOVERS.csv], such as 127.0.0.1:50471 candela_city drive.tum\n");
        return 2;
    }
    const auto driven = drive(argv[1], argv[2], argv[3], argc > 4 ? argv[4] : "");
    if (driven) return 0;
    std::fprintf(stderr, "drive_city: %s\n", driven.error().what.c_str());
    return 3;
}
