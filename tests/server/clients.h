// tests/server/clients.h — a service on a loopback port over a folder with one small world, and what clients ask of it.
#pragma once

#include <chrono>
#include <mutex>
#include <string>
#include <vector>

#include "server/client.h"
#include "server/local_host.h"
#include "server/service.h"
#include "tests/server/worlds.h"

namespace tests {

namespace v1 = gnomon::v1;

/// A folder with `streets.world`, baked once.
inline const std::string& servedFolder() {
    static const std::string folder = [] {
        const std::string path = temporary("served");
        std::filesystem::create_directory(path);
        const auto stats = world::bake(streets(glm::dvec3(0)), path + "/streets.world", [](size_t, size_t) {});
        if (!stats) throw std::runtime_error(stats.error().what);
        return path;
    }();
    return folder;
}

inline server::ServiceConfig serviceConfig() {
    server::ServiceConfig config;
    config.listen = "127.0.0.1:0";
    return config;
}

/// Over that folder.
inline std::unique_ptr<server::SessionHost> localHost(gpu::Device& device = validatedDevice()) {
    server::SessionLimits limits;
    limits.geometryBytes = 16 << 20;
    auto made = server::makeLocalHost(device, servedFolder(), limits);
    if (!made) throw std::runtime_error(made.error().what);
    return std::move(made.value());
}

/// A running service and what it told.
struct Running {
    explicit Running(const server::ServiceConfig& config = serviceConfig(), std::unique_ptr<server::SessionHost> drawing = localHost())
        : host(std::move(drawing)) {
        auto started = server::Service::start(*host, config, [this](const server::ServiceEvent& event) {
            const std::lock_guard lock(mutex);
            events.push_back(event);
        });
        if (!started) throw std::runtime_error(started.error().what);
        service = std::move(started.value());
    }
    server::Client client() const {
        auto connected = server::Client::connect(service->address());
        if (!connected) throw std::runtime_error(connected.error().what);
        return std::move(connected.value());
    }
    size_t told(const std::string& what) {
        const std::lock_guard lock(mutex);
        size_t count = 0;
        for (const server::ServiceEvent& e : events) count += e.what == what;
        return count;
    }
    /// Waits until no session is open; false after ten seconds.
    bool empty() const {
        for (int i = 0; i < 1000 && service->sessions() > 0; ++i) std::this_thread::sleep_for(std::chrono::milliseconds(10));
        return service->sessions() == 0;
    }

    std::mutex mutex;
    std::vector<server::ServiceEvent> events;
    std::unique_ptr<server::SessionHost> host;
    std::unique_ptr<server::Service> service;
};

inline void put(v1::Vector* to, glm::dvec3 v) {
    to->set_x(v.x);
    to->set_y(v.y);
    to->set_z(v.z);
}

inline v1::OpenSession openStreets() {
    v1::OpenSession open;
    open.set_world("streets");
    open.set_cascades(3);
    open.set_side(256);
    open.set_far(45);
    open.set_rest_seconds(0.5);
    return open;
}

/// Frame `k` of a life with walks, a jump, an object that is adopted, moved and let rest, one that is spawned and removed,
/// and items that cannot be done.
inline v1::Frame lifeFrame(uint64_t k) {
    v1::Frame frame;
    frame.set_sequence(100 + k);
    frame.set_time(double(k) / 30);
    put(frame.add_cameras()->mutable_position(), {k < 30 ? 0.4 * double(k) : -30 + 0.1 * double(k), 2, 0.1 * double(k)});
    frame.mutable_wants()->set_hashes(k % 5 == 0);
    if (k == 1) {
        v1::ObjectUpdate* adopt = frame.add_objects();
        adopt->set_object(7);
        adopt->mutable_adopt()->set_name("box " + world::toString(world::ChunkKey{0, 0, 0}) + " 0");
        frame.add_objects()->set_object(8);  // nothing is to happen to it
    }
    if (k >= 2 && k < 10) {
        v1::ObjectUpdate* move = frame.add_objects();
        move->set_object(7);
        put(move->mutable_move()->mutable_translation(), {2 + 0.3 * double(k), 1, 3});
    }
    if (k == 5) {
        v1::ObjectUpdate* spawn = frame.add_objects();
        spawn->set_object(1ull << 60);
        spawn->mutable_spawn()->set_mesh(1);
        put(spawn->mutable_spawn()->mutable_placement()->mutable_translation(), {4, 2, 1});
        frame.add_objects()->set_object(99);
        frame.mutable_objects()->rbegin()->mutable_remove();
    }
    if (k == 20) {
        frame.add_objects()->set_object(1ull << 60);
        frame.mutable_objects()->rbegin()->mutable_remove();
        frame.add_edits()->mutable_sphere()->set_radius(1);  // a world without terrain
    }
    return frame;
}

/// All that must be equal wherever a frame is drawn.
inline std::string deterministic(v1::FrameReply reply) {
    reply.clear_times();
    return reply.SerializeAsString();
}

}  // namespace tests
