#include "tools/sweep/manifest.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "tools/input_hash.h"

namespace tools::sweep {
namespace {

using Json = nlohmann::ordered_json;
using world::Error;
using world::ErrorCode;
using world::Result;

constexpr size_t kAtOnce = 64;     ///< pods, unless the manifest is edited
constexpr int kTriesOfAShard = 3;  ///< after the first

bool isBelow(const std::string& file, const std::filesystem::path& folder) {
    const auto relative = std::filesystem::path(file).lexically_relative(folder);
    return !relative.empty() && *relative.begin() != "..";
}

}  // namespace

Result<std::string> manifest(const Sweep& sweep, const Cluster& cluster) {
    const std::filesystem::path mount = std::filesystem::absolute(cluster.mount).lexically_normal();
    std::vector<std::string> needed = {sweep.folder.string()};
    for (const Shard& s : sweep.plan.shards)
        for (const std::string& file : {s.world, s.path, s.movers})
            if (!file.empty()) needed.push_back(file);
    for (const std::string& file : needed)
        if (!isBelow(file, mount))
            return Error{ErrorCode::kUsage, file + ": is not below " + mount.string() + ", where pods have the volume; give another --mount, or move it there"};
    const std::string threads = std::to_string(cluster.threads);
    const Json container = {{"name", "shard"},
                            {"image", cluster.image},
                            {"command", {"sh", "-c", "exec gnomon sweep run \"$0\" --shard \"$JOB_COMPLETION_INDEX\" --threads " + threads, sweep.folder.string()}},
                            {"resources", {{"requests", {{"cpu", threads}}}}},
                            {"volumeMounts", Json::array({{{"name", "sweep"}, {"mountPath", mount.string()}}})}};
    const Json pod = {{"restartPolicy", "Never"},
                      {"containers", Json::array({container})},
                      {"volumes", Json::array({{{"name", "sweep"}, {"persistentVolumeClaim", {{"claimName", cluster.claim}}}}})}};
    const size_t shards = sweep.plan.shards.size();
    const Json job = {{"apiVersion", "batch/v1"},
                      {"kind", "Job"},
                      {"metadata", {{"name", "gnomon-" + hexOf(hashText(sweep.folder.string(), 0))}}},
                      {"spec",
                       {{"completionMode", "Indexed"},
                        {"completions", shards},
                        {"parallelism", std::min(shards, kAtOnce)},
                        {"backoffLimitPerIndex", kTriesOfAShard},
                        {"template", {{"spec", pod}}}}}};
    return job.dump(2) + "\n";
}

}  // namespace tools::sweep
