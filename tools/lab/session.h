// tools/lab/session.h — what commands of the lab open before they begin: world, path, movers, sun, device.
#pragma once

#include <CLI/CLI.hpp>

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "tools/lab/engine.h"
#include "tools/lab/run.h"

namespace tools::lab {

struct SessionOptions {
    std::string world, path, movers, frames, sun;  ///< as typed; empty: not given
    double fps = 0;            ///< 0: the path's own times
    double farDistance = 600;  ///< [m]
    double fov = 60;           ///< vertical [degrees]
    uint64_t every = 0;        ///< RunConfig::every
    gpu::DeviceConfig device;
};
void addSessionOptions(CLI::App& parser, SessionOptions& options);

/// Opened and checked. Stays where it is: `setting` refers to the rest.
struct Session {
    std::unique_ptr<gpu::Device> device;
    std::optional<world::WorldStore> store;
    std::vector<world::MoverTrack> movers;
    std::vector<world::Pose> poses;
    std::optional<Scene> scene;
    std::optional<Setting> setting;
    RunConfig run;
};
/// Errors of what it reads, naming file or option; kUsage for a path of one frame, or far from the world.
world::Result<std::unique_ptr<Session>> openSession(const SessionOptions& options);

/// The truths that are kept in a folder of results, both made where there are none. kIo.
world::Result<TruthStore> openTruths(const std::string& folder);
/// Where results go if nobody says: NAME.lab.
std::string defaultFolder(const std::string& world);

}  // namespace tools::lab
