// tools/lab/judge_all.h — a run of the lab: methods one after the other, those that are kept already not again.
#pragma once

#include <functional>
#include <span>
#include <string>

#include "tools/lab/occlusion.h"
#include "tools/lab/record.h"
#include "world/result.h"

namespace tools::lab {

/// Called after each step of work: steps done, of how many.
using Follow = std::function<void(size_t, size_t)>;

/// Judges `config.methods` and writes results, truths and page into `folder`, which is made when there are results. Returns the
/// page's path. Errors name what failed; what was done before that is kept.
///   onMethod  each method in order, as soon as it is known
///   follow    given what is worked at, tells how far it is; the last one is over when the next is asked for, or
///             `onMethod` is called
world::Result<std::string> judgeAll(const Setting& setting, const RunFiles& files, std::span<const world::Pose> poses,
                                    const RunConfig& config, const std::string& folder,
                                    const std::function<void(const MethodRecord&)>& onMethod,
                                    const std::function<Follow(const std::string&)>& follow);

/// Plays the failure suite, unless `folder` has it from this run already; kept there likewise. Errors and `follow` as above.
world::Result<std::vector<ClaimRecord>> judgeSuite(const Setting& setting, const RunFiles& files,
                                                   std::span<const world::Pose> poses, const RunConfig& config,
                                                   const std::string& folder,
                                                   const std::function<Follow(const std::string&)>& follow);

/// What leaving casters out as hidden comes to on the maps of `gnomon`, by `studyOcclusion`, unless `folder` has it already;
/// kept there, for the page that judgeAll writes. Errors and `follow` as above.
world::Result<std::vector<OcclusionRecord>> judgeOcclusion(const Setting& setting, const RunFiles& files,
                                                           std::span<const world::Pose> poses, const RunConfig& config,
                                                           const std::string& folder,
                                                           const std::function<Follow(const std::string&)>& follow);

}  // namespace tools::lab
