// tools/truth_store.h — traced truths on the disk: many methods share them, and a run that ended early goes on.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "culling/truth.h"
#include "world/database.h"
#include "world/result.h"
#include "world/store.h"

namespace tools {

/// A caster that does not stand where the world has it.
struct MovedCaster {
    world::CasterId id = 0;
    world::Placement placement;
};

/// All that a frame's truth follows from.
struct TruthQuestion {
    /// WorldStore::contentHash; the seed of another hash where casters were taken out or added. Equal worlds have their
    /// casters numbered alike.
    uint64_t world = 0;
    culling::View view;
    int width = 0, height = 0;  ///< [pixels]
    double farDistance = 0;     ///< [m]
    glm::dvec3 sun{0};
    std::vector<MovedCaster> moved;  ///< ascending by id
};

/// Equal for questions that are equal in every bit; others differ, but for one pair in 2^64.
uint64_t keyOf(const TruthQuestion& question);

/// A file of answers. One thread at a time; several processes may share a file.
class TruthStore {
public:
    /// Makes the file where there is none. kIo; kBadData for a file that is something else, or damaged.
    static world::Result<TruthStore> open(const std::string& path);

    /// The answer that is stored or, where there is none or a damaged one, that of `trace`, which is then stored.
    /// Errors of `trace` pass through, and kIo, kBadData of the file.
    ///   key, before, after  of the frame, and of the frames that points were seen in and looked for again in
    world::Result<culling::TruthFrame> frame(uint64_t key,
                                             const std::function<world::Result<culling::TruthFrame>()>& trace);
    /// `Truth::revisit` of the points of `before` that are no sky, in order, with the view of `after`.
    world::Result<std::vector<culling::Sunlight>> revisit(
        uint64_t before, uint64_t after, const std::function<world::Result<std::vector<culling::Sunlight>>()>& trace);
    world::Result<std::vector<float>> sunShares(uint64_t key, double angularRadius, int directions,
                                                const std::function<world::Result<std::vector<float>>()>& trace);

    uint64_t found() const { return found_; }
    uint64_t traced() const { return traced_; }
    /// What was damaged, and traced anew; a line each, for people.
    const std::vector<std::string>& damage() const { return damage_; }

private:
    explicit TruthStore(std::string path) : path_(std::move(path)) {}
    world::Error failure(const world::Error& error) const;
    world::Result<world::Done> prepare();
    world::Result<std::optional<std::vector<std::byte>>> read(const world::BlobKey& key);
    world::Result<world::Done> write(const world::BlobKey& key, std::span<const std::byte> raw);
    template <class T, class Encode, class Decode>
    world::Result<T> answer(const world::BlobKey& key, const std::function<world::Result<T>()>& trace, Encode encode,
                            Decode decode);

    std::string path_;
    std::optional<world::Database> database_;
    std::optional<world::Statement> find_, put_;
    uint64_t found_ = 0, traced_ = 0;
    std::vector<std::string> damage_;
};

}  // namespace tools
