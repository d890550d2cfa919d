// tests/server/sessions.h — sessions in process over the world of streets.
#pragma once

#include <algorithm>
#include <memory>
#include <stdexcept>
#include <utility>

#include "server/session.h"
#include "tests/server/clients.h"

namespace tests {

inline const server::OpenedWorld& streets() {
    static const auto folder = server::WorldFolder::create(servedFolder());
    static const auto world = folder.value()->open("streets");
    return *world.value();
}

inline std::unique_ptr<server::Session> openSession(const v1::OpenSession& request = openStreets(), server::SessionLimits limits = {}) {
    limits.geometryBytes = std::min<uint64_t>(limits.geometryBytes, 16 << 20);
    auto session = server::Session::open(validatedDevice(), streets().store, request, limits);
    if (!session) throw std::runtime_error(session.error().what);
    return std::move(session.value());
}

}  // namespace tests
