// server/shadow_system_impl.h — what a ShadowSystem keeps from frame to frame.
#pragma once

#include <deque>
#include <memory>
#include <vector>

#include "server/resident_scene.h"
#include "server/shadow_system.h"
#include "server/terrain_edits.h"

namespace server {

constexpr size_t kFramesInFlight = 2;

/// The times of pairs of maps as those of the cascades that they belonged to.
gpu::GpuTimes byCascade(const gpu::GpuTimes& maps, std::span<const uint8_t> cascadeOf, size_t cascades);

/// Pairs of maps lie sun by sun, within a sun camera by camera.
struct ShadowSystem::Impl {
    Impl(const world::WorldStore& worldStore, const ShadowConfig& c, std::unique_ptr<gpu::ShadowMaps> m,
         const culling::LightSpace& space, const std::vector<culling::Cascade>& lightCascades,
         world::WorldEditor* editor);

    /// `place`: which of the two sets of maps it draws into.
    std::unique_ptr<Sun> makeSun(const culling::LightSpace& space, size_t place, cache::Cause begin) const;
    size_t mapsPerSun() const { return mapsPerCamera * size_t(config.cameras); }
    size_t placeOf(const Sun& sun) const { return sun.caches.front().config().firstMap / mapsPerSun(); }
    size_t mapCount() const { return mapsPerSun() * (config.movingSun ? 2 : 1); }
    const Sun& shown() const { return *suns.front(); }
    /// Of a plan's pairs of maps: the number of the cascade that each belongs to.
    std::vector<uint8_t> cascadesOf(const cache::FramePlan& executed) const;

    world::Result<world::Done> takeCameras(const FrameInput& input);
    void moveSun(const FrameInput& input, FrameReport& report, SunMotion::Decision& decision);
    void redirect(const culling::LightSpace& space);
    void planShown(FrameReport& report);
    void planNext(double share, FrameReport& report);
    cache::Limits limits() const;
    world::Result<world::Done> takeEdits(FrameReport& report);
    world::Result<world::Done> learnRate(const FrameReport& report);
    void findGaps(double time, FrameReport& report);
    /// After a frame that was not drawn: what the maps hold is anybody's guess.
    world::Error lost(const world::Error& error) {
        for (auto& sun : suns) sun->forget();
        spots.forget();
        scene.settle();
        return error;
    }

    ShadowConfig config;
    const world::WorldStore& store;
    std::unique_ptr<gpu::ShadowMaps> maps;
    std::vector<culling::Cascade> cascades;
    size_t mapsPerCamera;  ///< for one sun
    ResidentScene scene;
    SpotLights spots;
    TerrainEdits edits;
    std::deque<std::shared_ptr<const world::EditedChunk>> untaken;  ///< edited, and not in the scene yet
    std::vector<std::unique_ptr<Sun>> suns;  ///< as the scene's sides: the one shown and, filling, the next
    SunMotion motion;
    glm::dvec3 sunNow;
    std::vector<Camera> cameras;  ///< of this frame
    std::vector<Eye> eyes;        ///< theirs
    cache::FramePlan plan, redraw;
    std::vector<cache::CascadeStatistics> statistics;  ///< scratch: of one camera
    std::vector<cache::RectSet> gaps;  ///< per cascade: texels of the shown window that a lacking chunk may shade
    cache::RectSet gap;                ///< scratch
    uint64_t frame = 0;
    uint64_t uploadedBefore = 0;
    bool planned = false;
    struct Submitted {
        gpu::Ticket ticket = 0;
        uint64_t triangles = 0;
    };
    std::deque<Submitted> underWay;  ///< frames that drew something and have not told their rate
    /// Frames under a time budget correct it. To begin with what lavapipe takes where strips are drawn, clears counted:
    /// whole maps take a seventh.
    double msPerTriangle = 1.0 / 1000;
};

}  // namespace server
