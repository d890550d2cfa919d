#include "server/oversight.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

namespace server {

namespace v1 = gnomon::v1;
using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

namespace {

void add(v1::Cost* sum, const v1::Cost& cost) {
    sum->set_texels(sum->texels() + cost.texels());
    sum->set_casters(sum->casters() + cost.casters());
    sum->set_triangles(sum->triangles() + cost.triangles());
    sum->set_draws(sum->draws() + cost.draws());
}

}  // namespace

void addFrame(v1::SessionInfo& info, const v1::FrameReply& frame) {
    info.set_frames(info.frames() + 1);
    for (const v1::Cascade& cascade : frame.cascades()) {
        add(info.mutable_statics(), cascade.total());
        add(info.mutable_active(), cascade.active());
    }
    info.set_advance_ms(info.advance_ms() + frame.times().advance());
    info.set_wait_ms(info.wait_ms() + frame.times().wait());
    info.set_errors(info.errors() + uint64_t(frame.errors_size()));
    info.set_resident_bytes(frame.resident_bytes());
    info.set_geometry_bytes(frame.geometry_bytes());
}

Result<Done> writeToken(const std::string& path, const std::string& token) {
    const std::string text = token + "\n";
    const int file = ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW | O_CLOEXEC, 0600);
    const bool written = file >= 0 && ::fchmod(file, 0600) == 0 && ::write(file, text.data(), text.size()) == ssize_t(text.size());
    const int why = errno;
    if (file >= 0) ::close(file);
    if (written) return Done{};
    return Error{ErrorCode::kIo, path + ": the operator's token cannot be written: " + std::strerror(why), why};
}

}  // namespace server
