#include "server/local_host.h"

#include <utility>

#include "server/stopwatch.h"
#include "server/turns.h"
#include "server/world_folder.h"

namespace server {

namespace v1 = gnomon::v1;
using world::Result;

namespace {

class LocalSession final : public HostedSession {
public:
    LocalSession(Turns& turns, std::shared_ptr<const OpenedWorld> world, std::unique_ptr<Session> session)
        : turns_(turns), world_(std::move(world)), session_(std::move(session)) {}
    ~LocalSession() override {
        const Turns::Turn turn(turns_);
        session_.reset();
    }

    Result<v1::FrameReply> frame(const v1::Frame& request) override {
        const Stopwatch watch;
        const Turns::Turn turn(turns_);
        const double waited = watch.ms();
        auto reply = session_->frame(request);
        if (reply) reply.value().mutable_times()->set_wait(waited);
        return reply;
    }

    Result<v1::QueryShadowReply> query(const v1::QueryShadowRequest& request) override {
        const Turns::Turn turn(turns_);
        return session_->query(request);
    }

    Result<v1::ShadowMask> mask(const v1::GetShadowMaskRequest& request) override {
        const Turns::Turn turn(turns_);
        return session_->mask(request);
    }

    Result<HostedMap> depthMap(const v1::GetDepthMapRequest& request) override {
        const Turns::Turn turn(turns_);
        const auto read = session_->depthMap(request);
        if (!read) return read.error();
        const std::vector<float>& depths = read.value().depths;
        HostedMap map{{reinterpret_cast<const char*>(depths.data()), depths.size() * sizeof(float)}, uint32_t(read.value().side), {}, session_->frames() - 1};
        if (read.value().cascade >= 0) map.cascade = session_->cascade(read.value().cascade);
        return map;
    }

    std::shared_ptr<SharedMaps> shared() override { return session_->shared(); }

private:
    Turns& turns_;
    std::shared_ptr<const OpenedWorld> world_;  ///< outlives the session
    std::unique_ptr<Session> session_;
};

class LocalHost final : public SessionHost {
public:
    LocalHost(gpu::Device& device, std::unique_ptr<WorldFolder> worlds, const SessionLimits& limits, LiveBoard* board)
        : device_(device), worlds_(std::move(worlds)), limits_(limits), board_(board) {}

    Result<std::vector<std::string>> worlds() override { return worlds_->names(); }

    Result<v1::WorldInfo> openWorld(const std::string& name) override {
        const auto world = worlds_->open(name);
        if (!world) return world.error();
        return describe(*world.value());
    }

    Result<std::unique_ptr<HostedSession>> open(const v1::OpenSession& request, uint64_t number, const std::string&,
                                                v1::SessionOpened& opened) override {
        auto world = worlds_->open(request.world());
        if (!world) return world.error();
        const Turns::Turn turn(turns_);
        auto session = Session::open(device_, world.value()->store, request, limits_);
        if (!session) return session.error();
        if (board_) session.value()->show(board_->open("session " + std::to_string(number), world.value()->name));
        *opened.mutable_world() = describe(*world.value());
        opened.set_resident_bytes(limits_.residentBytes);
        opened.set_geometry_bytes(limits_.geometryBytes);
        return std::unique_ptr<HostedSession>(new LocalSession(turns_, std::move(world.value()), std::move(session.value())));
    }

private:
    gpu::Device& device_;
    std::unique_ptr<WorldFolder> worlds_;
    const SessionLimits limits_;
    LiveBoard* const board_;
    Turns turns_;  ///< of whoever uses the device
};

}  // namespace

Result<std::unique_ptr<SessionHost>> makeLocalHost(gpu::Device& device, const std::string& worlds, const SessionLimits& limits,
                                                   LiveBoard* board) {
    auto folder = WorldFolder::create(worlds);
    if (!folder) return folder.error();
    return std::unique_ptr<SessionHost>(new LocalHost(device, std::move(folder.value()), limits, board));
}

}  // namespace server
