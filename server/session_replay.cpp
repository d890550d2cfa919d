#include "server/session_replay.h"

#include <google/protobuf/util/message_differencer.h>

#include <memory>
#include <optional>

#include "server/gnomon.pb.h"
#include "server/recording.h"
#include "server/session.h"

namespace server {

namespace v1 = gnomon::v1;
using world::Error;
using world::ErrorCode;
using world::Result;

namespace {

/// The next entry, parsed; kBadData for one of another kind, none at the end.
template <class Message>
Result<std::optional<Message>> next(RecordingReader& reader, EntryKind kind, const std::string& path) {
    auto entry = reader.next();
    if (!entry) return entry.error();
    if (!entry.value()) return std::optional<Message>{};
    Message message;
    if (entry.value()->kind != kind || !message.ParseFromString(entry.value()->message))
        return Error{ErrorCode::kBadData, path + ": no " + (kind == EntryKind::kRequest ? "request" : "reply") + " where one must be"};
    return std::optional<Message>(std::move(message));
}

/// How two replies differ, but for times; empty if they do not.
std::string difference(v1::FrameReply recorded, v1::FrameReply replayed) {
    for (v1::FrameReply* reply : {&recorded, &replayed}) {
        reply->clear_times();
        reply->clear_answers();  // how many frames waited is the network's doing
    }
    google::protobuf::util::MessageDifferencer differencer;
    std::string text;
    differencer.ReportDifferencesToString(&text);
    if (differencer.Compare(recorded, replayed)) return "";
    return "frame " + std::to_string(recorded.frame()) + ", sequence " + std::to_string(recorded.sequence()) + ":\n" + text;
}

}  // namespace

Result<SessionReplay> replaySession(gpu::Device& device, WorldFolder& worlds, const std::string& recording, bool compare,
                                    const std::function<void(const v1::FrameReply&)>& onFrame) {
    auto reader = RecordingReader::open(recording);
    if (!reader) return reader.error();
    const auto open = next<v1::SessionRequest>(reader.value(), EntryKind::kRequest, recording);
    if (!open) return open.error();
    const auto opened = next<v1::SessionReply>(reader.value(), EntryKind::kReply, recording);
    if (!opened) return opened.error();
    if (!open.value() || !open.value()->has_open() || !opened.value() || !opened.value()->has_opened())
        return Error{ErrorCode::kBadData, recording + ": it ends before its session was open"};
    const v1::SessionOpened& was = opened.value()->opened();
    const auto world = worlds.open(open.value()->open().world());
    if (!world) return world.error();
    if (world.value()->content != was.world().content())
        return Error{ErrorCode::kBadData, recording + ": world " + world.value()->name + " has other content than when it was recorded; give the folder with that one"};
    SessionLimits limits;
    limits.mapBytes = UINT64_MAX;
    limits.objects = limits.updates = limits.edits = limits.spots = SIZE_MAX;
    limits.residentBytes = was.resident_bytes();
    limits.geometryBytes = was.geometry_bytes();
    v1::OpenSession alone = open.value()->open();
    alone.set_share_maps(false);  // with nobody
    const auto session = Session::open(device, world.value()->store, alone, limits);
    if (!session) return session.error();

    SessionReplay replay;
    for (;;) {
        const auto request = next<v1::SessionRequest>(reader.value(), EntryKind::kRequest, recording);
        if (!request) return request.error();
        if (!request.value()) break;
        auto reply = session.value()->frame(request.value()->frame());
        if (!reply) return Error{reply.error().code, recording + ": frame " + std::to_string(replay.frames) + ": " + reply.error().what, reply.error().native};
        ++replay.frames;
        onFrame(reply.value());
        const auto recorded = next<v1::SessionReply>(reader.value(), EntryKind::kReply, recording);
        if (!recorded) return recorded.error();
        if (!recorded.value()) break;
        if (!compare) continue;
        ++replay.compared;
        replay.difference = difference(recorded.value()->frame(), reply.value());
        if (!replay.difference.empty()) break;
    }
    replay.torn = reader.value().torn();
    return replay;
}

}  // namespace server
