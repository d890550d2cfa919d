#include "server/shared_maps.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <new>

#include "world/check.h"

namespace server {

using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

namespace {

Error ioError(const char* doing) { return {ErrorCode::kIo, std::string("shared maps: ") + doing + ": " + std::strerror(errno), errno}; }

}  // namespace

Result<std::shared_ptr<SharedMaps>> SharedMaps::create(const SharedShape& shape) {
    const int descriptor = ::memfd_create("gnomon maps", MFD_CLOEXEC | MFD_ALLOW_SEALING);
    if (descriptor < 0) return ioError("memfd_create");
    if (::ftruncate(descriptor, off_t(shape.bytes())) != 0 || ::fcntl(descriptor, F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW) != 0) {
        const Error error = ioError("ftruncate");
        ::close(descriptor);
        return error;
    }
    void* at = ::mmap(nullptr, shape.bytes(), PROT_READ | PROT_WRITE, MAP_SHARED, descriptor, 0);
    if (at == MAP_FAILED) {
        const Error error = ioError("mmap");
        ::close(descriptor);
        return error;
    }
    auto* header = new (at) SharedHeader{};
    std::memcpy(header->magic, kSharedMagic, sizeof kSharedMagic);
    header->shape = shape;
    return std::shared_ptr<SharedMaps>(new SharedMaps(descriptor, {static_cast<std::byte*>(at), shape.bytes()}));
}

Result<std::shared_ptr<SharedMaps>> SharedMaps::open(int descriptor, bool writes) {
    struct stat status{};
    const auto refuse = [&](const Error& error) {
        ::close(descriptor);
        return error;
    };
    const Error bad{ErrorCode::kBadData, "shared maps: the memory is none of this build's"};
    if (::fstat(descriptor, &status) != 0) return refuse(ioError("fstat"));
    const auto size = uint64_t(status.st_size);
    if (size < kSharedPage) return refuse(bad);
    void* at = ::mmap(nullptr, size, writes ? PROT_READ | PROT_WRITE : PROT_READ, MAP_SHARED, descriptor, 0);
    if (at == MAP_FAILED) return refuse(ioError("mmap"));
    std::shared_ptr<SharedMaps> maps(new SharedMaps(descriptor, {static_cast<std::byte*>(at), size}));
    const SharedShape shape = maps->shape();
    const bool possible = shape.side > 0 && shape.side <= 1u << 16 && shape.cascades > 0 && shape.cascades <= 64 && (shape.texelBytes == 4 || shape.texelBytes == 2);
    if (std::memcmp(maps->header().magic, kSharedMagic, sizeof kSharedMagic) != 0 || !possible || shape.bytes() != size) return bad;
    return maps;
}

Result<std::shared_ptr<SharedMaps>> SharedMaps::write(int descriptor) { return open(descriptor, true); }
Result<std::shared_ptr<SharedMaps>> SharedMaps::read(int descriptor) { return open(descriptor, false); }

SharedMaps::~SharedMaps() {
    ::munmap(memory_.data(), memory_.size());
    ::close(descriptor_);
}

std::span<const std::byte> SharedMaps::map(int cascade) const {
    CHECK(cascade >= 0 && uint32_t(cascade) < shape().cascades);
    return memory_.subspan(offset(cascade), uint64_t(shape().side) * shape().side * shape().texelBytes);
}

Result<Done> SharedMaps::seal() {
    if (::fcntl(descriptor_, F_ADD_SEALS, F_SEAL_FUTURE_WRITE | F_SEAL_SEAL) != 0) return ioError("F_SEAL_FUTURE_WRITE");
    return Done{};
}

void SharedMaps::begin() {
    header().sequence.fetch_add(1, std::memory_order_relaxed);
    std::atomic_thread_fence(std::memory_order_release);
}

void SharedMaps::end(uint64_t frame) {
    header().frame.store(frame, std::memory_order_relaxed);
    header().sequence.fetch_add(1, std::memory_order_release);
}

std::optional<uint64_t> SharedMaps::sequence() const {
    std::atomic_thread_fence(std::memory_order_acquire);
    const uint64_t now = header().sequence.load(std::memory_order_acquire);
    if (now % 2 == 1) return std::nullopt;
    return now;
}

}  // namespace server
