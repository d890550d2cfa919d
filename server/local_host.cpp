#include "server/local_host.h"

#include <zstd.h>

#include <algorithm>
#include <bit>
#include <utility>

#include "server/stopwatch.h"
#include "server/turns.h"
#include "server/world_folder.h"

namespace server {

namespace v1 = gnomon::v1;
using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

namespace {

constexpr int kZstdLevel = 1;  // depths of a frame are read once
constexpr uint32_t kTile = 256, kLeastTile = 16, kMostTile = 1024;

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

    Result<Done> depthMap(const v1::GetDepthMapRequest& request, const std::function<bool(const v1::DepthTile&)>& take) override {
        const uint32_t tile = request.tile() == 0 ? kTile : request.tile();
        if (!std::has_single_bit(tile) || tile < kLeastTile || tile > kMostTile)
            return Error{ErrorCode::kUsage, "tile: give a power of two from 16 to 1024 texels"};
        v1::DepthTile answer;
        Session::DepthMap map;
        {
            const Turns::Turn turn(turns_);
            auto read = session_->depthMap(request);
            if (!read) return read.error();
            map = std::move(read.value());
            if (map.cascade >= 0) *answer.mutable_cascade() = session_->cascade(map.cascade);
            answer.set_frame(session_->frames() - 1);
        }
        const auto side = uint32_t(map.side);
        std::vector<float> part;
        for (uint32_t y = 0; y < side; y += tile)
            for (uint32_t x = 0; x < side; x += tile) {
                cut(map, x, y, tile, part, answer);
                if (request.zstd()) {
                    const std::string raw = std::move(*answer.mutable_depths());
                    std::string& bytes = *answer.mutable_depths();
                    bytes.resize(ZSTD_compressBound(raw.size()));
                    bytes.resize(ZSTD_compress(bytes.data(), bytes.size(), raw.data(), raw.size(), kZstdLevel));
                }
                if (!take(answer)) return Done{};
                answer.clear_cascade();
            }
        return Done{};
    }

private:
    static void cut(const Session::DepthMap& map, uint32_t x, uint32_t y, uint32_t tile, std::vector<float>& part, v1::DepthTile& answer) {
        const auto side = uint32_t(map.side);
        const uint32_t width = std::min(tile, side - x), height = std::min(tile, side - y);
        part.clear();
        for (uint32_t j = 0; j < height; ++j) {
            const auto row = map.depths.begin() + std::ptrdiff_t(size_t(y + j) * side + x);
            part.insert(part.end(), row, row + width);
        }
        answer.set_x(x);
        answer.set_y(y);
        answer.set_width(width);
        answer.set_height(height);
        answer.set_depths(part.data(), part.size() * sizeof(float));
    }

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
